"""The simulator with its real far ends: pseudo-terminal and frames in shared memory, on a simulated clock."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import topics
from bus.clock import NS
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import ActuatorCommand, LinkStatus, SimulationFault, SimulationTruth
from camera_tracker.sources import Frame, open_source
from platform_link.service import PlatformLink, PlatformLinkConfig
from services.simulator.actuators import DEAD
from services.simulator.faults import CameraFaults
from services.simulator.saved import Saved, load, save
from services.simulator.service import Simulator, SimulatorConfig, with_flipped_bit
from services.simulator.world import Surroundings, World
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
NAMES = [t.name for t in VESSEL.thrusters]


class Pool:
    """A simulator in a run directory of its own, with the real link to it."""

    def __init__(self, run_dir: Path) -> None:
        self.bus = MemoryBus()
        self.deployment = Deployment(run_dir=run_dir)
        self.truths: list[SimulationTruth] = []
        self.bus.tap(topics.SIMULATION_TRUTH, self.truths.append)

    def start(self, **config: Any) -> Simulator:
        values = {"current_x_m_s": 0.0, "current_std_m_s": 0.0, **config}
        simulator = Simulator(SimulatorConfig(**values), VESSEL, self.deployment)
        self.bus.add(simulator)
        return simulator

    def link(self) -> None:
        self.bus.add(PlatformLink(PlatformLinkConfig(), VESSEL, self.deployment))

    def fault(self, kind: Any, **fields: Any) -> None:
        self.bus.publish(topics.SIMULATION_FAULT, SimulationFault(kind=kind, **fields))
        self.bus.run_for(0.0)

    def run(self, seconds: float, command: float | None = None) -> SimulationTruth:
        """Let time pass, with this command for all thrusters from the allocator's place; return the last truth."""
        for _ in range(round(seconds * 30)):
            if command is not None:
                self.bus.publish(topics.ACTUATOR_COMMAND, ActuatorCommand(commands=dict.fromkeys(NAMES, command)))
            self.bus.run_for(1 / 30)
        return self.truths[-1]


@pytest.fixture
def pool(tmp_path: Path) -> Iterator[Pool]:
    pool = Pool(tmp_path)
    yield pool
    for name in ("platform_link", "simulator"):
        if name in pool.bus._steppers:
            pool.bus.stop(name)


def test_commands_over_the_pseudo_terminal_move_the_vessel(pool: Pool) -> None:
    pool.start(pictures=False)
    pool.link()
    truth = pool.run(5.0, command=15.0)
    assert truth.commands == dict.fromkeys(NAMES, 15.0)
    assert truth.surge_n == pytest.approx(2.546, abs=1e-3)
    assert truth.surge_m_s > 0.25
    assert truth.x_m > 3.0
    truth = pool.run(0.5)  # the allocator is silent: link and platform stop the thrusters
    assert set(truth.commands.values()) == {0.0}
    assert truth.surge_n == 0.0


def test_it_starts_where_the_configuration_says(pool: Pool) -> None:
    pool.start(pictures=False, x_m=1.0, y_m=2.0, psi_rad=0.5)
    truth = pool.run(0.1)
    assert (truth.x_m, truth.y_m, truth.psi_rad) == (1.0, 2.0, 0.5)


def test_truth_comes_thirty_times_a_second(pool: Pool) -> None:
    pool.start(pictures=False)
    pool.run(10.0)
    assert len(pool.truths) == pytest.approx(300, abs=1)
    gaps = np.diff([t.stamp_ns for t in pool.truths])
    assert gaps.min() > 0.9 / 30 * NS
    assert gaps.max() < 1.1 / 30 * NS


def frames(pool: Pool, seconds: float) -> list[Frame]:
    """Return the frames that a tracker would get meanwhile."""
    source = open_source("sim://", pool.deployment.run_dir)
    got = []
    for _ in range(round(seconds * 30)):
        pool.bus.run_for(1 / 30)
        if (frame := source.read()) is not None:
            got.append(frame)
    source.close()
    return got


def test_frames_carry_the_time_of_the_truth_they_show(pool: Pool) -> None:
    pool.start()
    seen = frames(pool, 0.5)
    assert len(seen) >= 14
    assert {f.stamp_ns for f in seen} <= {t.stamp_ns for t in pool.truths}
    assert seen[0].image.shape == (600, 800, 3)
    assert seen[0].image.std() > 5.0


def vessel_column(frame: Frame) -> float:
    """Return the mean column of what is much brighter or redder than the water around: hull and marker."""
    image = frame.image.astype(np.int16)
    _, columns = np.nonzero(image[..., 2] > image[..., 0] + 20)
    return float(columns.mean())


def test_camera_faults_show_in_the_picture_and_clear(pool: Pool) -> None:
    pool.start()
    before = vessel_column(frames(pool, 0.2)[-1])
    pool.fault("camera_shift", x_px=10.0)
    assert vessel_column(frames(pool, 0.2)[-1]) == pytest.approx(before + 10.0, abs=1.0)
    pool.fault("camera_black")
    assert frames(pool, 0.2)[-1].image.max() == 0
    pool.fault("clear")
    assert vessel_column(frames(pool, 0.2)[-1]) == pytest.approx(before, abs=1.0)


def test_dropout_loses_its_part_of_the_frames_but_no_truth(pool: Pool) -> None:
    pool.start()
    pool.fault("dropout", fraction=0.5)
    first = len(pool.truths)
    assert 20 <= len(frames(pool, 2.0)) <= 40
    assert len(pool.truths) - first >= 59
    pool.fault("dropout", active=False)
    assert len(frames(pool, 0.5)) >= 14


def status(pool: Pool) -> LinkStatus:
    pool.run(1.2, command=0.0)
    status = pool.bus.last(topics.LINK_STATUS)
    assert status is not None
    return status


def test_each_order_to_flip_a_byte_costs_one_frame(pool: Pool) -> None:
    pool.start(pictures=False)
    pool.link()
    assert status(pool).crc_errors == 0
    pool.fault("flip_byte")
    assert status(pool).crc_errors == 1
    for _ in range(5):
        pool.fault("flip_byte")
    after = status(pool)
    assert after.crc_errors == 6
    assert after.state == "connected"


def test_a_flipped_bit_neither_makes_nor_hides_the_end_of_a_frame() -> None:
    for value in range(1, 256):
        flipped = with_flipped_bit(bytes([7, value, 0]))
        assert flipped[0] == 7
        assert flipped[2] == 0
        assert flipped[1] not in (0, value)
        assert (flipped[1] ^ value).bit_count() == 1


def test_faults_of_the_world(pool: Pool) -> None:
    pool.start(pictures=False, current_x_m_s=0.02)
    pool.link()
    whole = pool.run(0.3, command=15.0)
    pool.fault("thruster_dead", thruster="front_port")
    assert pool.run(0.1, command=15.0).surge_n == pytest.approx(0.75 * whole.surge_n)
    pool.fault("thruster_dead", thruster="front_port", active=False)
    assert pool.run(0.1, command=15.0).surge_n == whole.surge_n
    pool.fault("thruster_weak", thruster="front_port", fraction=0.6)
    assert pool.run(0.1, command=15.0).surge_n == pytest.approx(0.85 * whole.surge_n)
    pool.fault("thruster_stuck", thruster="front_port")
    assert pool.run(0.1, command=0.0).surge_n == pytest.approx(0.25 * whole.surge_n)
    pool.fault("thruster_stuck", thruster="front_port", active=False)
    pool.fault("thruster_dead", thruster="rear_port")
    pool.fault("current", x_m_s=-0.1, y_m_s=0.05)
    truth = pool.run(0.1, command=15.0)
    assert (truth.current_x_m_s, truth.current_y_m_s) == (-0.1, 0.05)
    pool.fault("displace", x_m=-0.5, y_m=0.3, psi_rad=1.0)
    moved = pool.run(1 / 30, command=15.0)
    assert moved.x_m - truth.x_m == pytest.approx(-0.5, abs=0.03)
    assert moved.y_m - truth.y_m == pytest.approx(0.3, abs=0.03)
    assert moved.psi_rad - truth.psi_rad == pytest.approx(1.0, abs=0.1)
    pool.fault("clear")
    truth = pool.run(0.1, command=15.0)
    assert truth.surge_n == whole.surge_n
    assert (truth.current_x_m_s, truth.current_y_m_s) == (0.02, 0.0)


def test_orders_that_make_no_sense_stop_nothing(pool: Pool, caplog: pytest.LogCaptureFixture) -> None:
    simulator = pool.start(pictures=False)
    with caplog.at_level(logging.WARNING):
        pool.fault("thruster_dead", thruster="bow")
        pool.bus.publish_bytes("simulation/fault", b'{"kind": "earthquake"}')
        pool.bus.publish_bytes("simulation/fault", b"\xff\x00")
        pool.run(0.2)
    assert "no actuator is called 'bow'; known: front_starboard" in caplog.text
    assert simulator.refused_orders == 1
    assert simulator.fault.malformed == 2
    assert len(pool.truths) >= 5


def test_a_killed_simulator_resumes_and_a_stopped_one_starts_afresh(pool: Pool) -> None:
    killed = pool.start(pictures=False)
    pool.link()
    pool.fault("thruster_dead", thruster="rear_port")
    before = pool.run(4.0, command=10.0)
    pool.bus.kill("simulator")
    killed._port.close()  # the kernel does that for a killed process
    pool.bus.run_for(2.0)
    pool.start(pictures=False)
    after = pool.run(1 / 30)
    assert abs(after.x_m - before.x_m) < 0.25 * before.surge_m_s + 0.01  # at most 0.2 s older
    assert after.surge_m_s == pytest.approx(before.surge_m_s, abs=0.03)
    link = pool.run(2.0, command=10.0)
    assert link.commands["front_port"] == 10.0  # over a new pseudo-terminal under the same name
    assert link.surge_n < 0.8 * 4 * 0.2 * 0.02 * 100 * 0.7071  # rear_port is still dead
    pool.bus.stop("simulator")
    pool.start(pictures=False)
    assert pool.run(1 / 30).x_m == 2.5


def test_an_old_or_damaged_state_file_is_left_alone(pool: Pool, caplog: pytest.LogCaptureFixture) -> None:
    pool.start(pictures=False)
    pool.fault("displace", x_m=1.0)
    pool.run(1.0)
    pool.bus.kill("simulator")
    pool.bus.run_for(60.0)
    pool.start(pictures=False)
    assert pool.run(0.1).x_m == 2.5
    pool.bus.kill("simulator")
    path = pool.deployment.run_dir / "simulator.json"
    path.write_bytes(path.read_bytes()[:40])
    pool.start(pictures=False)
    assert pool.run(0.1).x_m == 2.5
    assert f"{path}: cannot be read; starting afresh" in caplog.text


def test_all_faults_that_last_are_saved(tmp_path: Path) -> None:
    start = (1.0, 2.0, 0.5, 0.1, -0.2, 0.3)
    world = World(VESSEL, Surroundings(), 1, start, 0)
    world.actuators.fail({"front_port": DEAD})
    world.constant_current_m_s = (0.1, 0.2)
    camera = CameraFaults(shift_px=(3.0, -4.0), black=True, dropout=0.5)
    save(tmp_path / "state.json", Saved.of(5 * NS, world, camera))
    other = World(VESSEL, Surroundings(), 1, (2.0, 2.0, 0.0, 0.0, 0.0, 0.0), 6 * NS)
    saved = load(tmp_path / "state.json", 6 * NS)
    assert saved is not None
    assert saved.restore(other) == camera
    assert (other.state, other.actuators.failures, other.current_m_s) == (start, {"front_port": DEAD}, (0.1, 0.2))


def test_a_state_file_that_cannot_be_written_is_told_once(pool: Pool, caplog: pytest.LogCaptureFixture) -> None:
    pool.start(pictures=False)
    (pool.deployment.run_dir / "simulator.new").mkdir()
    pool.run(2.0)
    assert len(pool.truths) >= 59
    assert caplog.text.count("after a kill the vessel starts afresh") == 1


def test_nobody_reading_the_port_or_the_frames_holds_it_up(pool: Pool) -> None:
    pool.start()
    shore = os.open(pool.deployment.run_dir / "platform", os.O_RDWR | os.O_NOCTTY)
    source = open_source("sim://", pool.deployment.run_dir)
    pool.run(15.0)  # 20 telemetry frames a second into a buffer of some 4 kB that nobody empties
    assert len(pool.truths) == pytest.approx(450, abs=1)
    assert source.read() is not None
    source.close()
    os.close(shore)
