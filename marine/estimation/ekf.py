"""Extended Kalman filter of pose, velocity and disturbance from measured poses.

State [x y psi u v r d_x d_y d_n]: eta in {E}, nu in {B}, a disturbance force in {E} and a disturbance moment. Model:
`marine.dynamics.uncoupled` (thesis (2.33)) with the known wrench; velocities and disturbances are disturbed by white
noise, the disturbances being random walks otherwise. Measurement: the pose, thesis 3.5.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import STILL_WATER, Tau, UncoupledModel
from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom, HorizontalModel

Array = NDArray[np.float64]

MAX_SPEED_M_S = 1.0
MAX_YAW_RATE_RAD_S = 4.0
"""No vessel in the pool moves faster: poses that differ by more are not of one vessel."""


@dataclass(frozen=True)
class EkfTuning:
    """Standard deviations. `_walk`: of the change within one second (times sqrt(dt) for other times)."""

    position_m: float = 0.00125
    heading_rad: float = 0.003
    velocity_walk_m_s: float = 0.003
    yaw_rate_walk_rad_s: float = 0.012
    force_walk_n: float = 0.06
    moment_walk_nm: float = 0.004
    initial_velocity_m_s: float = 0.2
    initial_yaw_rate_rad_s: float = 0.6
    initial_force_n: float = 0.3
    initial_moment_nm: float = 0.03
    gate: float = 25.0
    """Largest squared Mahalanobis distance of an innovation: of the good ones 0.1 % are over 16.3."""
    jump_after: int = 5
    """So many refused poses in a row that agree with each other are believed: the vessel or the camera was moved."""


_IDENTITY = np.eye(9)


class Verdict(Enum):
    """What the filter made of a measurement."""

    USED = "used"
    REFUSED = "refused"
    JUMPED = "jumped"


class PoseEkf:
    """The filter at one moment. Arrays are replaced, not changed: `copy.copy` gives an independent filter."""

    def __init__(self, model: HorizontalModel, tuning: EkfTuning, x_m: float, y_m: float, psi_rad: float) -> None:
        self.tuning = t = tuning
        self.state: State = (x_m, y_m, wrap_angle(psi_rad), 0.0, 0.0, 0.0)
        self.disturbance: Tau = (0.0, 0.0, 0.0)
        """[N N Nm] in {E}."""
        noise = [t.position_m**2, t.position_m**2, t.heading_rad**2]
        loose = [t.initial_velocity_m_s**2, t.initial_velocity_m_s**2, t.initial_yaw_rate_rad_s**2]
        disturbance = [t.initial_force_n**2, t.initial_force_n**2, t.initial_moment_nm**2]
        self.covariance: Array = np.diag(noise + loose + disturbance)
        """(9, 9), in the order and the units of the state."""
        self._noise: list[list[float]] = np.diag(noise).tolist()
        self._fresh = np.diag(noise + loose)
        walks = [t.velocity_walk_m_s] * 2 + [t.yaw_rate_walk_rad_s] + [t.force_walk_n] * 2 + [t.moment_walk_nm]
        self._walk = np.diag([0.0] * 3 + [w * w for w in walks])
        self._dynamics = UncoupledModel(model)
        self.innovation: tuple[float, float, float] = (0.0, 0.0, 0.0)
        """Of the last update: measured less expected pose, ..."""
        self.surprise = 0.0
        """... its squared Mahalanobis distance, ..."""
        self.weight: Array = np.zeros((3, 3))
        """... the inverse of its covariance, ..."""
        self.gain: Array = np.zeros((9, 3))
        """... and what it was multiplied by."""
        self._suspect: tuple[float, float, float] | None = None
        self._suspects = 0
        self._suspect_age_s = 0.0

    def exchange(self, model: HorizontalModel) -> None:
        """Go on with another model of the vessel."""
        self._dynamics = UncoupledModel(model)

    def predict(self, dt_s: float, tau: Tau) -> Array:
        """Go forward by dt_s (at most some 0.1 s) with the wrench tau in {B}; return the transition matrix (9, 9)."""
        _, _, psi_0, u_0, v_0, r_0 = self.state
        x, y, psi, u, v, r = self._dynamics.step(self.state, dt_s, tau, STILL_WATER, self.disturbance)
        F = self._transition(0.5 * (psi_0 + psi), 0.5 * (u_0 + u), 0.5 * (v_0 + v), 0.5 * (r_0 + r), dt_s)
        self.state = (x, y, wrap_angle(psi), u, v, r)
        self.covariance = F.dot(self.covariance).dot(F.T) + self._walk * dt_s  # dot: half the price of @
        self._suspect_age_s += dt_s
        return F

    def _transition(self, psi: float, u: float, v: float, r: float, dt_s: float) -> Array:
        """Return I + A dt, (9, 9), A being the derivative of the model by the state."""
        d_x, d_y, _ = self.disturbance
        model = self._dynamics.model
        surge, sway, yaw = model.surge, model.sway, model.yaw
        m_u, m_v, m_r = surge.alpha, sway.alpha, yaw.alpha
        c, s = dt_s * math.cos(psi), dt_s * math.sin(psi)
        F = _IDENTITY.copy()
        F[0, 2] = -s * u - c * v
        F[0, 3] = F[1, 4] = c
        F[0, 4] = -s
        F[1, 2] = c * u - s * v
        F[1, 3] = s
        F[2, 5] = dt_s
        F[3, 2] = (c * d_y - s * d_x) / m_u
        F[3, 3] = _decay(surge, u, dt_s)
        F[3, 6] = c / m_u
        F[3, 7] = s / m_u
        F[4, 2] = (-s * d_y - c * d_x) / m_v
        F[4, 4] = _decay(sway, v, dt_s)
        F[4, 6] = -s / m_v
        F[4, 7] = c / m_v
        F[5, 5] = _decay(yaw, r, dt_s)
        F[5, 8] = dt_s / m_r
        return F

    def update(self, x_m: float, y_m: float, psi_rad: float, noise: Array | None = None) -> Verdict:
        """Take in a pose measured at the filter's time, unless the gate refuses it.

        noise (3, 3): covariance of the measured pose, m and rad; None: that of the tuning.
        """
        x, y, psi, u, v, r = self.state
        P = self.covariance
        e_x, e_y, e_psi = x_m - x, y_m - y, wrap_angle(psi_rad - psi)
        (a, b, c), (_, d, e), (_, _, f) = P[:3, :3].tolist()
        (xx, xy, xp), (_, yy, yp), (_, _, pp) = self._noise if noise is None else noise.tolist()
        S_inverse = inverse(a + xx, b + xy, c + xp, d + yy, e + yp, f + pp)
        a, b, c, _, d, e, _, _, f = S_inverse
        w_x, w_y, w_psi = a * e_x + b * e_y + c * e_psi, b * e_x + d * e_y + e * e_psi, c * e_x + e * e_y + f * e_psi
        self.surprise = w_x * e_x + w_y * e_y + w_psi * e_psi
        if not self.surprise <= self.tuning.gate:  # not a number is refused, too
            return self._suspected(x_m, y_m, psi_rad)
        self._suspects = 0
        PH = P[:, :3]
        self.weight = np.array(S_inverse).reshape(3, 3)
        self.gain = K = PH.dot(self.weight)
        self.innovation = (e_x, e_y, e_psi)
        dx, dy, dpsi, du, dv, dr, dd_x, dd_y, dd_n = K.dot(self.innovation).tolist()
        d_x, d_y, d_n = self.disturbance
        self.state = (x + dx, y + dy, wrap_angle(psi + dpsi), u + du, v + dv, r + dr)
        self.disturbance = (d_x + dd_x, d_y + dd_y, d_n + dd_n)
        P = P - K.dot(PH.T)
        self.covariance = 0.5 * (P + P.T)
        return Verdict.USED

    def _suspected(self, x_m: float, y_m: float, psi_rad: float) -> Verdict:
        before, self._suspect = self._suspect, (x_m, y_m, psi_rad)
        age_s, self._suspect_age_s = self._suspect_age_s, 0.0
        agrees = self._suspects > 0 and before is not None and self._one_vessel(before, self._suspect, age_s)
        self._suspects = self._suspects + 1 if agrees else 1
        if self._suspects < self.tuning.jump_after:
            return Verdict.REFUSED
        self._suspects = 0
        _, _, _, u, v, r = self.state
        self.state = (x_m, y_m, wrap_angle(psi_rad), u, v, r)
        P = np.zeros((9, 9))
        P[:6, :6] = self._fresh  # a knock changes the velocity, too
        P[6:, 6:] = self.covariance[6:, 6:]
        self.covariance = P
        return Verdict.JUMPED

    def _one_vessel(self, before: tuple[float, float, float], after: tuple[float, float, float], dt_s: float) -> bool:
        """Whether one vessel can have moved from one pose to the other in dt_s."""
        distance_m = math.hypot(after[0] - before[0], after[1] - before[1])
        turn_rad = abs(wrap_angle(after[2] - before[2]))
        sigmas = math.sqrt(2.0 * self.tuning.gate)
        return (
            distance_m <= MAX_SPEED_M_S * dt_s + sigmas * self.tuning.position_m
            and turn_rad <= MAX_YAW_RATE_RAD_S * dt_s + sigmas * self.tuning.heading_rad
        )


def _decay(dof: DegreeOfFreedom, nu: float, dt_s: float) -> float:
    """Return 1 - dt d(drag)/d(nu) / alpha: what is left of a small change of velocity after dt."""
    return 1.0 - dt_s * (dof.beta + 2.0 * dof.beta_quadratic * abs(nu)) / dof.alpha


def inverse(  # noqa: PLR0917 - a matrix
    a: float, b: float, c: float, d: float, e: float, f: float
) -> tuple[float, ...]:
    """Return the inverse of the symmetric positive matrix [a b c; b d e; c e f], row by row.

    A tenth of what numpy.linalg.inv costs.
    """
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    k = 1.0 / (a * A + b * B + c * C)
    A, B, C, D, E, F = k * A, k * B, k * C, k * D, k * E, k * F
    return A, B, C, B, D, E, C, E, F
