"""Nonlinear passive observer of pose, velocity and disturbance, beside the EKF.

Fossen, Strand: Passive nonlinear observer design for ships using Lyapunov methods, Automatica 35 (1999), without the
wave model (there are none in the pool). The gains are constant, so it costs a third of the EKF, but it has no gate for
wrong measurements and no covariance.
"""

from __future__ import annotations

import math

from marine.control.model_function import bessel
from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import Tau, UncoupledModel
from marine.frames import to_body, wrap_angle
from marine.vessel import HorizontalModel


class PassiveObserver:
    """eta' = R nu + K_2 e, b' = K_3 e, M nu' = -D(nu) nu + tau + R^T (b + K_4 e) with e = eta_measured - eta.

    Each error has the characteristic polynomial of Bessel's filter at w0, for a vessel without drag, whatever psi:
    K_2 = a2/a3, K_4 = (a1/a3) M, K_3 = M/a3. Drag damps it further. x and y have one inertia in the gains, the mean, so
    that they do not turn with the vessel. A measurement acts when it comes, for the time since the one before.
    """

    def __init__(self, model: HorizontalModel, w0_rad_s: float, x_m: float, y_m: float, psi_rad: float) -> None:
        """Begin at rest at a measured pose; w0_rad_s: bandwidth, to be well below the measurement's rate."""
        self.state: State = (x_m, y_m, wrap_angle(psi_rad), 0.0, 0.0, 0.0)
        self.disturbance: Tau = (0.0, 0.0, 0.0)
        """[N N Nm] in {E}."""
        self._a1, self._a2, self._a3 = bessel(3, w0_rad_s)
        self._model = model
        self._mass = math.sqrt(model.surge.alpha * model.sway.alpha)
        self._dynamics = UncoupledModel(model)
        self._since_s = 0.0

    def predict(self, dt_s: float, tau: Tau) -> None:
        """Go forward by dt_s (at most some 0.1 s) with the wrench tau in {B}."""
        x, y, psi, u, v, r = self._dynamics.step(self.state, dt_s, tau, disturbance=self.disturbance)
        self.state = (x, y, wrap_angle(psi), u, v, r)
        self._since_s += dt_s

    def update(self, x_m: float, y_m: float, psi_rad: float) -> None:
        """Take in a pose measured at the observer's time."""
        x, y, psi, u, v, r = self.state
        e_x, e_y, e_psi = x_m - x, y_m - y, wrap_angle(psi_rad - psi)
        dt_s, self._since_s = min(self._since_s, 0.5 * self._a3 / self._a2), 0.0
        pose, velocity, force = dt_s * self._a2 / self._a3, dt_s * self._a1 / self._a3, dt_s / self._a3
        forward, starboard = to_body(e_x, e_y, psi)
        surge, sway, yaw = self._model.surge.alpha, self._model.sway.alpha, self._model.yaw.alpha
        self.state = (
            x + pose * e_x,
            y + pose * e_y,
            wrap_angle(psi + pose * e_psi),
            u + velocity * forward * self._mass / surge,
            v + velocity * starboard * self._mass / sway,
            r + velocity * e_psi,
        )
        d_x, d_y, d_n = self.disturbance
        self.disturbance = (d_x + force * self._mass * e_x, d_y + force * self._mass * e_y, d_n + force * yaw * e_psi)
