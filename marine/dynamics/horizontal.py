"""Coupled model in the horizontal plane, thesis (2.28), corrected: see docs/errata.md (x_G r is a product)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from marine.dynamics.integrate import State, rk4
from marine.dynamics.uncoupled import STILL_WATER, UNDISTURBED, Tau
from marine.vessel import CoupledModel


def coupled_mass_matrix(model: CoupledModel) -> NDArray[np.float64]:
    """Return M_RB + M_A, 3 x 3, thesis (2.28)."""
    m, cross = model.mass_kg, model.added_surge_sway_kg
    return np.array(
        [
            [m + model.added_surge_kg, cross, -m * model.y_g_m],
            [cross, m + model.added_sway_kg, m * model.x_g_m],
            [-m * model.y_g_m, m * model.x_g_m, model.inertia_kg_m2 + model.added_yaw_kg_m2],
        ]
    )


class CoupledDynamics:
    """M nu' + C_RB(nu) nu + C_A(nu_r) nu_r + D(nu_r) nu_r = tau + tau_E, thesis (2.28), with eta' = R(psi) nu (2.27).

    nu_r is relative to a current given in {E}. Coriolis terms of the cross mass X_vdot are included, which (2.28)
    leaves out: without them it would create energy.
    """

    def __init__(self, model: CoupledModel) -> None:
        self.model = model
        self._inverse = np.linalg.inv(coupled_mass_matrix(model)).tolist()

    def derivative(
        self,
        state: State,
        tau: Tau,
        current_m_s: tuple[float, float] = STILL_WATER,
        disturbance: Tau = UNDISTURBED,
    ) -> State:
        """Return the time derivative of a state under the wrench tau; current and disturbance are given in {E}."""
        _, _, psi, u, v, r = state
        c, s = math.cos(psi), math.sin(psi)
        d_x, d_y, d_n = disturbance
        u_r = u - c * current_m_s[0] - s * current_m_s[1]
        v_r = v + s * current_m_s[0] - c * current_m_s[1]
        X, Y, N = self._coriolis(u, v, r, u_r, v_r)
        drag, quadratic = self.model.drag, self.model.drag_quadratic
        f_u = tau[0] + c * d_x + s * d_y - X - (drag[0] + quadratic[0] * abs(u_r)) * u_r
        f_v = tau[1] - s * d_x + c * d_y - Y - (drag[1] + quadratic[1] * abs(v_r)) * v_r
        f_r = tau[2] + d_n - N - (drag[2] + quadratic[2] * abs(r)) * r
        a, b, e = self._inverse
        return (
            c * u - s * v,
            s * u + c * v,
            r,
            a[0] * f_u + a[1] * f_v + a[2] * f_r,
            b[0] * f_u + b[1] * f_v + b[2] * f_r,
            e[0] * f_u + e[1] * f_v + e[2] * f_r,
        )

    def _coriolis(self, u: float, v: float, r: float, u_r: float, v_r: float) -> Tau:
        """Return C_RB(nu) nu + C_A(nu_r) nu_r: moments of momentum turn with the vessel."""
        m, p = self.model.mass_kg, self.model
        rigid_x, rigid_y = m * (p.x_g_m * r + v), m * (p.y_g_m * r - u)
        water_u = p.added_surge_kg * u_r + p.added_surge_sway_kg * v_r
        water_v = p.added_surge_sway_kg * u_r + p.added_sway_kg * v_r
        return (
            -(rigid_x + water_v) * r,
            -(rigid_y - water_u) * r,
            rigid_x * u + rigid_y * v + water_v * u_r - water_u * v_r,
        )

    def step(
        self,
        state: State,
        dt_s: float,
        tau: Tau,
        current_m_s: tuple[float, float] = STILL_WATER,
        disturbance: Tau = UNDISTURBED,
    ) -> State:
        """Return the state dt_s later by one Runge-Kutta step with constant inputs; psi is not wrapped."""
        return rk4(self.derivative, state, dt_s, tau, current_m_s, disturbance)

    def kinetic_energy(self, state: State) -> float:
        """Return the kinetic energy in J, of the water that moves along included."""
        nu = np.array(state[3:])
        return float(0.5 * nu @ coupled_mass_matrix(self.model) @ nu)
