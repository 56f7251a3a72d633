"""Uncoupled model of surge, sway and yaw in a current."""

from __future__ import annotations

import math

from marine.dynamics.integrate import State
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
        surge, sway, yaw = model.surge, model.sway, model.yaw
        self._level = (
            *(surge.beta, surge.beta_quadratic, 1.0 / surge.alpha),
            *(sway.beta, sway.beta_quadratic, 1.0 / sway.alpha),
        )
        self._yaw = (yaw.beta, yaw.beta_quadratic, 1.0 / yaw.alpha)

    def derivative(
        self,
        state: State,
        tau: Tau,
        current_m_s: tuple[float, float] = STILL_WATER,
        disturbance: Tau = UNDISTURBED,
    ) -> State:
        """Return the time derivative of a state under the wrench tau; current and disturbance are given in {E}."""
        _, _, psi, u, v, r = state
        x_rate, y_rate, u_rate, v_rate = self._level_rates(psi, u, v, tau, current_m_s, disturbance)
        return x_rate, y_rate, r, u_rate, v_rate, self._yaw_rate(r, tau[2] + disturbance[2])

    def _yaw_rate(self, r: float, N: float) -> float:
        """Return r'."""
        b_r, b_rr, w_r = self._yaw
        return w_r * (N - (b_r + b_rr * abs(r)) * r)

    def _level_rates(  # noqa: PLR0917 - the innermost of simulator and filter
        self, psi: float, u: float, v: float, tau: Tau, current_m_s: tuple[float, float], disturbance: Tau
    ) -> tuple[float, float, float, float]:
        """Return x', y', u', v'."""
        c, s = math.cos(psi), math.sin(psi)
        X, Y, _ = tau
        c_x, c_y = current_m_s
        d_x, d_y, _ = disturbance
        u_r, v_r = u, v
        if c_x or c_y:
            u_r, v_r = u - c * c_x - s * c_y, v + s * c_x - c * c_y
        if d_x or d_y:
            X, Y = X + c * d_x + s * d_y, Y - s * d_x + c * d_y
        b_u, b_uu, w_u, b_v, b_vv, w_v = self._level
        return (
            c * u - s * v,
            s * u + c * v,
            w_u * (X - (b_u + b_uu * abs(u_r)) * u_r),
            w_v * (Y - (b_v + b_vv * abs(v_r)) * v_r),
        )

    def step(
        self,
        state: State,
        dt_s: float,
        tau: Tau,
        current_m_s: tuple[float, float] = STILL_WATER,
        disturbance: Tau = UNDISTURBED,
    ) -> State:
        """Return the state dt_s later by one Runge-Kutta step with constant inputs; psi is not wrapped.

        What `rk4` gives of `derivative`, bit by bit, for less: nothing feels the position, and yaw feels only itself.
        """
        x, y, psi, u, v, r = state
        h, w = 0.5 * dt_s, dt_s / 6.0
        rates, yaw_rate, N = self._level_rates, self._yaw_rate, tau[2] + disturbance[2]
        r_1 = yaw_rate(r, N)
        r_2 = yaw_rate(r_b := r + h * r_1, N)
        r_3 = yaw_rate(r_c := r + h * r_2, N)
        r_4 = yaw_rate(r_d := r + dt_s * r_3, N)
        x_1, y_1, u_1, v_1 = rates(psi, u, v, tau, current_m_s, disturbance)
        x_2, y_2, u_2, v_2 = rates(psi + h * r, u + h * u_1, v + h * v_1, tau, current_m_s, disturbance)
        x_3, y_3, u_3, v_3 = rates(psi + h * r_b, u + h * u_2, v + h * v_2, tau, current_m_s, disturbance)
        x_4, y_4, u_4, v_4 = rates(psi + dt_s * r_c, u + dt_s * u_3, v + dt_s * v_3, tau, current_m_s, disturbance)
        return (
            x + w * (x_1 + 2.0 * (x_2 + x_3) + x_4),
            y + w * (y_1 + 2.0 * (y_2 + y_3) + y_4),
            psi + w * (r + 2.0 * (r_b + r_c) + r_d),
            u + w * (u_1 + 2.0 * (u_2 + u_3) + u_4),
            v + w * (v_1 + 2.0 * (v_2 + v_3) + v_4),
            r + w * (r_1 + 2.0 * (r_2 + r_3) + r_4),
        )

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
