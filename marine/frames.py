"""Rotations between {E} (tank: x right, y down in the picture) and {B} (body: x forward, y starboard); angles.

Vectors of two or three are plain floats here: numpy costs more than the arithmetic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def wrap_angle(angle_rad: float) -> float:
    """Return an angle in rad brought into (-pi, pi]."""
    if -math.pi < angle_rad <= math.pi:
        return angle_rad
    wrapped = math.remainder(angle_rad, 2.0 * math.pi)
    return wrapped if wrapped > -math.pi else math.pi


def rotated(x: float, y: float, c: float, s: float) -> tuple[float, float]:
    """Return a vector rotated by the angle of cosine c and sine s, where several are: `to_tank`, `to_body` with -s."""
    return c * x - s * y, s * x + c * y


def to_tank(x_b: float, y_b: float, psi_rad: float) -> tuple[float, float]:
    """Return the {E} components of a vector given in {B}, thesis (2.27), pladypos (4)."""
    return rotated(x_b, y_b, math.cos(psi_rad), math.sin(psi_rad))


def to_body(x_e: float, y_e: float, psi_rad: float) -> tuple[float, float]:
    """Return the {B} components of a vector given in {E}: the inverse of `to_tank`."""
    return rotated(x_e, y_e, math.cos(psi_rad), -math.sin(psi_rad))


def rotation(psi_rad: float) -> NDArray[np.float64]:
    """Return R(psi), 3 x 3, of eta' = R(psi) nu with eta = [x y psi] and nu = [u v r], thesis (2.27)."""
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_zyx(phi_rad: float, theta_rad: float, psi_rad: float) -> NDArray[np.float64]:
    """Return J_1, 3 x 3: from {B} to {E} by yaw, pitch, roll, thesis (2.13)."""
    s_phi, c_phi = math.sin(phi_rad), math.cos(phi_rad)
    s_theta, c_theta = math.sin(theta_rad), math.cos(theta_rad)
    s_psi, c_psi = math.sin(psi_rad), math.cos(psi_rad)
    return np.array(
        [
            [c_psi * c_theta, -s_psi * c_phi + c_psi * s_theta * s_phi, s_psi * s_phi + c_psi * s_theta * c_phi],
            [s_psi * c_theta, c_psi * c_phi + s_psi * s_theta * s_phi, -c_psi * s_phi + s_psi * s_theta * c_phi],
            [-s_theta, c_theta * s_phi, c_theta * c_phi],
        ]
    )


def euler_rates(phi_rad: float, theta_rad: float) -> NDArray[np.float64]:
    """Return J_2, 3 x 3: from [p q r] to the rates of [phi theta psi]; thesis (2.13), corrected: see docs/errata.md.

    Raise ValueError at theta = +-pi/2, where roll and yaw are the same.
    """
    s, c = math.sin(phi_rad), math.cos(phi_rad)
    c_theta = math.cos(theta_rad)
    if abs(c_theta) < 1e-9:
        raise ValueError(f"pitch {theta_rad} rad: no Euler rates at +-90 degrees")
    t = math.tan(theta_rad)
    return np.array([[1.0, s * t, c * t], [0.0, c, -s], [0.0, s / c_theta, c / c_theta]])


def jacobian(eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return J(eta), 6 x 6, of eta' = J(eta) nu, thesis (2.13); eta = [x y z phi theta psi]."""
    J = np.zeros((6, 6))
    J[:3, :3] = rotation_zyx(*eta[3:])
    J[3:, 3:] = euler_rates(eta[3], eta[4])
    return J


def body_velocities(eta_dot: NDArray[np.float64], eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return nu, 6, of measured rates of eta: the inverse of (2.13), thesis Algorithm 3.2 VI."""
    R = rotation_zyx(*eta[3:])
    return np.concatenate([R.T @ eta_dot[:3], np.linalg.solve(euler_rates(eta[3], eta[4]), eta_dot[3:])])
