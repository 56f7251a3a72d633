"""Courses by arc length against scipy and by construction; the reference that runs along them within its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from marine.guidance.course import Course, spline, straight
from marine.guidance.reference_filter import MotionLimits
from marine.guidance.trajectory import Trajectory

LIMITS = MotionLimits(0.3, 0.067, 1.6, 1.4, 1.0)
SQUARE = [(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)]
LOOP = [(3.3, 1.2), (4.1, 2.0), (2.2, 1.6), (3.4, 1.7), (3.1, 0.8)]
SPLINE = spline(SQUARE)
metres = st.floats(0.5, 4.5).map(lambda value: round(value, 2))
places = st.lists(st.tuples(metres, metres), min_size=2, max_size=6)


def made(points: list[tuple[float, float]], smooth: bool) -> Course:
    try:
        return spline(points) if smooth else straight(points, 0.02)
    except ValueError:
        assume(False)
        raise


def test_the_spline_is_scipys_natural_spline_over_the_chords() -> None:
    points = [(1.0, 1.0), (3.0, 1.2), (3.3, 3.0), (1.0, 3.0), (0.6, 2.0)]
    t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    expected = CubicSpline(t, points, bc_type="natural")
    fine = expected(np.linspace(0.0, t[-1], 40001))
    course = spline(points)
    assert course.length_m == pytest.approx(float(np.hypot(*np.diff(fine, axis=0).T).sum()), rel=1e-5)
    for s in np.linspace(0.0, course.length_m, 50):
        x, y, gamma, kappa = course.at(float(s))
        near = int(np.hypot(*(fine - (x, y)).T).argmin())
        assert math.dist((x, y), fine[near]) < 3e-4
        (dx, dy), (ddx, ddy) = (expected(near * t[-1] / 40000, order) for order in (1, 2))
        assert abs(math.remainder(gamma - math.atan2(dy, dx), math.tau)) < 0.01
        assert kappa == pytest.approx((dx * ddy - dy * ddx) / math.hypot(dx, dy) ** 3, abs=0.02)
    for point, s in zip(points, course.ends_m, strict=True):
        assert math.dist(course.at(s)[:2], point) < 1e-3


@given(places, st.booleans())
@settings(max_examples=40)
def test_arc_length_direction_and_curvature_belong_together(points: list[tuple[float, float]], smooth: bool) -> None:
    course = made(points, smooth)
    assume(float(abs(course.kappa).max()) < 40.0)  # a sharper bend is shorter than a sample
    s = np.linspace(0.0, course.length_m, 400)
    x, y, gamma, _ = np.array([course.at(float(value)) for value in s]).T
    step = course.length_m / 399
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(np.full(399, step), rel=0.05, abs=1e-4)
    middle = 0.5 * (gamma[1:] + gamma[:-1])
    turned = np.arctan2(np.diff(y), np.diff(x)) - middle
    assert np.abs(np.remainder(turned + math.pi, math.tau) - math.pi).max() < 0.25
    assert course.at(0.0)[:2] == pytest.approx(points[0], abs=1e-9)
    assert course.at(course.length_m)[:2] == pytest.approx(points[-1], abs=1e-6)
    assert course.ends_m == sorted(course.ends_m)


def test_corners_are_missed_by_no_more_than_asked_and_legs_are_counted() -> None:
    course = straight(SQUARE, 0.02)
    for corner in SQUARE[1:3]:
        off = np.hypot(*(course.places - corner).T).min()
        assert 0.015 < off <= 0.0205
    assert [course.leg(s) for s in (-1.0, 0.0, 1.9, 2.1, 3.9, 4.1, 99.0)] == [0, 0, 0, 1, 1, 2, 2]


@given(st.floats(-0.2, 0.2), st.floats(0.0, 5.5))
def test_the_nearest_point_is_found_within_its_window(d: float, s: float) -> None:
    course = SPLINE
    x, y, gamma, _k = course.at(s)
    aside = x - d * math.sin(gamma), y + d * math.cos(gamma)
    assert course.nearest(*aside, s - 0.4, s + 0.4) == pytest.approx(s, abs=5e-3)


def test_a_smooth_path_that_crosses_itself_is_refused_though_its_legs_do_not() -> None:
    with pytest.raises(ValueError, match="smooth path crosses itself"):
        spline(LOOP)
    straight(LOOP, 0.02)
    with pytest.raises(ValueError, match="two points"):
        spline(LOOP[:1])


@pytest.mark.parametrize("end", [(1.0, 1.0), (1.0, 1.2), (1.001, 1.0)])
def test_a_smooth_path_that_turns_back_on_its_track_is_refused(end: tuple[float, float]) -> None:
    back = [(1.0, 1.0), (1.0, 2.0), end]
    with pytest.raises(ValueError, match="turns back on its own track"):
        spline(back)
    straight(back, 0.02)


@given(places, st.booleans(), st.floats(0.02, 0.5), st.lists(st.floats(0.0, 0.5), min_size=5, max_size=40))
@settings(max_examples=20)
def test_the_reference_keeps_its_limits_and_ends_at_the_end(
    points: list[tuple[float, float]], smooth: bool, speed: float, behind: list[float]
) -> None:
    course = made(points, smooth)
    path = Trajectory(course, LIMITS, speed, 0.045, 0.3)
    dt_s, before = 1.0 / 30.0, 0.0
    for k in range(20 * len(behind)):  # a vessel that falls back and catches up
        path.step(dt_s, behind[k // 20])
        assert 0.0 <= path.speed_m_s <= min(speed, LIMITS.speed_m_s) + 1e-9
        assert path.speed_m_s - before <= dt_s * LIMITS.acceleration_m_s2 + 1e-9
        kappa = abs(course.at(path.s_m)[3])
        slowest = 0.02 * LIMITS.speed_m_s
        assert path.speed_m_s <= max(1.5 * slowest, math.sqrt(1.3 * LIMITS.acceleration_m_s2 / max(kappa, 1e-9)))
        assert path.s_m >= 0.0
        before = path.speed_m_s
    for _ in range(30 * 2000):
        if path.ended:
            break
        path.step(dt_s, 0.0)
    assert path.ended
    assert math.dist(path.motion[0][:2], points[-1]) < 2e-3


def test_it_stands_still_while_the_vessel_is_far_behind() -> None:
    path = Trajectory(straight(SQUARE, 0.02), LIMITS, 0.2, 0.045, 0.3)
    for _ in range(150):
        path.step(1.0 / 30.0, 0.0)
    for _ in range(150):
        path.step(1.0 / 30.0, 0.35)
    assert path.speed_m_s == 0.0
    with pytest.raises(ValueError, match="positive"):
        Trajectory(straight(SQUARE, 0.02), LIMITS, 0.0, 0.045, 0.3)
