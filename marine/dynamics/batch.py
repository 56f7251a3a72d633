"""Many vessels at once: the uncoupled model over arrays, for parameter sweeps and Monte Carlo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marine.vessel import HorizontalModel

Array = NDArray[np.float64]


class UncoupledBatch:
    """`UncoupledModel` for n vessels, each with parameters of its own: thesis (2.29)-(2.33), (2.27).

    States are 6 x n, [x y psi] in {E} and [u v r] in {B}; wrenches [X Y N] are 3 x n or 3 x 1.
    """

    def __init__(self, models: Sequence[HorizontalModel]) -> None:
        dofs = [[m.surge, m.sway, m.yaw] for m in models]
        self._inverse = np.array([[1.0 / d.alpha for d in row] for row in dofs]).T
        self._beta = np.array([[d.beta for d in row] for row in dofs]).T
        self._quadratic = np.array([[d.beta_quadratic for d in row] for row in dofs]).T

    def derivative(self, state: Array, tau: Array, current_m_s: Array | None = None) -> Array:
        """Return the time derivative, 6 x n; current_m_s: [c_x c_y] in {E}, 2 x n or 2 x 1."""
        out = np.empty_like(state)
        c, s = np.cos(state[2]), np.sin(state[2])
        u, v, nu = state[3], state[4], state[3:]
        out[0] = c * u - s * v
        out[1] = s * u + c * v
        out[2] = state[5]
        if current_m_s is not None:
            nu = nu.copy()
            nu[0] -= c * current_m_s[0] + s * current_m_s[1]
            nu[1] -= c * current_m_s[1] - s * current_m_s[0]
        drag = np.abs(nu)
        drag *= self._quadratic
        drag += self._beta
        drag *= nu
        np.subtract(tau, drag, out=out[3:])
        out[3:] *= self._inverse
        return out

    def step(self, state: Array, dt_s: float, tau: Array, current_m_s: Array | None = None) -> Array:
        """Return the states dt_s later, 6 x n, by one Runge-Kutta step with constant inputs; psi is not wrapped."""
        h = 0.5 * dt_s
        a = self.derivative(state, tau, current_m_s)
        b = self.derivative(state + h * a, tau, current_m_s)
        c = self.derivative(state + h * b, tau, current_m_s)
        d = self.derivative(state + dt_s * c, tau, current_m_s)
        b += c
        b *= 2.0
        b += a
        b += d
        b *= dt_s / 6.0
        b += state
        return b
