"""The estimator as a service: latency, refused poses, prediction, loss and return."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bus import topics
from bus.clock import NS
from bus.memory_bus import MemoryBus
from bus.messages import CameraPose, NavigationState, Wrench
from services.estimator import Estimator, EstimatorConfig
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
FRAME_NS = round(NS / 30)
U_M_S = 0.2
DRAG_N = VESSEL.model.surge.drag(U_M_S)


class Pool:
    """A vessel that runs along x at 0.2 m/s, seen without noise; the estimator on its bus."""

    def __init__(self, latency_s: float = 0.0, **config: Any) -> None:
        self.bus = MemoryBus()
        self.estimator = Estimator(EstimatorConfig(**config), VESSEL)
        self.bus.add(self.estimator)
        self.latency_s = latency_s
        self.start_ns = self.bus.clock.now_ns()
        self.states: list[NavigationState] = []
        self.bus.tap(topics.NAVIGATION_STATE, self.states.append)

    def x_m(self, at_ns: int) -> float:
        return 1.0 + U_M_S * (at_ns - self.start_ns) / NS

    def see(self, seconds: float, offset_m: float = 0.0, **fields: Any) -> None:
        for _ in range(round(seconds * 30)):
            self.bus.run_for(FRAME_NS / NS)
            captured_ns = self.bus.clock.now_ns() - round(self.latency_s * NS)
            self.publish(**{"x_m": self.x_m(captured_ns) + offset_m, "stamp_ns": captured_ns, **fields})
            wrench = Wrench(surge_n=DRAG_N, sway_n=0.0, yaw_nm=0.0)
            self.bus.publish(topics.ACTUATOR_DELIVERED, wrench, source="allocator")
            self.bus.run_for(0.0)

    def publish(self, x_m: float, stamp_ns: int, **fields: Any) -> None:
        pose = {"frame": 0, "x_px": 0.0, "y_px": 0.0, "y_m": 1.5, "psi_rad": 0.0, "quality": 1.0, **fields}
        self.bus.publish(topics.CAMERA_POSE, CameraPose(x_m=x_m, stamp_ns=stamp_ns, **pose), source="camera_tracker")
        self.bus.run_for(0.0)

    @property
    def state(self) -> NavigationState:
        """The last one published."""
        state = self.bus.last(topics.NAVIGATION_STATE)
        assert state is not None
        return state


def test_nothing_is_published_before_the_first_pose() -> None:
    pool = Pool()
    pool.bus.run_for(1.0)
    assert pool.states == []


@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.12])
def test_what_is_published_is_true_now_not_at_capture(latency_s: float) -> None:
    pool = Pool(latency_s)
    pool.see(5.0)
    state, now_ns = pool.state, pool.bus.clock.now_ns()
    assert state.stamp_ns == now_ns
    assert state.origin_ns == now_ns - round(latency_s * NS)
    assert state.measurement_age_s == pytest.approx(latency_s, abs=1e-6)
    assert state.x_m == pytest.approx(pool.x_m(now_ns), abs=5e-4)  # 24 mm further than the pose at 0.12 s
    assert state.surge_m_s == pytest.approx(U_M_S, abs=2e-3)


def test_it_is_ready_within_a_second_of_its_start() -> None:
    pool = Pool()
    pool.see(1 / 30)
    pool.see(0.9)
    assert (pool.states[0].status, pool.states[-1].status) == ("initialising", "tracking")
    assert pool.state.surge_m_s == pytest.approx(U_M_S, abs=0.02)
    assert pool.state.x_m == pytest.approx(pool.x_m(pool.bus.clock.now_ns()), abs=2e-3)


def test_one_state_per_pose_while_poses_come() -> None:
    pool = Pool()
    pool.see(3.0)
    assert len(pool.states) == 90


def test_without_poses_it_predicts_then_is_lost_then_starts_again() -> None:
    pool = Pool()
    pool.see(3.0)
    pool.bus.run_for(0.3)
    predicted, first = pool.states[-1], len(pool.states)
    assert predicted.status == "predicting"
    # The delivered wrench counts for 0.35 s, as long as the platform runs it.
    assert predicted.x_m == pytest.approx(pool.x_m(predicted.stamp_ns), abs=2e-3)
    assert (predicted.x_std_m or 0.0) > 2.0 * (pool.states[80].x_std_m or 1.0)
    pool.bus.run_for(8.8)
    changes = [s.status for s in pool.states[first:] if s.measurement_age_s > 1.0]
    assert set(changes) == {"lost"}
    assert len(changes) == pytest.approx(8.1 * Estimator.rate_hz, abs=2)
    assert pool.state.measurement_age_s == pytest.approx(9.1, abs=0.1)
    assert abs(pool.state.x_m - pool.x_m(pool.start_ns + 4 * NS)) < 0.1  # it does not run away meanwhile
    pool.see(0.5)
    assert pool.state.status == "tracking"
    assert pool.state.x_m == pytest.approx(pool.x_m(pool.bus.clock.now_ns()), abs=5e-3)


def at(now_ns: int, **change: Any) -> dict[str, Any]:
    return {"x_m": 1.6, "stamp_ns": now_ns, **change}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("quality", {"quality": 0.1}),
        ("ambiguous", {"heading_ambiguous": True}),
        ("no scale", {"x_m": None}),
        ("no scale in y", {"y_m": None}),
        ("outside the pool", {"x_m": 12.0}),
        ("absurd", {"x_m": 1e300, "y_m": -1e300}),
        ("outlier", {"x_m": 2.5}),
        ("heading outlier", {"psi_rad": 2.0}),
    ],
)
def test_bad_poses_are_refused_and_counted(name: str, change: dict[str, Any]) -> None:
    pool = Pool()
    pool.see(3.0)
    pool.bus.run_for(FRAME_NS / NS)
    now_ns = pool.bus.clock.now_ns()
    pool.publish(**at(now_ns, **{"x_m": pool.x_m(now_ns), **change}))
    assert pool.state.rejected == 1, name
    assert pool.state.x_m == pytest.approx(pool.x_m(now_ns), abs=1e-3)
    pool.see(0.5)
    assert pool.state.rejected == 1
    assert pool.state.status == "tracking"


@pytest.mark.parametrize("shift_ns", [NS, 3600 * NS, 2**62, -100_000, -2 * NS, -900 * NS])
def test_absurd_stamps_are_refused_and_do_no_lasting_harm(shift_ns: int) -> None:
    pool = Pool()
    pool.see(3.0)
    now_ns = pool.bus.clock.now_ns()
    pool.publish(x_m=pool.x_m(now_ns), stamp_ns=now_ns + shift_ns)
    wrench = Wrench(surge_n=50.0, stamp_ns=now_ns + max(shift_ns, NS))
    pool.bus.publish(topics.ACTUATOR_DELIVERED, wrench, source="allocator")
    assert pool.state.rejected == 1
    pool.see(0.5)
    assert pool.state.rejected == 1
    assert pool.state.surge_m_s == pytest.approx(U_M_S, abs=5e-3)


def test_a_camera_that_was_knocked_is_followed_within_a_quarter_of_a_second() -> None:
    pool = Pool()
    pool.see(3.0)
    pool.see(0.1, offset_m=0.0625)
    assert pool.state.x_m == pytest.approx(pool.x_m(pool.bus.clock.now_ns()), abs=2e-3)
    pool.see(0.15, offset_m=0.0625)
    assert pool.state.x_m == pytest.approx(pool.x_m(pool.bus.clock.now_ns()) + 0.0625, abs=2e-3)
    assert all(s.status == "tracking" for s in pool.states[20:] if s.measurement_age_s < 0.1)


def test_switched_off_it_maps_measurements_to_estimates() -> None:
    pool = Pool(enabled=False)
    pool.see(3.0)
    state = pool.state
    assert not state.filtered
    assert state.x_m == pool.x_m(pool.bus.clock.now_ns())
    assert state.surge_m_s == pytest.approx(U_M_S, abs=1e-6)
    assert state.status == "tracking"
    assert (state.disturbance_x_n, state.disturbance_yaw_nm, state.x_std_m) == (None, None, None)
    pool.see(1 / 30, offset_m=0.5)
    assert pool.state.x_m == pool.x_m(pool.bus.clock.now_ns()) + 0.5  # no gate: as measured
    pool.bus.run_for(2.0)
    assert pool.state.status == "lost"


def test_an_impossible_smoothing_is_refused_at_the_start() -> None:
    with pytest.raises(ValueError, match="smoothing_order must be smaller than smoothing_window"):
        EstimatorConfig(smoothing_window=3, smoothing_order=3)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_clock_set_back_starts_the_estimate_anew(enabled: bool) -> None:
    pool = Pool(enabled=enabled)
    pool.see(3.0)
    now_ns = pool.bus.clock.now_ns() - 600 * NS
    for k in range(30):
        stamp_ns = now_ns + k * FRAME_NS
        pose = CameraPose(frame=k, x_px=0, y_px=0, x_m=2.0, y_m=1.5, psi_rad=0.0, quality=1.0, stamp_ns=stamp_ns)
        pool.estimator.pose.offer(pose)
        pool.estimator.pose.refresh()
        pool.estimator.delivered.refresh()
        pool.estimator.step(stamp_ns / NS)
    assert pool.state.rejected == 0
    assert pool.state.status == "tracking"
    assert (pool.state.x_m, pool.state.surge_m_s) == pytest.approx((2.0, 0.0), abs=1e-3)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_late_pose_right_after_a_loss_is_refused(enabled: bool) -> None:
    pool = Pool(enabled=enabled)
    pool.see(1.0)
    pool.bus.run_for(2.0)
    now_ns = pool.bus.clock.now_ns()
    pool.publish(x_m=2.0, stamp_ns=now_ns)
    pool.publish(x_m=2.1, stamp_ns=now_ns - FRAME_NS)
    assert pool.state.rejected == 1
    assert pool.state.x_m == 2.0


def test_no_message_is_ever_not_a_number() -> None:
    # NavigationState refuses NaN and infinity: an estimate that ran away would end the service.
    pool = Pool()
    for k in range(200):
        pool.bus.run_for(0.02)
        pool.publish(
            x_m=2.0 + math.sin(k * 7.0), stamp_ns=pool.bus.clock.now_ns(), y_m=1.5 + math.cos(k * 3.0), psi_rad=k * 1.7
        )
    assert pool.states[-1].rejected > 50


def test_the_poses_of_other_vehicles_are_not_ours() -> None:
    pool = Pool()
    pool.see(2.0)
    for _ in range(30):
        pool.see(1 / 30)
        pool.publish(0.4, pool.bus.clock.now_ns(), name="boat")
    assert pool.state.rejected == 0
    assert pool.state.x_m == pytest.approx(pool.x_m(pool.bus.clock.now_ns()), abs=1e-3)
    pool.see(0.1, name="pladypos")
    assert pool.state.status == "tracking"
