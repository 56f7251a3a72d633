"""Line-of-sight guidance with integral action: the heading that leads onto a line and keeps there in a current."""

from __future__ import annotations

import math


class LineOfSight:
    """psi = gamma - atan((d + sigma y) / Delta), y' = Delta d / ((d + sigma y)^2 + Delta^2).

    Integral line of sight: E. Borhaug, A. Pavlov, K. Y. Pettersen, CDC 2008, (7). d: distance from the line, positive
    to starboard, m. Far away the integral stands still, so that it does not wind up on the approach.
    """

    def __init__(self, lookahead_m: float, sigma_m_s: float) -> None:
        """lookahead_m: Delta; sigma_m_s: gain of the integral. Raise ValueError unless Delta > 0 and sigma >= 0."""
        if not (lookahead_m > 0.0 and sigma_m_s >= 0.0):
            raise ValueError(f"line of sight needs Delta > 0 and sigma >= 0, not {lookahead_m}, {sigma_m_s}")
        self.lookahead_m, self.sigma_m_s = lookahead_m, sigma_m_s
        self._integral = 0.0

    def reset(self) -> None:
        """Forget the current: for a line in another direction."""
        self._integral = 0.0

    def heading(self, dt_s: float, d_m: float) -> float:
        """Return the wanted heading relative to the line in rad, within +-pi/2."""
        ahead, aside = self.lookahead_m, d_m + self.sigma_m_s * self._integral
        self._integral += dt_s * ahead * d_m / (aside * aside + ahead * ahead)
        return -math.atan2(d_m + self.sigma_m_s * self._integral, ahead)
