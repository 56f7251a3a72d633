"""Full model in six degrees of freedom: M nu' + C(nu) nu + D(nu) nu + g(eta) = tau + tau_E, thesis (2.14)-(2.26).

Corrected: see docs/errata.md ((2.15) entry (6,5), (2.20) entries (1,6), (3,4), (4,3), (2.23) entries (5,6), (6,5)):
the matrices are built from their block forms. eta = [x y z phi theta psi], nu = [u v w p q r], tau = [X Y Z K M N].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marine.frames import jacobian
from marine.vessel import SixDofModel

Array = NDArray[np.float64]


def skew(a: Array) -> Array:
    """Return S(a), 3 x 3, of S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def inertia_tensor(model: SixDofModel) -> Array:
    """Return I_0, 3 x 3, kg m^2, thesis (2.17)."""
    I_x, I_y, I_z, I_xy, I_xz, I_yz = model.inertia_kg_m2
    return np.array([[I_x, -I_xy, -I_xz], [-I_xy, I_y, -I_yz], [-I_xz, -I_yz, I_z]])


def rigid_body_matrix(model: SixDofModel) -> Array:
    """Return M_RB, 6 x 6, thesis (2.15)."""
    m, S = model.mass_kg, skew(np.array(model.r_g_m))
    return np.block([[m * np.eye(3), -m * S], [m * S, inertia_tensor(model)]])


def mass_matrix(model: SixDofModel) -> Array:
    """Return M = M_RB + M_A, 6 x 6, thesis (2.15), (2.22)."""
    return rigid_body_matrix(model) + np.diag(model.added)


def rigid_body_coriolis(model: SixDofModel, nu: Array) -> Array:
    """Return C_RB(nu), 6 x 6, thesis (2.20): skew-symmetric."""
    m, nu_1, nu_2 = model.mass_kg, nu[:3], nu[3:]
    r_g = np.array(model.r_g_m)
    S_1, S_rot = skew(nu_1), skew(skew(nu_2) @ r_g)
    upper = -m * S_1 - m * S_rot
    lower = m * skew(skew(nu_1) @ r_g) - skew(inertia_tensor(model) @ nu_2)
    return np.block([[np.zeros((3, 3)), upper], [upper, lower]])


def added_mass_coriolis(model: SixDofModel, nu: Array) -> Array:
    """Return C_A(nu), 6 x 6, thesis (2.23): skew-symmetric."""
    added = np.array(model.added)
    S_1, S_2 = skew(added[:3] * nu[:3]), skew(added[3:] * nu[3:])
    return np.block([[np.zeros((3, 3)), -S_1], [-S_1, -S_2]])


def damping(model: SixDofModel, nu: Array) -> Array:
    """Return D(nu) nu, 6, in N and Nm, thesis (2.24)."""
    force: Array = (np.array(model.drag) + np.array(model.drag_quadratic) * np.abs(nu)) * nu
    return force


def restoring(model: SixDofModel, eta: Array) -> Array:
    """Return g(eta), 6, in N and Nm, thesis (2.25)."""
    _, _, _, phi, theta, _ = eta
    W, B = model.weight_n, model.buoyancy_n
    x, y, z = np.array(model.r_g_m) * W - np.array(model.r_b_m) * B
    s, c = np.sin([phi, theta]), np.cos([phi, theta])
    s_phi, s_theta, c_phi, c_theta = s[0], s[1], c[0], c[1]
    return np.array(
        [
            (W - B) * s_theta,
            -(W - B) * c_theta * s_phi,
            -(W - B) * c_theta * c_phi,
            -y * c_theta * c_phi + z * c_theta * s_phi,
            z * s_theta + x * c_theta * c_phi,
            -x * c_theta * s_phi - y * s_theta,
        ]
    )


class SixDofDynamics:
    """thesis (2.26) with (2.13): the state is [eta nu], twelve values."""

    def __init__(self, model: SixDofModel) -> None:
        self.model = model
        self.M = mass_matrix(model)
        self._inverse = np.linalg.inv(self.M)  # constant; scipy.linalg would cost every process 20 MB

    def acceleration(self, eta: Array, nu: Array, tau: Array, current: Array | None = None) -> Array:
        """Return nu', 6, in m/s^2 and rad/s^2. tau: actuators and environment; current: water's velocity in {E}, 3.

        Drag and the added mass' Coriolis forces act on the velocity relative to a current that does not turn.
        """
        m = self.model
        nu_r = nu.copy()
        if current is not None:
            nu_r[:3] -= jacobian(eta)[:3, :3].T @ current
        forces = tau - rigid_body_coriolis(m, nu) @ nu - added_mass_coriolis(m, nu_r) @ nu_r - damping(m, nu_r)
        solved: Array = self._inverse @ (forces - restoring(m, eta))
        return solved

    def derivative(self, state: Array, tau: Array, current: Array | None = None) -> Array:
        """Return the time derivative of [eta nu], 12."""
        eta, nu = state[:6], state[6:]
        return np.concatenate([jacobian(eta) @ nu, self.acceleration(eta, nu, tau, current)])

    def step(self, state: Array, dt_s: float, tau: Array, current: Array | None = None) -> Array:
        """Return the state dt_s later by one Runge-Kutta step with constant inputs; angles are not wrapped."""
        h = 0.5 * dt_s
        a = self.derivative(state, tau, current)
        b = self.derivative(state + h * a, tau, current)
        c = self.derivative(state + h * b, tau, current)
        d = self.derivative(state + dt_s * c, tau, current)
        return state + dt_s / 6.0 * (a + 2.0 * (b + c) + d)

    def energy(self, state: Array) -> float:
        """Return kinetic energy (of the water that moves along, too) and energy of weight and buoyancy, in J."""
        eta, nu = state[:6], state[6:]
        m = self.model
        down = jacobian(eta)[2, :3]  # {E} z of the axes of {B}
        lift = m.weight_n * (eta[2] + down @ np.array(m.r_g_m)) - m.buoyancy_n * (eta[2] + down @ np.array(m.r_b_m))
        return float(0.5 * nu @ self.M @ nu - lift)
