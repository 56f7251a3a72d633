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


def to_tank(x_b: float, y_b: float, psi_rad: float) -> tuple[float, float]:
    """Return the {E} components of a vector given in {B}, thesis (2.27), pladypos (4)."""
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return c * x_b - s * y_b, s * x_b + c * y_b


def to_body(x_e: float, y_e: float, psi_rad: float) -> tuple[float, float]:
    """Return the {B} components of a vector given in {E}: the inverse of `to_tank`."""
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return c * x_e + s * y_e, -s * x_e + c * y_e


def rotation(psi_rad: float) -> NDArray[np.float64]:
    """Return R(psi), 3 x 3, of eta' = R(psi) nu with eta = [x y psi] and nu = [u v r], thesis (2.27)."""
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
