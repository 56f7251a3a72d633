"""Lines and paths of way-points in {E}: distance and direction, what is refused, which leg is the present one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from marine.frames import to_body, to_tank

Point = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """A straight line through (x_m, y_m) in direction gamma_rad, thesis 2.7, Fig. 2.8."""

    x_m: float
    y_m: float
    gamma_rad: float

    @classmethod
    def through(cls, start: Point, end: Point) -> Line:
        """Return the line from one point to another; raise ValueError when they are one."""
        if math.dist(start, end) < 1e-9:
            raise ValueError("two points of a path are equal")
        return cls(*start, math.atan2(end[1] - start[1], end[0] - start[0]))

    def place(self, x_m: float, y_m: float) -> Point:
        """Return (s, d): metres along the line from its point, and d of (2.50), positive to starboard."""
        return to_body(x_m - self.x_m, y_m - self.y_m, self.gamma_rad)

    def at(self, s_m: float) -> Point:
        """Return the point s_m along the line."""
        dx, dy = to_tank(s_m, 0.0, self.gamma_rad)
        return self.x_m + dx, self.y_m + dy


class Path:
    """Way-points joined by straight legs; `leg` is the present one.

    The next leg is taken `radius_m` before its way-point, measured along the leg, or beyond it.
    """

    def __init__(self, points: Sequence[Point], radius_m: float) -> None:
        """Raise ValueError for fewer than two points, equal neighbours, legs that cross, or what is no number."""
        if len(points) < 2:
            raise ValueError("a path needs two points at least")
        if not all(math.isfinite(c) for point in points for c in point):
            raise ValueError("a point of the path is no number")
        self.lines = [Line.through(a, b) for a, b in pairwise(points)]
        self.lengths = [math.dist(a, b) for a, b in pairwise(points)]
        legs = list(pairwise(points))
        for i, first in enumerate(legs):
            for j in range(i + 2, len(legs)):
                if _cross(first, legs[j]):
                    raise ValueError(f"the path crosses itself: legs {i + 1} and {j + 1}")
        self.radius_m = radius_m
        self.leg = 0

    @property
    def line(self) -> Line:
        """The line of the present leg."""
        return self.lines[self.leg]

    @property
    def end(self) -> Point:
        """The last way-point."""
        return self.lines[-1].at(self.lengths[-1])

    def to_go(self, x_m: float, y_m: float) -> float:
        """Return how far the end of the present leg is ahead, m along the leg."""
        return self.lengths[self.leg] - self.line.place(x_m, y_m)[0]

    def advance(self, x_m: float, y_m: float) -> bool:
        """Take the leg that holds for a vessel at a place; return whether the end of the path is reached."""
        while self.to_go(x_m, y_m) <= self.radius_m:
            if self.leg == len(self.lines) - 1:
                return True
            self.leg += 1
        return False


def _cross(a: tuple[Point, Point], b: tuple[Point, Point]) -> bool:
    """Whether two segments meet."""

    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    def within(p: Point, q: Point, r: Point) -> bool:
        return min(p[0], q[0]) <= r[0] <= max(p[0], q[0]) and min(p[1], q[1]) <= r[1] <= max(p[1], q[1])

    s, t = side(*a, b[0]), side(*a, b[1])
    u, v = side(*b, a[0]), side(*b, a[1])
    if s * t < 0.0 and u * v < 0.0:
        return True
    touching = ((s, (*a, b[0])), (t, (*a, b[1])), (u, (*b, a[0])), (v, (*b, a[1])))
    return any(value == 0.0 and within(*three) for value, three in touching)
