"""Distance keeping: I-PD of the angle to a wall and of the distance from it, thesis 8.2.2."""

from __future__ import annotations

import math

from marine.control.model_function import Coefficients
from marine.control.preview import natural_time_s
from marine.control.single_loop import TRACKING_TIME, LimitedLoop
from marine.control.stability import limited
from marine.control.structures import STRUCTURES, design
from marine.vessel import DegreeOfFreedom


class DistanceKeeping:
    """N from phi and r, (8.41), (8.43); X from d and u cos(phi), (8.42) corrected (see docs/errata.md), (8.44).

    The loop of the distance is that of -d, which a push forward makes larger. phi_ref is zero: only near it are the two
    loops independent, so the angle's is engaged first. Drag compensation is limited by (8.26); what the limits cut goes
    to the anti-windup (8.29).
    """

    def __init__(  # noqa: PLR0917 - the symbols of 8.2.2
        self,
        surge: DegreeOfFreedom,
        yaw: DegreeOfFreedom,
        a_d: Coefficients,
        a_phi: Coefficients,
        X_n: float,
        N_nm: float,
    ) -> None:
        """a_d, a_phi: (a1, a2, a3) of the model functions; X_n, N_nm: largest |X|, |N|.

        Raise ValueError when a design is not robustly stable, (8.22).
        """
        self.distance = _loop(surge, a_d, X_n)
        self.angle = _loop(yaw, a_phi, N_nm)

    def follow_angle(self, N: float, phi_rad: float, r_rad_s: float) -> None:
        """Make ready to turn: the next moment, without time passing, is N in Nm."""
        self.angle.follow(N, phi_rad, r_rad_s)

    def follow_distance(self, X: float, distance_m: float, phi_rad: float, u_m_s: float) -> None:
        """Make ready to drive: the next force, without time passing, is X in N."""
        self.distance.follow(X, -distance_m, u_m_s * math.cos(phi_rad))

    def steer(self, dt_s: float, phi_rad: float, r_rad_s: float, missing_nm: float = 0.0) -> float:
        """Return N in Nm that turns the vessel towards the wall; missing_nm: N given less N demanded before."""
        return self.angle.step(dt_s, 0.0, phi_rad, r_rad_s, missing_nm)

    def drive(  # noqa: PLR0917 - the symbols of 8.2.2
        self,
        dt_s: float,
        reference_m: float,
        distance_m: float,
        phi_rad: float,
        u_m_s: float,
        missing_n: float = 0.0,
    ) -> float:
        """Return X in N that brings the vessel to the wanted distance; missing_n: X given less X demanded before."""
        return self.distance.step(dt_s, -reference_m, -distance_m, u_m_s * math.cos(phi_rad), missing_n)


def _loop(dof: DegreeOfFreedom, a: Coefficients, limit: float) -> LimitedLoop:
    made = limited(design(STRUCTURES["I-PD"], dof, a))
    return LimitedLoop(made, limit, TRACKING_TIME * natural_time_s(made))
