"""Mode distance: face the wall ahead and keep a distance from it, thesis 8.2."""

from __future__ import annotations

from typing import Any

from bus.messages import HelmState
from marine.control.base import Vector3
from marine.control.distance import DistanceKeeping
from marine.control.model_function import bessel
from services.guidance.base import Guidance, Seen, Tools

ANGLE_FIRST_S = 5.0
"""Algorithm 8.5: the angle's loop runs so long before the distance's, as only near zero the two are independent."""
ANGLE_FASTER = 2.0
"""The angle's characteristic frequency, in units of the distance's, where the vessel file has none of the heading."""


class DistanceGuidance(Guidance):
    """I-PD of the angle and, 5 s later, of the distance, (8.41)-(8.44), from navigation/wall."""

    law = "distance"
    needs = ("X", "N")
    sensor = "laser"

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when a loop is not allowed, (8.22)."""
        super().__init__(tools)
        vessel, (X, _, N) = tools.vessel, tools.limits
        w0 = vessel.hold_w0_rad_s
        faster = tools.config.heading_w0_rad_s or vessel.heading_w0_rad_s or ANGLE_FASTER * w0
        surge, yaw = vessel.model.surge, vessel.model.yaw
        self._keeping = DistanceKeeping(surge, yaw, bessel(3, w0), bessel(3, faster), X, N)
        self._wait_s = 0.0

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Turn first, from the moment that acts."""
        wall = seen.wall
        assert wall is not None
        self._wait_s = ANGLE_FIRST_S
        self._keeping.follow_angle(seen.given[2], wall.angle_rad or 0.0, wall.yaw_rad_s or 0.0)

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Turn, then drive too."""
        wall, keeping, dt_s = seen.wall, self._keeping, seen.dt_s
        assert wall is not None
        phi, d, u, r = (v or 0.0 for v in (wall.angle_rad, wall.distance_m, wall.surge_m_s, wall.yaw_rad_s))
        N = keeping.steer(dt_s, phi, r, seen.missing[2])
        self._wait_s -= dt_s
        if self._wait_s > 0.0:
            keeping.follow_distance(0.0, d, phi, u)
            return 0.0, 0.0, N
        reference_m = d if order.distance_m is None else order.distance_m
        return keeping.drive(dt_s, reference_m, d, phi, u, seen.missing[0]), 0.0, N

    def told(self) -> dict[str, Any]:
        """Return the errors of distance and angle; of the distance none while only the angle is controlled."""
        keeping = self._keeping
        told = {"law": self.law, "error_psi_rad": keeping.angle.error}
        return told if self._wait_s > 0.0 else told | {"error_distance_m": -keeping.distance.error}
