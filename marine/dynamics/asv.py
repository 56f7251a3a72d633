"""2-DOF model of a fast surface vessel, asv (3), (4), (12), (13), and its regions by Froude number, asv (2)."""

from __future__ import annotations

import math
from typing import Literal

from marine.vessel import AsvModel, DegreeOfFreedom, HorizontalModel

GRAVITY_M_S2 = 9.81
DISPLACEMENT_FROUDE = 0.4
PLANING_FROUDE = 1.0
"""asv section 2: about 0.4 and 1.0-1.2; Table 1 uses 1.0."""

Region = Literal["displacement", "semi-displacement", "planing"]
AsvState = tuple[float, float, float, float, float]
"""[x y psi] in {E} (m, rad), speed U (m/s), yaw rate r (rad/s)."""


def froude_number(speed_m_s: float, submerged_length_m: float) -> float:
    """Return Fn = U / sqrt(L g), asv (2), of a speed through water."""
    return abs(speed_m_s) / math.sqrt(submerged_length_m * GRAVITY_M_S2)


def speed_at_froude(froude: float, submerged_length_m: float) -> float:
    """Return the speed in m/s at a Froude number: asv Table 1."""
    return froude * math.sqrt(submerged_length_m * GRAVITY_M_S2)


def region(speed_m_s: float, submerged_length_m: float) -> Region:
    """Return what carries the vessel at a speed: asv section 2."""
    froude = froude_number(speed_m_s, submerged_length_m)
    if froude < DISPLACEMENT_FROUDE:
        return "displacement"
    return "semi-displacement" if froude < PLANING_FROUDE else "planing"


def regressors(U: float, r: float) -> tuple[float, ...]:
    """Return the 15 basis functions of the damping term, asv (12)."""
    U2, r2 = U * U, r * r
    U3, r3 = U2 * U, r2 * r
    return (1.0, U, r, U2, U * r, r2, U3, U2 * r, U * r2, r3, U2 * U2, U3 * r, U2 * r2, U * r3, r2 * r2)


class AsvDynamics:
    """asv (4): M(x) x' + sigma(x) = tau with x = [U r]; throttle and rudder are without units, in [0, 1], [-1, 1].

    Beyond the model's domain sigma goes on as printed, and the inertia stays what it is at the border.
    """

    def __init__(self, model: AsvModel) -> None:
        self.model = model

    def damping(self, U: float, r: float) -> tuple[float, float]:
        """Return sigma(x) = [sigma_U sigma_r], asv (7), (12)."""
        phi = regressors(U, r)
        return _dot(self.model.damping_speed, phi), _dot(self.model.damping_yaw, phi)

    def inertia(self, U: float, r: float) -> tuple[float, float]:
        """Return the diagonal of M(x), m_U in 1/(m/s^2) and m_r in 1/(rad/s^2), asv (7), (13)."""
        m = self.model
        U = max(0.0, min(m.max_speed_m_s, U))
        r = max(-m.max_yaw_rad_s, min(m.max_yaw_rad_s, r))
        phi = regressors(U, r)
        (a_U, b_U), (a_r, b_r) = m.tanh_speed, m.tanh_yaw
        return (
            _dot(m.inertia_speed, (*phi, math.tanh(a_U * (U - b_U)))),
            _dot(m.inertia_yaw, (*phi, math.tanh(a_r * (U - b_r)))),
        )

    def acceleration(self, U: float, r: float, throttle: float, rudder: float) -> tuple[float, float]:
        """Return [U' r'] in m/s^2 and rad/s^2; at rest a braking term does not drive backwards: U >= 0 in asv (3)."""
        sigma_U, sigma_r = self.damping(U, r)
        m_U, m_r = self.inertia(U, r)
        forward = (throttle - sigma_U) / m_U
        return (max(0.0, forward) if U <= 0.0 else forward), (rudder - sigma_r) / m_r

    def derivative(
        self, state: AsvState, throttle: float, rudder: float, sideslip_rad: float = 0.0
    ) -> tuple[float, float, float, float, float]:
        """Return the derivative of [x y psi U r], asv (3) with the course chi = psi + beta."""
        _, _, psi, U, r = state
        chi = psi + sideslip_rad
        return U * math.cos(chi), U * math.sin(chi), r, *self.acceleration(U, r, throttle, rudder)

    def step(self, state: AsvState, dt_s: float, throttle: float, rudder: float) -> AsvState:
        """Return the state dt_s later by one Runge-Kutta step with constant inputs; psi is not wrapped."""

        def moved(k: AsvState, h: float) -> AsvState:
            x, y, psi, U, r = (s + h * d for s, d in zip(state, k, strict=True))
            return x, y, psi, U, r

        a = self.derivative(state, throttle, rudder)
        b = self.derivative(moved(a, dt_s / 2.0), throttle, rudder)
        c = self.derivative(moved(b, dt_s / 2.0), throttle, rudder)
        d = self.derivative(moved(c, dt_s), throttle, rudder)
        x, y, psi, U, r = (
            s + dt_s / 6.0 * (ka + 2.0 * (kb + kc) + kd) for s, ka, kb, kc, kd in zip(state, a, b, c, d, strict=True)
        )
        return x, y, psi, max(0.0, U), r


def linearised(model: AsvModel) -> HorizontalModel:
    """Return the uncoupled model in the units of asv (4) near straight course at the design speed.

    Surge and yaw have the tangents of damping and the inertias there; sway, which asv (4) does not know, is taken as
    surge: no actuator acts on it.
    """
    dynamics, U, h = AsvDynamics(model), model.design_speed_m_s, 1e-5
    m_U, m_r = dynamics.inertia(U, 0.0)
    surge_drag = (dynamics.damping(U + h, 0.0)[0] - dynamics.damping(U - h, 0.0)[0]) / (2.0 * h)
    yaw_drag = (dynamics.damping(U, h)[1] - dynamics.damping(U, -h)[1]) / (2.0 * h)
    surge = DegreeOfFreedom(m_U, surge_drag, 0.0)
    return HorizontalModel(surge=surge, sway=surge, yaw=DegreeOfFreedom(m_r, yaw_drag, 0.0))


def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))
