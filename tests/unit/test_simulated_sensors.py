"""Sampled sensors: times, noise, quantisation, delay, losses; and the process that publishes them."""

from __future__ import annotations

import math
import statistics
from typing import Any

import pytest

from bus import topics
from bus.clock import NS
from bus.memory_bus import MemoryBus
from bus.messages import Message, SimulationFault, SimulationTruth
from marine.vessel import Sensor
from services.simulator.sensors import SampledSensor, Sensors, SensorsConfig
from services.vessels import load_vessel


def samples(sensor: Sensor, value: float = 1.0, seconds: float = 100.0, seed: int = 1) -> list[tuple[int, list[float]]]:
    """Return what a sensor says of a constant that it is shown 30 times a second."""
    one, got = SampledSensor(sensor, seed), []
    for k in range(round(30 * seconds)):
        one.look(k * NS // 30, [value])
        got += one.arrived(k * NS // 30)
    return got


def test_samples_come_at_the_sensor_s_own_times() -> None:
    stamps = [s for s, _ in samples(Sensor("compass", 0.5))]
    assert len(stamps) == 200
    assert all(stamp % (NS // 2) < NS // 1000 for stamp in stamps)
    assert len(samples(Sensor("compass", 0.1))) == pytest.approx(1000, abs=1)


def test_noise_bias_and_quantisation() -> None:
    noisy = [v[0] for _, v in samples(Sensor("position", 0.1, noise=0.2, bias=0.5))]
    assert statistics.fmean(noisy) == pytest.approx(1.5, abs=0.03)
    assert statistics.stdev(noisy) == pytest.approx(0.2, rel=0.1)
    coarse = math.radians(2.0)  # VideoRay's compass
    assert {v[0] for _, v in samples(Sensor("compass", 0.1, quantisation=coarse), 1.0)} == {
        round(1.0 / coarse) * coarse
    }


def test_a_delayed_sample_keeps_the_time_it_was_true() -> None:
    one = SampledSensor(Sensor("depth", 0.1, delay_s=0.25), 1)
    one.look(0, [3.0])
    assert one.arrived(round(0.24 * NS)) == []
    assert one.arrived(round(0.25 * NS)) == [(0, [3.0])]


def test_losses_and_range() -> None:
    assert len(samples(Sensor("laser", 0.1, dropout=0.3), seconds=200.0)) == pytest.approx(1400, abs=80)
    assert samples(Sensor("laser", 0.1, range_max=0.9)) == []
    both = SampledSensor(Sensor("laser", 0.1, dropout=0.5), 1)
    for k in range(2000):
        both.look(k * NS // 10, [0.5], dropout=0.5)
    assert len(both.arrived(NS * 1000)) == pytest.approx(500, abs=60)


def test_a_clock_set_back_does_not_silence_it() -> None:
    one = SampledSensor(Sensor("depth", 0.5), 1)
    one.look(1000 * NS, [1.0])
    one.look(10 * NS, [1.0])
    one.look(10 * NS + NS // 2, [1.0])
    assert [s for s, _ in one.arrived(2000 * NS)] == [1000 * NS, 10 * NS, 10 * NS + NS // 2]


def test_seeds_repeat_and_differ_between_sensors() -> None:
    noisy = Sensor("compass", 0.1, noise=0.1)
    assert samples(noisy, seconds=5.0) == samples(noisy, seconds=5.0)
    assert samples(noisy, seconds=5.0) != samples(noisy, seconds=5.0, seed=2)
    assert samples(noisy, seconds=5.0)[1][1] != samples(Sensor("yaw_rate", 0.1, noise=0.1), seconds=5.0)[1][1]


def published(vessel: str, **truth: Any) -> dict[str, list[Message]]:
    """Return what the process publishes of a vessel at rest for 10 s, by topic."""
    bus, seen = MemoryBus(), {}
    bus.add(Sensors(SensorsConfig(), load_vessel(vessel)))
    for topic in topics.all_topics():
        if topic.key.startswith("sensor/"):
            seen[topic.key] = messages = list[Message]()
            bus.tap(topic, messages.append)
    fields = {
        "x_m": 3.0, "y_m": 2.0, "psi_rad": 0.5, "surge_m_s": 0.5, "sway_m_s": 0.0, "yaw_rad_s": 0.1,
        "current_x_m_s": 0.0, "current_y_m_s": 0.0, "surge_n": 0.0, "sway_n": 0.0, "yaw_nm": 0.0, "commands": {},
    }  # fmt: skip
    for _ in range(300):
        bus.publish(topics.SIMULATION_TRUTH, SimulationTruth(**{**fields, **truth}))
        bus.run_for(1 / 30)
    return {key: messages for key, messages in seen.items() if messages}


def test_the_process_publishes_what_the_vessel_file_names() -> None:
    seen = published("videoray", z_m=1.234)
    assert set(seen) == {"sensor/compass", "sensor/depth"}
    assert len(seen["sensor/depth"]) == pytest.approx(100, abs=2)
    assert statistics.fmean(m.z_m for m in seen["sensor/depth"]) == pytest.approx(1.234, abs=0.005)  # type: ignore[attr-defined]
    seen = published("telemetron")
    assert set(seen) == {"sensor/compass", "sensor/position", "sensor/speed", "sensor/yaw_rate"}
    assert statistics.fmean(m.speed_m_s for m in seen["sensor/speed"]) == pytest.approx(0.5, abs=0.05)  # type: ignore[attr-defined]
    assert set(published("pladypos")) == set()


def test_a_compass_at_half_a_turn_stays_in_range() -> None:
    headings = [m.psi_rad for m in published("videoray", psi_rad=math.pi)["sensor/compass"]]  # type: ignore[attr-defined]
    assert all(-math.pi < psi <= math.pi for psi in headings)
    assert all(abs(psi) > 3.0 for psi in headings)


def test_dropouts_by_fault() -> None:
    bus, got = MemoryBus(), list[Message]()
    bus.add(Sensors(SensorsConfig(), load_vessel("videoray")))
    bus.tap(topics.SENSOR_COMPASS, got.append)
    bus.publish(topics.SIMULATION_FAULT, SimulationFault(kind="dropout", fraction=1.0))
    bus.run_for(1.0)
    assert got == []
