"""Compass, depth, position and speeds, as the drivers of a real vessel's sensors would publish them."""

from __future__ import annotations

import math
import random
import zlib
from collections import deque
from collections.abc import Callable

from bus import topics
from bus.clock import NS
from bus.config import Section
from bus.messages import (
    Message,
    SensorCompass,
    SensorDepth,
    SensorPosition,
    SensorSpeed,
    SensorSurgeSpeed,
    SensorYawRate,
    SimulationTruth,
)
from bus.service import Input, Output, Service
from marine.frames import to_body, wrap_angle
from marine.vessel import Sensor, SensorKind, Vessel
from services.simulator.faults import CameraFaults

_EARLY_NS = NS // 100
"""A truth that comes so little before a sample is due is that sample: the simulator, which a command wakes, looks up to
half a step (8.3 ms) early."""


class SampledSensor:
    """One sensor: samples at its own times, with bias, noise, quantisation, losses and delay; thesis 3.1, 3.3."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self._sensor = sensor
        self._period_ns = round(sensor.sample_time_s * NS)
        self._delay_ns = round(sensor.delay_s * NS)
        self._random = random.Random(zlib.crc32(f"{sensor.kind} {seed}".encode()))  # hash() differs from run to run
        self._due_ns = 0
        self._under_way: deque[tuple[int, list[float]]] = deque()

    def look(self, stamp_ns: int, values: list[float], dropout: float = 0.0) -> None:
        """Take a sample of the true values if it is time; dropout: part of the samples that is lost besides."""
        if stamp_ns + _EARLY_NS < self._due_ns <= stamp_ns + 2 * self._period_ns:
            return
        late = not 0 <= stamp_ns + _EARLY_NS - self._due_ns < self._period_ns
        self._due_ns = (stamp_ns if late else self._due_ns) + self._period_ns
        sensor, measured = self._sensor, [self._measured(value) for value in values]
        lost = self._random.random() < 1.0 - (1.0 - sensor.dropout) * (1.0 - dropout)
        if lost or (sensor.range_max is not None and max(map(abs, values)) > sensor.range_max):
            return
        self._under_way.append((stamp_ns, measured))

    def arrived(self, now_ns: int) -> list[tuple[int, list[float]]]:
        """Return (time of the sample, values) of what has come through by now, oldest first."""
        got = []
        while self._under_way and self._under_way[0][0] + self._delay_ns <= now_ns:
            got.append(self._under_way.popleft())
        return got

    def _measured(self, value: float) -> float:
        sensor = self._sensor
        value += sensor.bias + self._random.gauss(0.0, sensor.noise)
        return round(value / sensor.quantisation) * sensor.quantisation if sensor.quantisation else value


def _through_water(truth: SimulationTruth) -> float:
    return truth.surge_m_s - to_body(truth.current_x_m_s, truth.current_y_m_s, truth.psi_rad)[0]


_TRUE: dict[SensorKind, Callable[[SimulationTruth], list[float]]] = {
    "compass": lambda t: [t.psi_rad],
    "position": lambda t: [t.x_m, t.y_m],
    "depth": lambda t: [t.z_m or 0.0],
    "yaw_rate": lambda t: [t.yaw_rad_s],
    "surge_speed": lambda t: [_through_water(t)],
    "speed": lambda t: [math.hypot(t.surge_m_s, t.sway_m_s)],
}
"""What each sensor measures, the compass first: a position finds the heading of the same moment."""

_MESSAGES: dict[SensorKind, Callable[[list[float]], Message]] = {
    "compass": lambda v: SensorCompass(psi_rad=wrap_angle(v[0])),
    "position": lambda v: SensorPosition(x_m=v[0], y_m=v[1]),
    "depth": lambda v: SensorDepth(z_m=v[0]),
    "yaw_rate": lambda v: SensorYawRate(yaw_rad_s=v[0]),
    "surge_speed": lambda v: SensorSurgeSpeed(surge_m_s=v[0]),
    "speed": lambda v: SensorSpeed(speed_m_s=v[0]),
}


class SensorsConfig(Section):
    """Section [sensors]."""

    seed: int = 1


class Sensors(Service):
    """Play the drivers of the vessel's sensors besides its camera; stamps are the times of the samples.

    On a real vessel a service of the same name publishes what its instruments say.
    """

    name = "sensors"
    rate_hz = 50.0

    truth = Input(topics.SIMULATION_TRUTH, wakes=True, queue=16)
    fault = Input(topics.SIMULATION_FAULT, queue=16)
    position = Output(topics.SENSOR_POSITION)
    compass = Output(topics.SENSOR_COMPASS)
    depth = Output(topics.SENSOR_DEPTH)
    yaw_rate = Output(topics.SENSOR_YAW_RATE)
    surge_speed = Output(topics.SENSOR_SURGE_SPEED)
    speed = Output(topics.SENSOR_SPEED)

    def __init__(self, config: SensorsConfig, vessel: Vessel) -> None:
        known = {kind: vessel.sensor(kind) for kind in _TRUE}
        self._sensors = {kind: SampledSensor(s, config.seed) for kind, s in known.items() if s is not None}
        self._outputs: dict[SensorKind, Output[Message]] = {kind: getattr(self, kind) for kind in self._sensors}
        self._faults = CameraFaults()

    def step(self, now_s: float) -> None:
        """Sample the truth, publish what has come through."""
        for order in self.fault.take():
            self._faults = self._faults.after(order)
        for truth in self.truth.take():
            for kind, sensor in self._sensors.items():
                sensor.look(truth.stamp_ns, _TRUE[kind](truth), self._faults.dropout)
        for kind, sensor in self._sensors.items():
            for stamp_ns, values in sensor.arrived(round(now_s * NS)):
                message = _MESSAGES[kind](values)
                self._outputs[kind].publish(message.model_copy(update={"stamp_ns": stamp_ns, "origin_ns": stamp_ns}))
