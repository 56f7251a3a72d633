"""Fixed-step integration of small systems as tuples of floats: numpy costs more than the arithmetic of six states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

State = tuple[float, float, float, float, float, float]
"""[x y psi] in {E} (m, rad) and [u v r] in {B} (m/s, rad/s)."""


def rk4(derivative: Callable[..., State], state: State, dt_s: float, *inputs: Any) -> State:
    """Return the state dt_s later by one classical Runge-Kutta step; the angle is not wrapped.

    derivative(state, *inputs): the inputs stay as they are during the step.
    """
    x, y, psi, u, v, r = state
    h = 0.5 * dt_s
    a_x, a_y, a_psi, a_u, a_v, a_r = derivative(state, *inputs)
    middle = (x + h * a_x, y + h * a_y, psi + h * a_psi, u + h * a_u, v + h * a_v, r + h * a_r)
    b_x, b_y, b_psi, b_u, b_v, b_r = derivative(middle, *inputs)
    middle = (x + h * b_x, y + h * b_y, psi + h * b_psi, u + h * b_u, v + h * b_v, r + h * b_r)
    c_x, c_y, c_psi, c_u, c_v, c_r = derivative(middle, *inputs)
    end = (x + dt_s * c_x, y + dt_s * c_y, psi + dt_s * c_psi, u + dt_s * c_u, v + dt_s * c_v, r + dt_s * c_r)
    d_x, d_y, d_psi, d_u, d_v, d_r = derivative(end, *inputs)
    w = dt_s / 6.0
    return (
        x + w * (a_x + 2.0 * (b_x + c_x) + d_x),
        y + w * (a_y + 2.0 * (b_y + c_y) + d_y),
        psi + w * (a_psi + 2.0 * (b_psi + c_psi) + d_psi),
        u + w * (a_u + 2.0 * (b_u + c_u) + d_u),
        v + w * (a_v + 2.0 * (b_v + c_v) + d_v),
        r + w * (a_r + 2.0 * (b_r + c_r) + d_r),
    )
