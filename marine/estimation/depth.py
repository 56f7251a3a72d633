"""Kalman filter of depth, heave speed and the force that pulls up or down, from a depth sensor."""

from __future__ import annotations

import math

import numpy as np

from marine.vessel import DegreeOfFreedom, Sensor


class DepthFilter:
    """State [z w d]: z' = w, alpha w' = Z + d - drag(w), thesis (2.31), (2.33); d, a random walk, holds net weight.

    The drag is linearised where the filter is. Measurements come late: the filter stays at the last one, `predicted`
    looks ahead from there.
    """

    def __init__(self, heave: DegreeOfFreedom, sensor: Sensor, z_m: float, force_n: float) -> None:
        """force_n: largest force of the actuators; the walk of d within a second is a twentieth of it."""
        self._heave = heave
        self._R = max(1e-6, sensor.noise**2 + sensor.quantisation**2 / 12.0)
        self._Q = np.diag([0.0, 1e-4, (0.05 * force_n) ** 2])
        self._x = np.array([z_m, 0.0, 0.0])
        self._P = np.diag([self._R, 0.01, force_n**2])

    def update(self, dt_s: float, Z: float, z_m: float) -> None:
        """Take in a depth measured dt_s after the one before, with the force Z in N between."""
        F = self._jacobian(dt_s)
        self._x = self._moved(dt_s, Z)
        P = F @ self._P @ F.T + self._Q * dt_s
        K = P[:, 0] / (P[0, 0] + self._R)
        self._x = self._x + K * (z_m - self._x[0])
        self._P = P - np.outer(K, P[0, :])

    def predicted(self, dt_s: float, Z: float) -> tuple[float, float]:
        """Return depth in m and heave speed in m/s dt_s after the last measurement."""
        z, w, _ = self._moved(dt_s, Z).tolist()
        return z, w

    def _jacobian(self, dt_s: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        heave, w = self._heave, float(self._x[1])
        rate = (heave.beta + 2.0 * heave.beta_quadratic * abs(w)) / heave.alpha
        left = math.exp(-rate * dt_s)
        return np.array([[1.0, dt_s, 0.0], [0.0, left, dt_s / heave.alpha], [0.0, 0.0, 1.0]])

    def _moved(self, dt_s: float, Z: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        z, w, d = self._x.tolist()
        steps = max(1, math.ceil(dt_s / 0.05))
        h = dt_s / steps
        for _ in range(steps):
            before = w
            w += h * (Z + d - self._heave.drag(w)) / self._heave.alpha
            z += h * 0.5 * (before + w)
        return np.array([z, w, d])
