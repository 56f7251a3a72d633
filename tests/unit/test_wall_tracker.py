"""The wall's filter on the star: late samples, another wall, silence."""

from __future__ import annotations

import math

import pytest

from bus.clock import NS
from bus.messages import SensorCompass, SensorLaser, WallState
from services.vessels import load_vessel
from services.wall_tracker import JUMP_AFTER, WallTracker

START_NS = 1_000 * NS


def at(seconds: float) -> int:
    return START_NS + round(seconds * NS)


def laser(seconds: float, distance_m: float = 0.5, angle_rad: float = 0.0) -> SensorLaser:
    return SensorLaser(stamp_ns=at(seconds), distance_m=distance_m, angle_rad=angle_rad)


def followed(*, late: bool) -> WallState:
    """A vessel at rest for 5 s; late: each compass sample comes after a laser sample that is younger."""
    tracker = WallTracker(load_vessel("videoray"))
    told = WallState(status="lost")
    for k in range(51):
        compass = SensorCompass(stamp_ns=at(0.1 * k), psi_rad=1.0)
        if late and k % 5 == 4:
            tracker.laser(laser(0.1 * (k + 1)))
        tracker.compass(compass)
        if not late and k % 5 == 4:
            tracker.laser(laser(0.1 * (k + 1)))
        told = tracker.told(at(0.1 * (k + 1)))
    return told


def test_samples_count_in_the_order_of_their_stamps() -> None:
    early, late = followed(late=False), followed(late=True)
    assert early.status == "tracking"
    assert late == early


def test_distance_along_the_lasers_becomes_distance_square_to_the_wall() -> None:
    tracker = WallTracker(load_vessel("videoray"))
    tracker.laser(laser(0.0, 0.8, math.radians(30.0)))
    told = tracker.told(at(0.0))
    assert told.distance_m == pytest.approx(0.8 * math.cos(math.radians(30.0)), rel=0.01)
    assert told.angle_rad == pytest.approx(math.radians(30.0), rel=0.01)


def test_one_wrong_sample_is_refused_and_several_are_another_wall() -> None:
    tracker = WallTracker(load_vessel("videoray"))

    def after(seconds: float, distance_m: float) -> WallState:
        tracker.laser(laser(seconds, distance_m))
        for k in range(5):
            tracker.compass(SensorCompass(stamp_ns=at(seconds + 0.1 * k), psi_rad=0.0))
        return tracker.told(at(seconds + 0.49))

    for k in range(20):
        after(0.5 * k, 0.5)
    wrong = after(10.0, 0.9)
    assert wrong.distance_m == pytest.approx(0.5, abs=0.02)
    assert after(10.5, 0.5).rejected == 1
    told = [after(11.0 + 0.5 * k, 0.9) for k in range(JUMP_AFTER)]
    assert told[0].distance_m == pytest.approx(0.5, abs=0.05)
    assert told[-1].distance_m == pytest.approx(0.9, abs=0.02)


def test_predicting_then_lost_then_found_again() -> None:
    tracker = WallTracker(load_vessel("videoray"))
    tracker.laser(SensorLaser(stamp_ns=at(0.0), lost="left dot lost"))
    assert tracker.told(at(0.0)).status == "lost"
    tracker.laser(laser(0.5))
    assert [tracker.told(at(t)).status for t in (1.0, 3.0, 7.9, 8.1)] == [
        "tracking",
        "predicting",
        "predicting",
        "lost",
    ]
    assert tracker.told(at(8.2)).distance_m is None
    tracker.laser(laser(8.5, 0.7))
    assert tracker.told(at(8.6)).distance_m == pytest.approx(0.7, abs=0.01)


def test_a_clock_that_was_set_back_begins_anew() -> None:
    tracker = WallTracker(load_vessel("videoray"))
    tracker.laser(laser(100.0))
    assert tracker.told(at(100.1)).status == "tracking"
    assert tracker.told(at(0.0)).status == "lost"
    tracker.laser(laser(0.5, 0.3))
    assert tracker.told(at(0.6)).distance_m == pytest.approx(0.3, abs=0.01)
