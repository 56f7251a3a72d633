"""A reference that runs along a course: slower in bends and at the end, and it waits for the vessel."""

from __future__ import annotations

import math

import numpy as np

from marine.guidance.course import Array, Course
from marine.guidance.reference_filter import MotionLimits

BEND_SHARE = 0.7
"""Part of the acceleration for the bend and, as much again, for the way along it: together the whole of it."""
SLOWEST = 0.02
"""Part of the speed limit with which even a reversal is passed."""


class Trajectory:
    """Place, rate and acceleration of a reference on a course, of a vessel that can push to all sides.

    The speed is the largest with v <= asked, v^2 |kappa| <= 0.7 a, and |v'| <= 0.7 a to what comes, ending with zero:
    the forward and backward pass of J. E. Bobrow, S. Dubowsky, J. S. Gibson, Int. J. Robotics Research 4(3), 1985.
    Getting faster takes what drag leaves of a. When the vessel is `near_m` behind, the reference goes slower, at
    `far_m` it stands still.
    """

    def __init__(self, course: Course, limits: MotionLimits, speed_m_s: float, near_m: float, far_m: float) -> None:
        """speed_m_s: asked, cut to the limits. Raise ValueError unless it is positive."""
        if not speed_m_s > 0.0:
            raise ValueError(f"the speed along a path must be positive, not {speed_m_s:g} m/s")
        self.course, self._limits = course, limits
        self._near, self._far = near_m, far_m
        self._most = min(speed_m_s, limits.speed_m_s)
        self._along = BEND_SHARE * limits.acceleration_m_s2
        self._speeds: list[float] = _profile(course, self._most, self._along, SLOWEST * limits.speed_m_s).tolist()
        self.s_m = self.speed_m_s = self._acceleration = 0.0

    @property
    def ended(self) -> bool:
        """Whether the reference is at the end."""
        return self.s_m >= self.course.length_m - 1e-3

    def start(self, s_m: float, speed_m_s: float = 0.0) -> None:
        """Begin at an arc length with a speed along the course, cut to what is allowed there."""
        self.s_m, self._acceleration = max(0.0, min(self.course.length_m, s_m)), 0.0
        self.speed_m_s = max(0.0, min(speed_m_s, self._allowed(self.s_m)))

    def step(self, dt_s: float, behind_m: float) -> None:
        """Move on; behind_m: distance of the vessel from the reference."""
        if dt_s <= 0.0:
            return
        waits = max(0.0, min(1.0, (self._far - behind_m) / (self._far - self._near)))
        to_go = self.course.length_m - self.s_m
        wanted = min(self._allowed(self.s_m) * waits, self._limits.approach_1_s * to_go)
        faster = self._along * (1.0 - (self.speed_m_s / self._limits.speed_m_s) ** 2) * dt_s
        before = self.speed_m_s
        self.speed_m_s = max(before - dt_s * self._limits.acceleration_m_s2, min(before + faster, wanted))
        self.speed_m_s = max(0.0, min(self.speed_m_s, to_go / dt_s))
        self._acceleration = (self.speed_m_s - before) / dt_s
        self.s_m += dt_s * self.speed_m_s

    def _allowed(self, s_m: float) -> float:
        """Return the speed of the profile, at the ends that of a sample further in: there it is zero."""
        place = min(s_m / self.course.step_m, len(self._speeds) - 1.0)
        i = min(int(place), len(self._speeds) - 2)
        speed = self._speeds[i] + (place - i) * (self._speeds[i + 1] - self._speeds[i])
        return max(speed, self._speeds[1])

    @property
    def motion(self) -> tuple[tuple[float, float, float], tuple[float, float], tuple[float, float]]:
        """Place with the direction of the path (x, y, gamma), rate and acceleration in {E}; m, rad, s."""
        x, y, gamma, kappa = self.course.at(self.s_m)
        v, a, c, s = self.speed_m_s, self._acceleration, math.cos(gamma), math.sin(gamma)
        bend = min(v * v * abs(kappa), self._limits.acceleration_m_s2) * math.copysign(1.0, kappa)
        return (x, y, gamma), (v * c, v * s), (a * c - bend * s, a * s + bend * c)


def _profile(course: Course, most: float, a: float, slowest: float) -> Array:
    bends = np.sqrt(a / np.maximum(np.abs(course.kappa), 1e-12))
    limit = np.maximum(np.minimum(most, bends), min(slowest, most)).tolist()
    gain = 2.0 * a * course.step_m
    limit[0] = limit[-1] = 0.0
    for i in range(1, len(limit)):
        limit[i] = min(limit[i], math.sqrt(limit[i - 1] ** 2 + gain))
    for i in range(len(limit) - 2, -1, -1):
        limit[i] = min(limit[i], math.sqrt(limit[i + 1] ** 2 + gain))
    return np.array(limit)
