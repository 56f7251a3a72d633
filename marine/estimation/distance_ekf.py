"""Extended Kalman filter of a vessel before a wall, thesis 2.6 and 8.2.1, from sensors of different rates.

State [u r phi psi d v_phi v_d]: surge speed, yaw rate, angle to the wall's normal, compass heading, distance, and the
disturbances of angle and distance. (8.34), (8.38), (8.40) and Table 8.2 corrected: see docs/errata.md. There is one
v_phi, in phi and psi alike, and a measurement that is missing has no row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom

Array = NDArray[np.float64]

PRINTED_STEP_S = 0.1
"""Step for which the thesis prints Q: control at 10 Hz."""
_DEGREE = math.radians(1.0)
_CM = 0.01
_UNITS = (_CM, _DEGREE, _DEGREE, _DEGREE, _CM, _DEGREE, _CM)


@dataclass(frozen=True)
class DistanceTuning:
    """Q, P0 and R of thesis 8.2.1, the defaults as printed; in degrees and centimetres, as its experiments are.

    process: variance that each of the seven states gains in 0.1 s; initial: of each when nobody has measured;
    angle_deg2, heading_deg2, distance_cm2: of the measurements.
    """

    process: tuple[float, float, float, float, float, float, float] = (0.1,) * 7
    initial: tuple[float, float, float, float, float, float, float] = (1000.0,) * 7
    angle_deg2: float = 0.5
    heading_deg2: float = 10.0
    distance_cm2: float = 0.1
    initial_force_n2: float = 0.0
    force_n2: float = 0.0
    """Of an eighth state that Table 8.2 does not have, a force along surge: P0, and the variance gained in 0.1 s."""


STEADY = DistanceTuning(
    process=(9e-4, 0.1, 1e-3, 1e-3, 5e-5, 1e-4, 2e-4),
    initial=(100.0, 100.0, 1000.0, 4e4, 1000.0, 10.0, 10.0),
    angle_deg2=1.0,
    heading_deg2=1.0,
    distance_cm2=0.25,
    initial_force_n2=0.04,
    force_n2=6e-8,
)
"""For slow disturbances, currents and forces (a tether), and a laser of 5 mm: predicts seconds without measurements
better than the printed values, which believe each measurement almost alone. Chosen, by trial. The printed P0 would let
the first samples be explained by speeds of 30 cm/s and more, and with slow walks it takes a minute to forget them."""


class DistanceEkf:
    """The filter at one moment, in SI: `state` is [u r phi psi d v_phi v_d], `covariance` (7, 7) its covariance."""

    def __init__(self, surge: DegreeOfFreedom, yaw: DegreeOfFreedom, tuning: DistanceTuning = DistanceTuning()) -> None:
        """Begin with nothing known: the first measurements decide."""
        self._surge, self._yaw = surge, yaw
        squared = np.square(_UNITS)
        force = [tuning.initial_force_n2] if tuning.initial_force_n2 else []
        self.state: Array = np.zeros(7 + len(force))
        self.covariance: Array = np.diag([*(np.array(tuning.initial) * squared), *force])
        walks = [*(np.array(tuning.process) * squared), *([tuning.force_n2] if force else [])]
        self._process = np.diag(walks) / PRINTED_STEP_S
        noise = (tuning.angle_deg2 * _DEGREE**2, tuning.heading_deg2 * _DEGREE**2, tuning.distance_cm2 * _CM**2)
        self._noise = np.array(noise)

    @property
    def surge_m_s(self) -> float:
        """Estimated u."""
        return float(self.state[0])

    @property
    def yaw_rate_rad_s(self) -> float:
        """Estimated r."""
        return float(self.state[1])

    @property
    def angle_rad(self) -> float:
        """Estimated phi: zero when the vessel faces the wall."""
        return float(self.state[2])

    @property
    def distance_m(self) -> float:
        """Estimated d."""
        return float(self.state[4])

    def predict(self, dt_s: float, X: float, N: float) -> None:
        """Go forward by dt_s (some 0.1 s) with surge force X in N and yaw moment N in Nm; Table 8.2, (8.38)."""
        u, r, phi, psi, d, v_phi, v_d, *force = self.state.tolist()
        cos, sin = math.cos(phi), math.sin(phi)
        surge, yaw = self._surge, self._yaw
        A = np.eye(len(self.state))
        A[0, 0] -= dt_s * (surge.beta + 2.0 * surge.beta_quadratic * abs(u)) / surge.alpha
        A[1, 1] -= dt_s * (yaw.beta + 2.0 * yaw.beta_quadratic * abs(r)) / yaw.alpha
        A[2, 1] = A[2, 5] = A[3, 1] = A[3, 5] = A[4, 6] = dt_s
        if force:
            A[0, 7] = dt_s / surge.alpha
        A[4, 0] = -dt_s * cos
        A[4, 2] = dt_s * u * sin
        self.state = np.array(
            [
                u + dt_s * (X + sum(force) - surge.drag(u)) / surge.alpha,
                r + dt_s * (N - yaw.drag(r)) / yaw.alpha,
                wrap_angle(phi + dt_s * (r + v_phi)),
                wrap_angle(psi + dt_s * (r + v_phi)),
                d + dt_s * (v_d - u * cos),
                v_phi,
                v_d,
                *force,
            ]
        )
        self.covariance = A @ self.covariance @ A.T + dt_s * self._process

    def update(
        self, *, psi_rad: float | None = None, phi_rad: float | None = None, distance_m: float | None = None
    ) -> None:
        """Take in what was measured at the filter's time; None or what is no number is missing. Table 8.2."""
        measured = ((2, phi_rad, 0), (3, psi_rad, 1), (4, distance_m, 2))
        present = [(row, y, kind) for row, y, kind in measured if y is not None and math.isfinite(y)]
        if not present:
            return
        rows = [row for row, _, _ in present]
        innovation = np.array(
            [y - self.state[row] if row == 4 else wrap_angle(y - float(self.state[row])) for row, y, _ in present]
        )
        P = self.covariance
        PH = P[:, rows]
        S = PH[rows] + np.diag(self._noise[[kind for _, _, kind in present]])
        K = np.linalg.solve(S, PH.T).T
        self.state = self.state + K @ innovation
        self.state[2:4] = [wrap_angle(angle) for angle in self.state[2:4].tolist()]
        P = P - K @ PH.T
        self.covariance = 0.5 * (P + P.T)
