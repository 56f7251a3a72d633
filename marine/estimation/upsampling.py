"""Kalman up-sampling of a slow sensor with the model of one degree of freedom, thesis 3.3 (Charlie: 0.5 s to 10 Hz)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UpsamplingTuning:
    """Standard deviations: of a measurement (m or rad); per root second: of unmodelled force, of the disturbance.

    Forces in N or Nm. `angle`: the measured position is an angle and wraps.
    """

    measurement: float
    force: float
    disturbance: float
    angle: bool = True


class Upsampler:
    """Kalman filter of eta' = nu, alpha nu' + beta(nu) nu = tau + Delta, Delta' = 0: thesis (3.6), (2.33).

    `step` runs at the fast rate; a measurement is given when there is one. Linear drag is linearised at the estimate.
    """

    def __init__(self, dof: DegreeOfFreedom, tuning: UpsamplingTuning, period_s: float, eta_0: float) -> None:
        """Start at rest at the first measurement eta_0, m or rad; period_s: of `step`."""
        self._dof = dof
        self._tuning = tuning
        self._period_s = period_s
        self.state: Array = np.array([eta_0, 0.0, 0.0])
        """[eta nu Delta]: m or rad, m/s or rad/s, N or Nm."""
        fastest = 1.0  # m/s or rad/s: the first speed is unknown up to about this
        self.covariance: Array = np.diag([tuning.measurement**2, fastest**2, (fastest * _slope(dof, fastest)) ** 2])

    def step(self, tau: float, measurement: float | None = None) -> tuple[float, float]:
        """Go one period on with the force tau (N or Nm), then take the measurement; return eta and nu."""
        self._predict(tau)
        if measurement is not None:
            self._correct(measurement)
        return float(self.state[0]), float(self.state[1])

    def _predict(self, tau: float) -> None:
        dof, dt, (eta, nu, delta) = self._dof, self._period_s, self.state
        slope = _slope(dof, nu)
        push = tau + slope * nu - dof.drag(nu)  # what is left of drag after linearisation acts like a force
        A = np.zeros((4, 4))  # eta, nu, Delta, constant
        A[0, 1] = 1.0
        A[1] = [0.0, -slope / dof.alpha, 1.0 / dof.alpha, push / dof.alpha]
        transition = expm(A * dt)
        self.state = (transition @ [eta, nu, delta, 1.0])[:3]
        F = transition[:3, :3]
        if self._tuning.angle:
            self.state[0] = wrap_angle(self.state[0])
        noise = np.diag([0.0, (self._tuning.force / dof.alpha) ** 2, self._tuning.disturbance**2])
        half = expm(A[:3, :3] * dt / 2.0)
        Q = dt / 6.0 * (noise + 4.0 * half @ noise @ half.T + F @ noise @ F.T)  # Simpson's rule of the integral
        self.covariance = F @ self.covariance @ F.T + Q

    def _correct(self, measurement: float) -> None:
        innovation = measurement - self.state[0]
        if self._tuning.angle:
            innovation = wrap_angle(innovation)
        P = self.covariance
        variance = P[0, 0] + self._tuning.measurement**2
        gain = P[:, 0] / variance
        self.state = self.state + gain * innovation
        if self._tuning.angle:
            self.state[0] = wrap_angle(self.state[0])
        keep = np.eye(3)
        keep[:, 0] -= gain
        self.covariance = keep @ P @ keep.T + np.outer(gain, gain) * self._tuning.measurement**2


def _slope(dof: DegreeOfFreedom, nu: float) -> float:
    """Return d(drag)/d nu."""
    return dof.beta + 2.0 * dof.beta_quadratic * math.fabs(nu)
