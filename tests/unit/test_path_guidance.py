"""Lines, paths and line of sight."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marine.guidance.line_of_sight import LineOfSight
from marine.guidance.path import Line, Path

metres = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)


@given(metres, metres, angles, metres, metres)
def test_a_place_on_a_line_and_back(x: float, y: float, gamma: float, s: float, d: float) -> None:
    line = Line(x, y, gamma)
    on_line = line.at(s)
    aside = Line(*on_line, gamma + math.pi / 2.0).at(d)  # starboard is 90 degrees clockwise seen from above
    assert line.place(*aside) == pytest.approx((s, d), abs=1e-9)


@given(angles, st.floats(-1.4, 1.4), st.floats(0.1, 2.0))
def test_distance_grows_as_2_50_says(gamma: float, phi: float, u: float) -> None:
    line, h = Line(1.0, -2.0, gamma), 1e-4
    x, y = 3.0 + h * u * math.cos(gamma + phi), 4.0 + h * u * math.sin(gamma + phi)
    d_dot = (line.place(x, y)[1] - line.place(3.0, 4.0)[1]) / h
    assert d_dot == pytest.approx(u * math.sin(phi), abs=1e-8)


def test_a_path_goes_from_leg_to_leg_and_ends() -> None:
    path = Path([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)], 0.5)
    assert not path.advance(3.4, 0.2)
    assert path.leg == 0
    assert path.to_go(3.4, 0.2) == pytest.approx(0.6)
    assert not path.advance(3.6, 0.2)
    assert path.leg == 1
    assert path.line.gamma_rad == pytest.approx(math.pi / 2.0)
    assert not path.advance(0.0, 0.0)  # carried back: the leg that was left stays behind
    assert path.leg == 1
    assert path.advance(4.0, 2.6)
    assert path.end == pytest.approx((4.0, 3.0))


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        ([(0.0, 0.0)], "two points"),
        ([(0.0, 0.0), (1.0, 1.0), (1.0, 1.0)], "equal"),
        ([(0.0, 0.0), (math.nan, 1.0)], "no number"),
        ([(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)], "crosses itself: legs 1 and 3"),
        ([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 0.0)], "crosses itself"),
        ([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 0.0)], "crosses itself"),
    ],
)
def test_a_path_that_cannot_be_followed_is_refused(points: list[tuple[float, float]], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        Path(points, 0.2)


def test_line_of_sight_converges_in_a_current_only_with_its_integral() -> None:
    """u = 1 m/s, a current of 0.3 m/s across the line, heading followed at once."""
    ends = []
    for sigma in (0.0, 0.5):
        sight, d = LineOfSight(4.0, sigma), 20.0
        for _ in range(3000):
            d += 0.1 * (math.sin(sight.heading(0.1, d)) + 0.3)
        ends.append(d)
    assert ends[0] == pytest.approx(4.0 * math.tan(math.asin(0.3)), abs=1e-3)
    assert ends[1] == pytest.approx(0.0, abs=1e-3)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=50))
def test_line_of_sight_never_looks_back(distances: list[float]) -> None:
    sight = LineOfSight(2.0, 0.2)
    headings = [sight.heading(0.1, d) for d in distances]
    assert all(abs(heading) < math.pi / 2.0 for heading in headings)
    sight.reset()
    assert sight.heading(0.0, 0.0) == 0.0


def test_line_of_sight_refuses_what_cannot_work() -> None:
    with pytest.raises(ValueError, match="Delta > 0"):
        LineOfSight(0.0, 0.1)
