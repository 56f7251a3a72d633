"""One experiment under way: its machine, what was measured so far, and what it tells of the vessel by now."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bus.clock import NS
from bus.messages import (
    AXIS_FIELDS,
    CameraPose,
    ExperimentAxis,
    ExperimentEstimate,
    ExperimentPlan,
    IdentifiedParameter,
    NavigationState,
    SensorCompass,
    SensorDepth,
    SensorLaser,
    SensorPosition,
    WallState,
    Wrench,
)
from marine.dynamics.step_response import time_constant
from marine.identification.experiments import Experiment
from marine.identification.record import LONGEST_GAP_S, Record, on_grid
from marine.identification.result import Axis, IdentificationError, Identified
from marine.identification.running import RunningEstimate
from marine.vessel import DegreeOfFreedom, Pool, Vessel

_WINDOWS_S = (0.6, 3.0)
"""Shortest and longest window of the running estimate."""
_LEAST_QUALITY = 0.3
_LOST_SAMPLES = 3
"""So many in a row may be missing: of the laser's every tenth is."""

Measurement = CameraPose | SensorCompass | SensorPosition | SensorDepth | SensorLaser


def kind_of(axis: ExperimentAxis) -> Axis:
    """Return whether an axis is an angle or a way."""
    return "angular" if axis == "yaw" else "linear"


def running_estimate(dof: DegreeOfFreedom, axis: ExperimentAxis, C: float, delay_s: float) -> RunningEstimate:
    """Return an empty running estimate; the model known so far and the force C (N, Nm) say how long its windows are."""
    constant = dof.beta_quadratic == 0.0
    rough = DegreeOfFreedom(dof.alpha, dof.beta if constant else 0.0, dof.beta_quadratic)
    shortest, longest = _WINDOWS_S
    window_s = min(max(0.5 * time_constant(rough, C), shortest), longest)
    return RunningEstimate(window_s, axis=kind_of(axis), delay_s=delay_s)


@dataclass
class Watch:
    """One axis under observation: measurements as (time in s, way along the axis in m or heading in rad), estimate.

    begun: where ways are measured from.
    """

    axis: ExperimentAxis
    live: RunningEstimate
    begun: NavigationState | None = None
    _heading_rad: float | None = None
    _wall_m: float | None = None

    def take(
        self, measurements: Iterable[Measurement], wrenches: Iterable[Wrench], name: str
    ) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Return what was measured and delivered since the last call; name: of the vessel, for poses of several."""
        forces = [(w.stamp_ns / NS, getattr(w, AXIS_FIELDS[self.axis]) or 0.0) for w in wrenches]
        measured = [(m.stamp_ns / NS, value) for m in measurements if (value := self._value(m, name)) is not None]
        for force in forces:
            self.live.force(*force)
        for position in measured:
            self.live.position(*position)
        return measured, forces

    def way(self, x_m: float, y_m: float, z_m: float) -> float:
        """Return the way along the axis since the start in m."""
        assert self.begun is not None
        if self.axis == "heave":
            return z_m - (self.begun.z_m or 0.0)
        c, s = math.cos(self.begun.psi_rad), math.sin(self.begun.psi_rad)
        dx, dy = x_m - self.begun.x_m, y_m - self.begun.y_m
        return dx * c + dy * s if self.axis == "surge" else dy * c - dx * s

    def estimate(self, run: str = "") -> ExperimentEstimate:
        """Return what is known by now, or why there is nothing yet, as it goes over the bus."""
        try:
            found = self.live.result()
        except IdentificationError as reason:
            return ExperimentEstimate(run=run, axis=self.axis, method="", used_s=0.0, reason=str(reason)[:400])
        return ExperimentEstimate(
            run=run,
            axis=self.axis,
            method=found.method,
            used_s=found.data.duration_s,
            parameters=as_parameters(found),
        )

    def _value(self, one: Measurement, name: str) -> float | None:
        if isinstance(one, CameraPose):
            good = one.name in ("", name) and not one.heading_ambiguous and one.quality >= _LEAST_QUALITY
            if not good or one.x_m is None or one.y_m is None:
                return None
            return self._unwrapped(one.psi_rad) if self.axis == "yaw" else self.way(one.x_m, one.y_m, 0.0)
        if isinstance(one, SensorCompass):
            return self._unwrapped(one.psi_rad)
        if isinstance(one, SensorLaser):
            return self._off_the_wall(one)
        return self.way(0.0, 0.0, one.z_m) if isinstance(one, SensorDepth) else self.way(one.x_m, one.y_m, 0.0)

    def _off_the_wall(self, one: SensorLaser) -> float | None:
        """Return the way towards the wall since the first sample with both dots."""
        if one.distance_m is None or one.angle_rad is None:
            return None
        distance_m = one.distance_m * math.cos(one.angle_rad)
        self._wall_m = distance_m if self._wall_m is None else self._wall_m
        return self._wall_m - distance_m

    def _unwrapped(self, psi_rad: float) -> float:
        before = psi_rad if self._heading_rad is None else self._heading_rad
        self._heading_rad = before + math.remainder(psi_rad - before, math.tau)
        return self._heading_rad


@dataclass
class Run:
    """One experiment under way: its plan and machine, and the record so far."""

    run: str
    plan: ExperimentPlan
    machine: Experiment
    watch: Watch
    begun: NavigationState
    measured: list[tuple[float, float]] = field(default_factory=list)
    forces: list[tuple[float, float]] = field(default_factory=list)
    turned_rad: float = 0.0
    psi_rad: float | None = None

    def eta(self, state: NavigationState) -> float:
        """Return the way along the axis, or the angle turned, since the start: estimated, by the laser as measured.

        The filter of the wall believes in the model that is to be identified.
        """
        if self.plan.sensor == "laser":
            return self.measured[-1][1] if self.measured else 0.0
        if self.plan.axis != "yaw":
            return self.watch.way(state.x_m, state.y_m, state.z_m or 0.0)
        before = self.begun.psi_rad if self.psi_rad is None else self.psi_rad
        self.turned_rad += math.remainder(state.psi_rad - before, math.tau)
        self.psi_rad = state.psi_rad
        return self.turned_rad

    def take(self, measurements: Iterable[Measurement], wrenches: Iterable[Wrench], name: str) -> None:
        """Add what was measured and delivered since the last call to the record."""
        measured, forces = self.watch.take(measurements, wrenches, name)
        self.measured += measured
        self.forces += forces

    def record(self, sample_s: float | None, delay_s: float, period_s: float) -> Record:
        """Return the record of a sensor with a sample every period_s; raise IdentificationError when there is none."""
        if not self.measured or not self.forces:
            raise IdentificationError("nothing was measured in this time")
        t, eta = np.array(self.measured).T
        tau_s, tau = np.array(self.forces).T
        return on_grid(
            t,
            eta,
            tau_s,
            tau,
            axis=kind_of(self.plan.axis),
            begin_s=self.machine.used_from_s,
            end_s=self.machine.ended_s or t[-1],
            sample_s=sample_s,
            delay_s=delay_s,
            longest_gap_s=max(LONGEST_GAP_S, (_LOST_SAMPLES + 1.2) * period_s),
        )


def as_parameters(found: Identified) -> tuple[IdentifiedParameter, ...]:
    """Return identified values as they go over the bus."""
    return tuple(
        IdentifiedParameter(name=p.name, value=p.value, unit=p.unit, std=p.std if math.isfinite(p.std) else None)
        for p in found.parameters
    )


def period_of(vessel: Vessel, port: str) -> float:
    """Return the sample time in s of the sensor behind a port, 0.0 where the file names none."""
    sensor = next((s for s in vessel.sensors if s.kind == ("camera" if port == "pose" else port)), None)
    return sensor.sample_time_s if sensor else 0.0


def sensor_of(
    vessel: Vessel, axis: ExperimentAxis, instruments: bool | None, sensor: Literal["laser"] | None = None
) -> str:
    """Return which port an axis is recorded from: pose, compass, position, depth or the sensor that the plan names.

    instruments: take them although there is a camera; None: only where there is none.
    """
    if sensor or axis == "heave":
        return sensor or "depth"
    port = "compass" if axis == "yaw" else "position"
    has = vessel.sensor("compass" if axis == "yaw" else "position") is not None
    camera = vessel.sensor("camera") is not None or not vessel.sensor("position")
    return port if has and (instruments or not camera) else "pose"


def room_before(wall: WallState | None, vessel: Vessel) -> tuple[float, float]:
    """Return the way ahead to the wall, in m, and behind to where the laser module does not see it any more."""
    laser = vessel.sensor("laser")
    if laser is None or wall is None or wall.distance_m is None:
        return 0.0, 0.0
    return wall.distance_m, (laser.range_max or math.inf) - wall.distance_m


def room(pool: Pool, radius_m: float, axis: str, state: NavigationState) -> tuple[float, float]:
    """Return the free way ahead and behind along an axis of the vessel, in m; for heave behind is the surface."""
    if axis == "heave":
        return math.inf, state.z_m or 0.0
    if axis == "yaw":
        return math.inf, math.inf
    psi = state.psi_rad + (math.pi / 2.0 if axis == "sway" else 0.0)
    ways = [math.inf, math.inf]
    for place, size, c in ((state.x_m, pool.length_x_m, math.cos(psi)), (state.y_m, pool.length_y_m, math.sin(psi))):
        if abs(c) < 1e-3:
            continue
        to_end, to_origin = (size - radius_m - place) / abs(c), (place - radius_m) / abs(c)
        ahead, behind = (to_end, to_origin) if c > 0.0 else (to_origin, to_end)
        ways = [min(ways[0], ahead), min(ways[1], behind)]
    return ways[0], ways[1]
