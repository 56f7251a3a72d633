"""Fixed-step integration of small systems as tuples of floats: numpy costs more than the arithmetic of six states."""

from __future__ import annotations

from collections.abc import Callable

State = tuple[float, float, float, float, float, float]
"""[x y psi] in {E} (m, rad) and [u v r] in {B} (m/s, rad/s)."""


def rk4(derivative: Callable[[State], State], state: State, dt_s: float) -> State:
    """Return the state dt_s later by one classical Runge-Kutta step; the angle is not wrapped."""
    x, y, psi, u, v, r = state
    h = 0.5 * dt_s
    a = derivative(state)
    b = derivative((x + h * a[0], y + h * a[1], psi + h * a[2], u + h * a[3], v + h * a[4], r + h * a[5]))
    c = derivative((x + h * b[0], y + h * b[1], psi + h * b[2], u + h * b[3], v + h * b[4], r + h * b[5]))
    d = derivative(
        (x + dt_s * c[0], y + dt_s * c[1], psi + dt_s * c[2], u + dt_s * c[3], v + dt_s * c[4], r + dt_s * c[5])
    )
    w = dt_s / 6.0
    return (
        x + w * (a[0] + 2.0 * (b[0] + c[0]) + d[0]),
        y + w * (a[1] + 2.0 * (b[1] + c[1]) + d[1]),
        psi + w * (a[2] + 2.0 * (b[2] + c[2]) + d[2]),
        u + w * (a[3] + 2.0 * (b[3] + c[3]) + d[3]),
        v + w * (a[4] + 2.0 * (b[4] + c[4]) + d[4]),
        r + w * (a[5] + 2.0 * (b[5] + c[5]) + d[5]),
    )
