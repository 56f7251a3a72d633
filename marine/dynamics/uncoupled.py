"""Uncoupled model of surge, sway and yaw in a current."""

from __future__ import annotations

import math

from marine.dynamics.integrate import State, rk4
from marine.vessel import HorizontalModel

Tau = tuple[float, float, float]
"""Wrench [X Y N] in {B}: N, N, Nm."""

STILL_WATER = (0.0, 0.0)
UNDISTURBED = (0.0, 0.0, 0.0)


class UncoupledModel:
    """alpha nu' + beta(nu_r) nu_r = Delta + tau for each of u, v, r, thesis (2.33), with eta' = R(psi) nu (2.27).

    nu_r is the velocity relative to the water, nu_r = nu - R^T(psi) [c_x c_y 0]: the drag of thesis (2.29), (2.30) acts
    on it, so that a current pushes. Delta is a disturbance given in {E} ([N N Nm]). Drag is the sum of both forms
    of (2.34). As in thesis 2.4, Coriolis terms and the inertia of the moving water are left out.
    """

    def __init__(self, model: HorizontalModel) -> None:
        self.model = model
        self._surge = (model.surge.beta, model.surge.beta_quadratic, 1.0 / model.surge.alpha)
        self._sway = (model.sway.beta, model.sway.beta_quadratic, 1.0 / model.sway.alpha)
        self._yaw = (model.yaw.beta, model.yaw.beta_quadratic, 1.0 / model.yaw.alpha)

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
        c_x, c_y = current_m_s
        d_x, d_y, d_n = disturbance
        u_r = u - c * c_x - s * c_y
        v_r = v + s * c_x - c * c_y
        b_u, b_uu, w_u = self._surge
        b_v, b_vv, w_v = self._sway
        b_r, b_rr, w_r = self._yaw
        return (
            c * u - s * v,
            s * u + c * v,
            r,
            w_u * (tau[0] + c * d_x + s * d_y - (b_u + b_uu * abs(u_r)) * u_r),
            w_v * (tau[1] - s * d_x + c * d_y - (b_v + b_vv * abs(v_r)) * v_r),
            w_r * (tau[2] + d_n - (b_r + b_rr * abs(r)) * r),
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

    def heave_acceleration(self, w_m_s: float, Z_n: float, disturbance_n: float = 0.0) -> float:
        """Return w' in m/s^2, thesis (2.31) with W - B; raise ValueError for a vessel that does not dive."""
        heave = self.model.heave
        if heave is None:
            raise ValueError("the vessel has no heave")
        return (Z_n + disturbance_n + self.model.net_weight_n - heave.drag(w_m_s)) / heave.alpha

    def kinetic_energy(self, state: State) -> float:
        """Return the kinetic energy in J, of the water that moves along included."""
        _, _, _, u, v, r = state
        m = self.model
        return 0.5 * (m.surge.alpha * u * u + m.sway.alpha * v * v + m.yaw.alpha * r * r)
