"""The closed loop of issue 2 on a simulated clock: hold, step, loss of the pose, speed, repeatability."""

from __future__ import annotations

import math
import time
from itertools import pairwise
from typing import Any

import pytest

from bus import topics
from bus.messages import HelmState
from marine.allocation import axis_limits
from tests.star import Star, build_star

CURRENT = {"current_x_m_s": 0.04, "current_y_m_s": 0.03, "current_std_m_s": 0.005}  # 0.05 m/s, and a little more
RATE_GATE = 50.0
"""Times real time that CI insists on. The goal is 100 on an idle machine: see `starboard bench`."""


def holding(x_m: float, y_m: float, psi_rad: float, seconds: float = 20.0, *, filtered: bool = True) -> Star:
    """Return a star that has held a pose for a while."""
    star = build_star(simulator=CURRENT, estimator={"enabled": filtered})
    star.hold(x_m, y_m, psi_rad)
    star.bus.run_for(seconds)
    return star


def helm(star: Star) -> HelmState:
    state = star.bus.last(topics.HELM_STATE)
    assert state is not None
    return state


@pytest.mark.parametrize("filtered", [True, False])
def test_holds_in_a_current(filtered: bool) -> None:
    star = holding(2.5, 1.875, 0.5, filtered=filtered)
    since_s = star.bus.now_s
    star.bus.run_for(30.0)
    distance_m, angle_rad = star.rms_error(2.5, 1.875, 0.5, since_s)
    assert distance_m < 2e-3  # issue 2 asks 10 mm and 1 degree
    assert math.degrees(angle_rad) < 0.2


@pytest.mark.parametrize(("dx_m", "dy_m"), [(1.0, 0.0), (0.6, -0.8)])
def test_a_step_of_one_metre_comes_to_rest_without_much_overshoot(dx_m: float, dy_m: float) -> None:
    star = holding(1.8, 2.0, 0.0)
    since_s = star.bus.now_s
    star.hold(1.8 + dx_m, 2.0 + dy_m, 0.0)
    star.bus.run_for(35.0)
    poses = [t for t in star.truth if t.stamp_ns * 1e-9 >= since_s]
    along = [(t.x_m - 1.8) * dx_m + (t.y_m - 2.0) * dy_m for t in poses]
    assert max(along) < 1.1
    late = [t for t in poses if t.stamp_ns * 1e-9 >= since_s + 20.0]
    assert max(math.hypot(t.x_m - 1.8 - dx_m, t.y_m - 2.0 - dy_m) for t in late) < 0.05


def test_turning_by_half_a_turn_keeps_the_place() -> None:
    star = holding(2.5, 1.875, 0.0)
    since_s = star.bus.now_s
    star.hold(2.5, 1.875, math.pi)
    star.bus.run_for(40.0)
    turning = [t for t in star.truth if t.stamp_ns * 1e-9 >= since_s]
    assert max(math.hypot(t.x_m - 2.5, t.y_m - 1.875) for t in turning) < 0.1
    distance_m, angle_rad = star.rms_error(2.5, 1.875, math.pi, star.bus.now_s - 10.0)
    assert distance_m < 10e-3
    assert math.degrees(angle_rad) < 1.0


def test_a_lost_pose_suspends_with_still_thrusters_and_holding_resumes() -> None:
    star = holding(2.5, 1.875, 0.0)
    star.fault("camera_black")
    star.bus.run_for(0.5)
    lost_s = star.bus.now_s
    star.bus.run_for(4.0)
    assert helm(star).suspended
    assert "pose is lost" in helm(star).reason
    dark = [t for t in star.truth if t.stamp_ns * 1e-9 > lost_s]
    assert all(not any(t.commands.values()) for t in dark)
    drift_m = math.hypot(dark[-1].x_m - 2.5, dark[-1].y_m - 1.875)
    assert drift_m > 0.01  # the current has it
    star.fault("camera_black", active=False)
    star.bus.run_for(20.0)
    assert not helm(star).suspended
    distance_m, _ = star.rms_error(2.5, 1.875, 0.0, star.bus.now_s - 5.0)
    assert distance_m < 10e-3


def test_a_pose_lost_for_long_ends_holding() -> None:
    star = holding(2.5, 1.875, 0.0, seconds=5.0)
    star.fault("camera_black")
    star.bus.run_for(12.0)
    star.fault("clear")
    star.bus.run_for(2.0)
    assert (helm(star).mode, helm(star).status) == ("stop", "fault")
    assert not any(star.truth[-1].commands.values())


def test_every_third_frame_lost_does_not_matter() -> None:
    star = holding(2.5, 1.875, 0.0)
    star.fault("dropout", fraction=0.33)
    since_s = star.bus.now_s
    star.bus.run_for(20.0)
    assert star.rms_error(2.5, 1.875, 0.0, since_s)[0] < 3e-3


def test_a_knocked_camera_moves_the_vessel_by_as_much() -> None:
    star = holding(2.5, 1.875, 0.0)
    star.fault("camera_shift", x_px=10.0)
    star.bus.run_for(25.0)
    truth = star.truth[-1]
    assert truth.x_m - 2.5 == pytest.approx(-10.0 / 160.0, abs=3e-3)
    assert truth.y_m - 1.875 == pytest.approx(0.0, abs=3e-3)
    assert not helm(star).suspended


def test_with_a_dead_thruster_it_still_holds() -> None:
    star = holding(2.5, 1.875, 0.0)
    star.fault("thruster_dead", thruster="rear_port")
    star.bus.run_for(40.0)
    assert star.rms_error(2.5, 1.875, 0.0, star.bus.now_s - 10.0)[0] < 10e-3


@pytest.mark.parametrize("name", ["estimator", "controller", "helm", "allocator", "platform_link", "camera_tracker"])
def test_any_service_of_the_chain_may_die_and_come_back(name: str) -> None:
    star = holding(2.5, 1.875, 0.0)
    star.bus.kill(name)
    star.bus.run_for(0.7)
    dead_s = star.bus.now_s
    star.bus.run_for(1.3)
    assert all(not any(t.commands.values()) for t in star.truth if t.stamp_ns * 1e-9 > dead_s)
    star.start(name)
    star.bus.run_for(20.0)
    assert helm(star).mode == "hold"
    assert star.rms_error(2.5, 1.875, 0.0, star.bus.now_s - 3.0)[0] < 10e-3


def test_runs_many_times_faster_than_real_time() -> None:
    star = holding(2.5, 1.875, 0.0, seconds=2.0)
    factors: list[float] = []
    while max(factors, default=0.0) < RATE_GATE and len(factors) < 4:  # the machine is shared: the best counts
        begin = time.process_time()
        star.bus.run_for(20.0)
        factors.append(20.0 / (time.process_time() - begin))
    print(f"closed loop on MemoryBus: {max(factors):.0f} times real time")
    assert max(factors) >= RATE_GATE


def test_repetition_and_json_give_the_same_bits() -> None:
    def truths(json: bool) -> list[str]:
        star = build_star(json=json, simulator=CURRENT)
        star.hold(3.0, 1.5, 2.0)
        star.bus.run_for(8.0)
        star.fault("dropout", fraction=0.3)
        star.bus.run_for(4.0)
        return [t.model_dump_json() for t in star.truth]

    first, again, through_json = truths(False), truths(False), truths(True)
    assert len(first) > 350
    assert first == again
    assert first == through_json


def test_a_jump_of_the_measured_pose_reaches_the_vessel_as_a_slow_way_back_with_the_reason_told() -> None:
    """The camera is knocked: four poses are refused, the fifth is believed; then it goes on as after a pause."""
    star = holding(2.5, 1.875, 0.5)
    states: list[Any] = star.record(topics.NAVIGATION_STATE)
    wrenches: list[Any] = star.record(topics.HELM_WRENCH)
    since_s = star.bus.now_s
    star.fault("camera_shift", x_px=120.0)  # 0.75 m
    star.bus.run_for(1.5)
    assert max(b.x_m - a.x_m for a, b in pairwise(states)) > 0.7, "the estimate jumps, as it must"
    assert states[-1].jumps == 1
    steps = [abs(b.surge_n - a.surge_n) for a, b in pairwise(wrenches)]
    assert max(steps) < 0.2 * axis_limits(star.vessel)[0], "the thrusters do not"
    note = star.bus.last(topics.HEARTBEAT.of(name="estimator"))
    assert note is not None
    told = "the measured pose jumped by 0.75 m and 0 degrees: believed after 5 poses"  # known to ui/static/health.js
    assert note.note == told
    star.bus.run_for(30.0)
    after = [t for t in star.truth if t.stamp_ns * 1e-9 > since_s]
    assert max(math.hypot(t.surge_m_s, t.sway_m_s) for t in after) < 0.2
    assert star.truth[-1].x_m == pytest.approx(1.75, abs=0.02), "where the camera sees 2.5 m"
