"""Modes line and path of vessels that push to all sides: a moving reference for the positioning law."""

from __future__ import annotations

import math
from typing import Any

from bus.messages import HelmState
from marine.control.base import ZERO, Reference, Vector3
from marine.control.feed_forward import FeedForward
from marine.frames import to_body, wrap_angle
from marine.guidance.abilities import course_of
from marine.guidance.reference_filter import ReferenceFilter
from marine.guidance.trajectory import Trajectory
from services.guidance.base import Guidance, Seen, Tools, reference_told
from services.guidance.pose import law_told, rate_in_tank

ON_PATH_M = 0.02
"""So near to the path's beginning, or where it was left, the reference starts along it."""
NEAR, FAR, ARRIVED = 0.15, 1.0, 0.15
"""In radii: the reference waits for a vessel that is further behind; the vessel has arrived."""


class Following(Guidance):
    """The reference goes to the path, then along it; without a wanted heading the bow points along the path."""

    law = "path"
    needs = ("X", "Y", "N")

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when there is no positioning law."""
        super().__init__(tools)
        if tools.positioning is None:
            raise ValueError(f"{tools.vessel.name} has no positioning law")
        self._filter = ReferenceFilter(tools.motion)
        self._path: Trajectory | None = None
        self._request = ""
        self._on_path = False
        self._error, self._reference = ZERO, ZERO
        self._feed_forward = FeedForward(1.0 / tools.vessel.hold_w0_rad_s)

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Begin here: go on along the path if the vessel is still on it, else back to where it was left."""
        assert self.tools.positioning is not None
        self.tools.positioning.follow(seen.eta, seen.nu, seen.given)
        self._feed_forward.start(seen.disturbance)
        rate = rate_in_tank(seen)
        self._filter.start(seen.eta, rate)
        if self._path is None or order.request_id != self._request:
            self._on_path = False
            return
        x, y, gamma = self._path.motion[0]
        near = math.hypot(x - seen.eta[0], y - seen.eta[1]) < FAR * self.tools.vessel.radius_m
        self._on_path = self._on_path and near
        along_m_s = rate[0] * math.cos(gamma) + rate[1] * math.sin(gamma)
        self._path.start(self._path.s_m, along_m_s if self._on_path else 0.0)

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Move the reference, run the law."""
        law = self.tools.positioning
        assert law is not None
        path = self._path_of(order, seen)
        x, y, gamma = path.motion[0]
        filter_, motion = self._filter, self.tools.motion
        behind = math.hypot(self._error[0], self._error[1])
        if self._on_path:
            path.step(seen.dt_s, behind)
            (x, y, gamma), (x_dot, y_dot), (x_dd, y_dd) = path.motion
        filter_.step(seen.dt_s, (x, y, gamma if order.psi_rad is None else order.psi_rad))
        if not self._on_path:
            off = math.hypot(x - filter_.eta[0], y - filter_.eta[1])
            (x, y), (x_dot, y_dot), (x_dd, y_dd) = filter_.eta[:2], filter_.rate[:2], filter_.acceleration[:2]
            slow = math.hypot(x_dot, y_dot) < ON_PATH_M * motion.approach_1_s
            self._on_path = off < ON_PATH_M and slow and behind < FAR * self.tools.vessel.radius_m
        reference = Reference(
            (x, y, filter_.eta[2]),
            (x_dot, y_dot, filter_.rate[2]),
            (x_dd, y_dd, filter_.acceleration[2]),
        )
        self._reference = reference.eta
        self._error = (x - seen.eta[0], y - seen.eta[1], wrap_angle(filter_.eta[2] - seen.eta[2]))
        disturbance = self._feed_forward.step(law, seen.dt_s, seen.disturbance)
        return law.step(seen.dt_s, reference, seen.eta, seen.nu, seen.missing, disturbance)

    def _path_of(self, order: HelmState, seen: Seen) -> Trajectory:
        """Return the path of this request: made when it is new, taken up where a former controller was."""
        if self._path is None or order.request_id != self._request:
            if self._path is not None and self._on_path:  # the reference goes on from where it is
                self._filter.start(self._reference, (*self._path.motion[1], self._filter.rate[2]))
            course = course_of([(p.x_m, p.y_m) for p in order.points], order.smooth)
            radius = self.tools.vessel.radius_m
            speed = self.tools.motion.speed_m_s if order.speed_m_s is None else order.speed_m_s
            self._path = Trajectory(course, self.tools.motion, speed, NEAR * radius, FAR * radius)
            self._path.start(seen.along_m)
            self._request, self._on_path, self._error = order.request_id, False, ZERO
        return self._path

    def told(self) -> dict[str, Any]:
        """Return what the positioning law tells, and how far along the path the vessel is."""
        path = self._path
        assert path is not None
        x, y = self._reference[0] - self._error[0], self._reference[1] - self._error[1]
        near = path.course.nearest(x, y, path.s_m - 2.0 * self.tools.vessel.radius_m, path.s_m + 0.5)
        path_x, path_y, gamma, _ = path.course.at(near)
        off = math.hypot(*self._error[:2])
        return (
            law_told(self.tools, self._error)
            | reference_told(self._reference)
            | {
                "along_m": path.s_m,
                "length_m": path.course.length_m,
                "leg": path.course.leg(path.s_m),
                "cross_track_m": to_body(x - path_x, y - path_y, gamma)[1],
                "arrived": self._on_path and path.ended and off < ARRIVED * self.tools.vessel.radius_m,
            }
        )
