"""Distance keeping on the star (thesis 8.2): VideoRay before a wall, its laser dots in rendered pictures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import ControlStatus, HelmState, SensorLaser, SimulationTruth, WallState
from bus.service import Service
from camera_tracker.laser.service import LaserTracker
from tests.star import Star

BOW_M = 0.21
"""The lasers sit at the bow: VideoRay's radius from its middle."""


class LaserStar(Star):
    """With the forward camera; the wall is that at x = 0, where the tether is slack."""

    kinds: ClassVar[tuple[type[Service], ...]] = (*Star.kinds, LaserTracker)

    def __init__(
        self,
        folder: Path,
        *,
        distance_m: float = 0.7,
        psi_rad: float = 3.0,
        vessel: str = "videoray",
        unknown: dict[str, Any] | None = None,
        seed: int = 1,
        current_x_m_s: float = 0.0,
        **sections: Any,
    ) -> None:
        world = {
            "laser_pictures": True,
            "x_m": BOW_M + distance_m,
            "psi_rad": psi_rad,
            "seed": seed,
            "current_x_m_s": current_x_m_s,
            "current_std_m_s": 0.0,
        }
        super().__init__(
            vessel=vessel, deployment=Deployment(run_dir=folder), unknown=unknown, simulator=world, **sections
        )

    def until(self, found: Callable[[WallState], bool], seconds: float = 5.0) -> None:
        """Run until the wall is so."""

        def reached() -> bool:
            wall = self.bus.last(topics.NAVIGATION_WALL)
            return wall is not None and found(wall)

        self.bus.run_until(reached, seconds)

    @property
    def helm(self) -> HelmState:
        """The newest state of the helm."""
        state = self.bus.last(topics.HELM_STATE)
        assert state is not None
        return state


def true_m(truth: SimulationTruth) -> float:
    """Return how far the bow is from the wall."""
    return truth.x_m - BOW_M


@dataclass
class Kept:
    """A run: engaged at 0 s, the laser absent from 45 s to 50 s, then so long that the mode is suspended."""

    star: LaserStar
    began_s: float
    walls: list[WallState]
    lasers: list[SensorLaser]
    status: list[ControlStatus]
    suspended: HelmState
    resumed: HelmState

    def errors(self, from_s: float, to_s: float, wanted_m: float = 0.5) -> np.ndarray:
        """Return the true distance less the wanted, in m."""
        stamps = [(t.stamp_ns * 1e-9 - self.began_s, t) for t in self.star.truth]
        return np.array([true_m(t) - wanted_m for at, t in stamps if from_s <= at < to_s])


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    star = LaserStar(tmp_path_factory.mktemp("run"))
    walls = star.record(topics.NAVIGATION_WALL)
    lasers = star.record(topics.SENSOR_LASER)
    status = star.record(topics.CONTROL_STATUS)
    star.until(lambda wall: wall.status == "tracking")
    began_s = star.bus.now_s
    answer = star.request("distance", distance_m=0.5)
    assert answer.accepted, answer.reason
    star.bus.run_for(45.0 - (star.bus.now_s - began_s))
    star.fault("laser_lost")
    star.bus.run_for(5.0)
    star.fault("laser_lost", active=False)
    star.bus.run_for(10.0)
    star.fault("laser_lost")
    star.bus.run_until(lambda: star.helm.suspended, 9.0)
    suspended = star.helm
    star.fault("laser_lost", active=False)
    star.bus.run_until(lambda: not star.helm.suspended, 5.0)
    return Kept(star, began_s, walls, lasers, status, suspended, star.helm)  # type: ignore[arg-type]


def test_the_angle_is_engaged_5_s_before_the_distance(kept: Kept) -> None:
    pushes = [
        (t.stamp_ns * 1e-9 - kept.began_s, t.surge_n) for t in kept.star.truth if t.stamp_ns * 1e-9 > kept.began_s
    ]
    assert max(abs(X) for at, X in pushes if at < 4.9) < 0.05, "no more than rounding"
    assert max(abs(X) for at, X in pushes if 5.0 < at < 8.0) > 0.1
    first = [s for s in kept.status if s.law == "distance" and s.stamp_ns * 1e-9 < kept.began_s + 4.9]
    assert first, "the controller runs the law"
    assert all(s.error_distance_m is None and s.error_psi_rad is not None for s in first)


def test_the_distance_is_kept_against_the_tether(kept: Kept) -> None:
    errors = kept.errors(30.0, 45.0)
    assert np.sqrt(np.mean(errors**2)) < 0.015
    assert np.abs(errors).max() < 0.03


def test_5_s_without_dots_cost_less_than_5_cm(kept: Kept) -> None:
    """Fig. 8.17, issue 7."""
    assert np.abs(kept.errors(45.0, 52.0)).max() < 0.05
    absent = [w for w in kept.walls if 47.0 < w.stamp_ns * 1e-9 - kept.began_s < 50.0]
    assert {w.status for w in absent} == {"predicting"}
    first, last = absent[0], absent[-1]
    assert first.distance_std_m is not None
    assert last.distance_std_m is not None
    assert last.distance_std_m > 1.5 * first.distance_std_m, "the longer, the less it knows"
    assert last.measurement_age_s == pytest.approx(4.9, abs=0.7)
    dark = [s for s in kept.lasers if 45.5 < s.stamp_ns * 1e-9 - kept.began_s < 49.9]
    assert len(dark) >= 8
    assert all(s.distance_m is None and s.lost == "left and right dot lost" for s in dark)


@pytest.mark.soak
@pytest.mark.parametrize("current_x_m_s", [0.0, 0.01, 0.02, -0.015])
@pytest.mark.parametrize("seed", [1, 3])
def test_so_do_24_absences_at_other_moments_and_in_a_current(tmp_path: Path, seed: int, current_x_m_s: float) -> None:
    """Issue 7: from steady state, with a constant disturbance."""
    star = LaserStar(tmp_path, seed=seed, current_x_m_s=current_x_m_s)
    star.until(lambda wall: wall.status == "tracking")
    assert star.request("distance", distance_m=0.5).accepted
    star.bus.run_for(45.0)
    for k in range(3):
        begin = len(star.truth)
        star.fault("laser_lost")
        star.bus.run_for(5.0)
        star.fault("laser_lost", active=False)
        star.bus.run_for(1.0)
        assert max(abs(true_m(t) - 0.5) for t in star.truth[begin:]) < 0.05
        star.bus.run_for(19.0 + 0.13 * k + 0.3 * seed)


def test_longer_than_7_s_suspends_until_the_dots_are_back(kept: Kept) -> None:
    assert kept.suspended.mode == "distance"
    assert kept.suspended.reason == "the laser module has not seen the wall for too long"
    assert kept.resumed.mode == "distance"
    assert not kept.resumed.reason
    assert kept.resumed.distance_m == 0.5


def test_the_estimated_wall_is_the_true_one_within_its_deviation(kept: Kept) -> None:
    truth = {t.stamp_ns // 50_000_000: t for t in kept.star.truth}
    scaled, off = [], []
    for wall in kept.walls:
        true = truth.get(wall.stamp_ns // 50_000_000)
        if true is None or wall.status != "tracking" or wall.stamp_ns * 1e-9 < kept.began_s + 10.0:
            continue
        assert wall.distance_m is not None
        assert wall.distance_std_m is not None
        off.append(wall.distance_m - true_m(true))
        scaled.append(off[-1] / wall.distance_std_m)
    assert len(off) > 200
    assert np.sqrt(np.mean(np.square(off))) < 0.008
    assert np.sqrt(np.mean(np.square(scaled))) < 2.0
    assert len({s.stamp_ns for s in kept.lasers}) == len(kept.lasers)
    gaps = [b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(kept.lasers)]
    assert np.median(gaps) == pytest.approx(0.5e9, abs=0.1e9), "2 Hz"


def test_a_ramp_and_a_step_are_followed(tmp_path: Path) -> None:
    """Fig. 8.16: a new wish moves the reference, nothing is engaged anew."""
    star = LaserStar(tmp_path, distance_m=0.6)
    star.until(lambda wall: wall.status == "tracking")
    assert star.request("distance", distance_m=0.6).accepted
    star.bus.run_for(20.0)
    for k in range(1, 21):
        assert star.request("distance", distance_m=0.6 - 0.01 * k).accepted
        star.bus.run_for(1.0)
        assert abs(true_m(star.truth[-1]) - star.helm.distance_m) < 0.1  # type: ignore[operator]
    star.bus.run_for(10.0)
    assert true_m(star.truth[-1]) == pytest.approx(0.4, abs=0.03)
    assert star.request("distance", distance_m=0.55).accepted
    stepped_s = star.bus.now_s
    star.bus.run_until(lambda: true_m(star.truth[-1]) > 0.45, 10.0)
    star.bus.run_for(20.0)
    after = [true_m(t) for t in star.truth if t.stamp_ns * 1e-9 > stepped_s]
    assert max(after) < 0.55 + 0.045, "overshoot below 30 %"
    assert after[-1] == pytest.approx(0.55, abs=0.03)


def test_what_is_refused(tmp_path: Path) -> None:
    assert "pladypos has no laser module" in Star().request("distance", distance_m=0.5).reason
    far = LaserStar(tmp_path, distance_m=2.0)
    far.until(lambda wall: wall.status == "lost")
    assert "has not seen the wall" in far.request("distance", distance_m=0.5).reason
    near = LaserStar(tmp_path)
    near.until(lambda wall: wall.status == "tracking")
    for wanted in (0.05, 1.5, -1.0):
        answer = near.request("distance", distance_m=wanted)
        assert not answer.accepted
        assert "between 0.1 and 1 m" in answer.reason
    assert near.helm.mode == "stop"


def test_without_a_wish_it_keeps_what_there_is_even_when_the_overhead_camera_goes(tmp_path: Path) -> None:
    star = LaserStar(tmp_path, distance_m=0.6, psi_rad=math.pi)
    star.until(lambda wall: wall.status == "tracking")
    assert star.request("distance").accepted
    assert star.helm.distance_m == pytest.approx(0.6, abs=0.03)
    star.bus.run_for(8.0)
    star.fault("camera_black")
    star.bus.run_for(4.0)
    assert star.helm.mode == "distance"
    assert not star.helm.suspended
    state = star.bus.last(topics.NAVIGATION_STATE)
    assert state is not None
    assert state.status == "lost", "the pose is"
