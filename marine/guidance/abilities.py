"""What a vessel can do along a path: its speeds, its turns, and whether a path lies within that and within the pool."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from marine.allocation import axis_limits, vessel_allocation
from marine.frames import wrap_angle
from marine.guidance.course import Course, spline, straight
from marine.guidance.path import Point
from marine.guidance.reference_filter import terminal_speed
from marine.vessel import Axis, Vessel

CORNER_M = 0.02
"""Rounded corners miss their way-point by so much."""
TURN_SHARE = 0.7
"""Part of the yaw moment that a turn may take."""

_YAW = 5
_LAST = 1e-3
"""Priority of an axis that gets what others leave."""

AXIS_NAMES: dict[Axis, str] = {"X": "surge", "Y": "sway", "Z": "heave", "K": "roll", "M": "pitch", "N": "yaw"}


def course_of(points: Sequence[Point], smooth: bool) -> Course:
    """Return the course through way-points; raise ValueError when there is none."""
    return spline(points) if smooth else straight(points, CORNER_M)


def yaw_limit_at(vessel: Vessel, u_m_s: float) -> float:
    """Return the largest yaw moment in Nm that leaves a vessel the thrust for a speed in m/s."""
    X, N = vessel.model.surge.drag(u_m_s), axis_limits(vessel)[_YAW]
    allocation = vessel_allocation(vessel, priority={_YAW: _LAST})
    sides = (allocation.solve((X, 0.0, 0.0, 0.0, 0.0, side * N), u_m_s)[1][_YAW] for side in (1.0, -1.0))
    return min(abs(N) for N in sides)


class Abilities:
    """Limits of a vessel, to check what is asked of it before it is told."""

    def __init__(self, vessel: Vessel) -> None:
        X, _, _, _, _, N = axis_limits(vessel)
        surge = vessel.model.surge
        backwards = -vessel_allocation(vessel).solve((-X, 0.0, 0.0, 0.0, 0.0, 0.0))[1][0]
        self.vessel = vessel
        self.ahead_m_s = terminal_speed(surge, X) if X else 0.0
        """Speed of full thrust ahead."""
        self.astern_m_s = terminal_speed(surge, backwards) if backwards > 0.0 else 0.0
        self.turn_rad_s = terminal_speed(vessel.model.yaw, TURN_SHARE * N) if N else 0.0
        self.steers_only = "Y" not in vessel.controlled

    def lacking(self, needs: Sequence[Axis]) -> str:
        """Return why a mode cannot be: what the vessel has no actuators for; empty when it can."""
        absent = [AXIS_NAMES[axis] for axis in needs if axis not in self.vessel.controlled]
        return f"{self.vessel.name} has no actuators for {' and '.join(absent)}" if absent else ""

    def check_speed(self, speed_m_s: float) -> None:
        """Raise ValueError for a speed that the vessel does not reach."""
        if not -self.astern_m_s <= speed_m_s <= self.ahead_m_s:
            raise ValueError(
                f"{speed_m_s:g} m/s is more than {self.vessel.name} can do: "
                f"{-self.astern_m_s:.2f} ... {self.ahead_m_s:.2f} m/s"
            )

    def check_path(self, points: Sequence[Point], smooth: bool, speed_m_s: float) -> None:
        """Raise ValueError for a path that leaves the pool, is none, or turns more sharply than the vessel."""
        if not speed_m_s > 0.0:
            raise ValueError(f"the speed along a path must be positive, not {speed_m_s:g} m/s")
        self.check_speed(speed_m_s)
        for i, point in enumerate(points):
            self.check_place(*point, f"way-point {i + 1}: ")
        course = course_of(points, smooth)
        for x, y in course.places.tolist():
            self.check_place(x, y, "the smooth path leaves the pool: ")
        if self.steers_only:
            self._check_turns(points, course if smooth else None, speed_m_s)

    def check_place(self, x_m: float, y_m: float, what: str = "") -> None:
        """Raise ValueError for a place where the hull would not be inside the pool."""
        margin, pool = self.vessel.radius_m, self.vessel.pool
        for axis, value, size in (("x", x_m, pool.length_x_m), ("y", y_m, pool.length_y_m)):
            if not margin - 1e-9 <= value <= size - margin + 1e-9:
                raise ValueError(f"{what}{axis} must lie in {margin:.2f} ... {size - margin:.2f} m, inside the pool")

    def _check_turns(self, points: Sequence[Point], course: Course | None, speed_m_s: float) -> None:
        radius = speed_m_s / self.turn_rad_s if self.turn_rad_s else math.inf
        if course is not None:
            sharpest = 1.0 / max(1e-9, float(abs(course.kappa).max()))
            if sharpest < radius:
                raise ValueError(
                    f"the smooth path turns with {sharpest:.2f} m, {self.vessel.name} at {speed_m_s:g} m/s "
                    f"with {radius:.2f} m: slower, or way-points further apart"
                )
            return
        courses = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(points)]
        turns = [0.0, *(abs(wrap_angle(b - a)) for a, b in pairwise(courses)), 0.0]
        for i, (a, b) in enumerate(pairwise(points)):
            room = sum(radius * math.tan(min(0.5 * turn, 1.55)) for turn in turns[i : i + 2])
            if room > math.dist(a, b):
                raise ValueError(
                    f"leg {i + 1} is too short for its turns: {math.dist(a, b):.2f} m, {self.vessel.name} at "
                    f"{speed_m_s:g} m/s needs {room:.2f} m"
                )
