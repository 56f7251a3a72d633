"""Modes line and path of vessels that steer only: thesis 8.3 or line of sight, and a surge speed."""

from __future__ import annotations

import math
from itertools import accumulate
from typing import Any

from bus.messages import HelmState
from marine.control.base import Vector3
from marine.control.line_following import DirectLine, HeadingLoop, IndirectLine
from marine.control.model_function import bessel
from marine.control.preview import natural_time_s
from marine.frames import wrap_angle
from marine.guidance.abilities import Abilities
from marine.guidance.course import Course, spline
from marine.guidance.line_of_sight import LineOfSight
from marine.guidance.path import Line, Path
from services.guidance.base import Guidance, Seen, Tools, reference_told
from services.guidance.loops import heading_loop, speed_loop

LINE_W0 = 0.7
"""Of the line loop, in units of the heading loop's."""
LOOKAHEAD = 1.5
"""Of the way that the vessel makes while the heading loop settles."""
SIGMA = 0.2
"""Integral gain of the line of sight, in units of the speed: at 0.25 both poles of d are at speed / (2 lookahead)."""
AHEAD = 2.0
"""On a spline the nearest point is looked for so many lookaheads beyond the one before."""


class Track:
    """Where the vessel is on its way: legs, or a spline whose tangent ahead is the line."""

    def __init__(self, order: HelmState, preview_m: float, turn_m: float, along_m: float) -> None:
        points = [(p.x_m, p.y_m) for p in order.points]
        self._path = Path(points, 0.0)
        self._course: Course | None = spline(points) if order.smooth else None
        self._preview_m, self._turn_m = preview_m, turn_m
        self._begins = [0.0, *accumulate(self._path.lengths)]
        self.length_m = self._course.length_m if self._course else self._begins[-1]
        self.along_m = along_m
        self.arrived = False
        self.kappa_1_m = self.lead_rad = 0.0
        """Of a spline, where the vessel will be when its heading has followed: curvature, and the turn until there."""
        while self._begins[self._path.leg + 1] < along_m and self._path.leg < len(self._path.lines) - 1:
            self._path.leg += 1

    @property
    def leg(self) -> int:
        """The present leg."""
        return self._course.leg(self.along_m) if self._course else self._path.leg

    def line(self, x_m: float, y_m: float) -> tuple[Line, float]:
        """Return the line to follow from a place, and how far the vessel is from the path, positive to starboard."""
        if self._course:
            return self._tangent(self._course, x_m, y_m)
        path = self._path
        path.radius_m = self._lead()
        path.advance(x_m, y_m)
        place, d = path.line.place(x_m, y_m)
        self.along_m = self._begins[path.leg] + max(0.0, min(path.lengths[path.leg], place))
        self.arrived = path.leg == len(path.lines) - 1 and place >= path.lengths[-1]
        return path.line, d

    def _tangent(self, course: Course, x_m: float, y_m: float) -> tuple[Line, float]:
        reach = self.along_m + AHEAD * self._preview_m
        self.along_m = course.nearest(x_m, y_m, self.along_m, min(course.length_m, reach))
        self.arrived = self.along_m >= course.length_m - course.step_m
        x, y, gamma, _ = course.at(self.along_m)
        d = Line(x, y, gamma).place(x_m, y_m)[1]
        _, _, turned, self.kappa_1_m = course.at(self.along_m + self._preview_m)
        self.lead_rad = wrap_angle(turned - gamma)
        return Line(x, y, turned), d

    def _lead(self) -> float:
        """Return how far before the present way-point the vessel must begin to turn."""
        path = self._path
        if path.leg == len(path.lines) - 1:
            return 0.0
        turn = abs(wrap_angle(path.lines[path.leg + 1].gamma_rad - path.line.gamma_rad))
        lead = self._turn_m * math.tan(min(0.5 * turn, 1.2)) + self._preview_m * math.sin(0.5 * turn)
        return min(lead, path.lengths[path.leg])


class Steering(Guidance):
    """[controller] line says how: `direct` (Algorithm 8.6), `indirect` (8.8) or `line_of_sight`, onto the heading loop.

    The heading loop that `indirect` builds on is the designed one, whose transfer function is its model function.
    """

    law = "path"
    needs = ("X", "N")

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when a loop cannot be designed."""
        super().__init__(tools)
        X, _, N = tools.limits
        self._surge, self._heading = speed_loop(tools, tools.vessel.model.surge, X), heading_loop(tools)
        self._loop = HeadingLoop.of(self._heading.design.transfer_function())
        self._w0 = tools.config.line_w0_rad_s or LINE_W0 / natural_time_s(self._heading.design)
        self._turn_rad_s = Abilities(tools.vessel).turn_rad_s
        self._limit = N
        self._request = ""
        self._track: Track | None = None
        self._law: DirectLine | IndirectLine | LineOfSight
        self._line, self._d_m, self._phi_rad = Line(0.0, 0.0, 0.0), 0.0, 0.0
        self._at = (0.0, 0.0)

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Start the loops from what the actuators give; the line's integral from zero."""
        (u, _, r), (X, _, N) = seen.nu, seen.given
        self._surge.follow(X, u, u)
        self._heading.follow(N, seen.eta[2], r)
        if order.request_id == self._request and self._track is not None:
            self._law.reset()
            if isinstance(self._law, DirectLine):
                self._law.follow(N, r)

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Keep the speed, steer to the line."""
        (x, y, psi), (u, _, r), (short_x, _, short_n) = seen.eta, seen.nu, seen.missing
        track = self._begin(order, seen)
        line, self._d_m = track.line(x, y)
        if line.gamma_rad != self._line.gamma_rad and not order.smooth and isinstance(self._law, LineOfSight):
            self._law.reset()  # the current came from another side
        self._line, self._at, self._phi_rad = line, (x, y), wrap_angle(psi - line.gamma_rad)
        X = self._surge.step(seen.dt_s, order.speed_m_s or 0.0, u, u, short_x)
        turning = u * track.kappa_1_m
        if isinstance(self._law, DirectLine):  # it is told the curve's rate ahead, so its line is the tangent here
            phi_rad = self._phi_rad + track.lead_rad
            return X, 0.0, self._law.step(seen.dt_s, self._d_m, phi_rad, seen.nu, short_n, turning)
        if isinstance(self._law, IndirectLine):
            relative = self._law.step(seen.dt_s, self._d_m, self._phi_rad, r - turning)
        else:
            relative = self._law.heading(seen.dt_s, self._d_m)
        return X, 0.0, self._heading.step(seen.dt_s, line.gamma_rad + relative, psi, r, short_n)

    def _begin(self, order: HelmState, seen: Seen) -> Track:
        """Return the track of this request, made when it is new."""
        if self._track is None or order.request_id != self._request:
            speed, config = order.speed_m_s or 0.0, self.tools.config
            delay_m = speed * self._loop.a1
            turn_m = speed / self._turn_rad_s
            self._track = Track(order, 0.5 * delay_m, turn_m, seen.along_m)
            self._request = order.request_id
            approach_rad, a = math.radians(config.approach_deg), bessel(4, self._w0)
            yaw = self.tools.vessel.model.yaw
            if config.line == "direct":
                self._law = DirectLine(yaw, a, speed, N_nm=self._limit, approach_rad=approach_rad)
                self._law.follow(seen.given[2], seen.nu[2])
            elif config.line == "indirect":
                self._law = IndirectLine(self._loop, a, speed, approach_rad=approach_rad)
            else:
                self._law = LineOfSight(config.lookahead_m or LOOKAHEAD * delay_m, SIGMA * speed)
        return self._track

    def told(self) -> dict[str, Any]:
        """Return how far along the path and how far from it the vessel is."""
        track = self._track
        assert track is not None
        along = self._line.place(*self._at)[0]
        return reference_told((*self._line.at(along), self._line.gamma_rad)) | {
            "law": self.tools.config.line,
            "error_psi_rad": -self._phi_rad,
            "error_speed_m_s": self._surge.error,
            "cross_track_m": self._d_m,
            "along_m": track.along_m,
            "length_m": track.length_m,
            "leg": track.leg,
            "arrived": track.arrived,
        }
