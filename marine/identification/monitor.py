"""Monitoring of a running self-oscillation: half periods, extrema, the last n oscillations; thesis 6.7, Fig. 6.11."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from marine.identification.oscillation import SPREAD


@dataclass(frozen=True)
class Swing:
    """One whole oscillation: amplitude X_m, bias x_0 (m or rad), both extrema, period in s."""

    X_m: float
    x_0: float
    top: float
    bottom: float
    period_s: float


class OscillationMonitor:
    """Half periods, extrema and the last n oscillations (a ring, first in first out), thesis 6.7 and Fig. 6.11.

    The first swing after the start, or after a broken one, is a transient and never counts.
    """

    def __init__(self, x_a: float, count: int, spread: float = SPREAD) -> None:
        self.x_a, self.count, self.limit = x_a, count, spread
        self.swings: deque[Swing] = deque(maxlen=count)
        self.whole = 0
        """Whole oscillations since the start."""
        self.halves: list[float] = []
        """Durations of half periods in s."""
        self.advice = ""
        self._extrema: deque[float] = deque(maxlen=2)
        self._since_s = 0.0
        self._extreme: float | None = None
        self._side = 1
        self._switches = 0

    @property
    def consecutive(self) -> int:
        """Oscillations in a row that agree within the spread."""
        return len(self.swings)

    @property
    def spread(self) -> float | None:
        """Largest deviation of the extrema from their mean, as a part of the amplitude."""
        if len(self.swings) < 2:
            return None
        mean = sum(s.X_m for s in self.swings) / len(self.swings)
        worst = 0.0
        for values in ([s.top for s in self.swings], [s.bottom for s in self.swings]):
            middle = sum(values) / len(values)
            worst = max(worst, *(abs(v - middle) for v in values))
        return worst / mean

    def follow(self, eta: float) -> None:
        """Take a sample: the extremum since the last switch."""
        if self._extreme is None or (self._side > 0) == (eta > self._extreme):
            self._extreme = eta

    def switched(self, t_s: float, side: int) -> None:
        """Take a switch of the relay at the side +1 (eta = x_a) or -1: a half period ends."""
        if self._switches and self._extreme is not None:
            self.halves.append(t_s - self._since_s)
            self._extrema.append(self._extreme)
            if self._switches % 2 == 0 and len(self._extrema) == 2:
                self._whole_one()
        self._switches += 1
        self._since_s, self._side, self._extreme = t_s, side, None

    def _whole_one(self) -> None:
        self.whole += 1
        top, bottom = max(self._extrema), min(self._extrema)
        swing = Swing(0.5 * (top - bottom), 0.5 * (top + bottom), top, bottom, sum(self.halves[-2:]))
        if self.whole == 1:
            return
        if self.x_a + abs(swing.x_0) >= swing.X_m:
            self.swings.clear()
            self.advice = (
                f"x_a + |x_0| = {self.x_a + abs(swing.x_0):.3g} is not below X_m = {swing.X_m:.3g}: "
                "choose a larger amplitude or a smaller hysteresis"
            )
            return
        self.swings.append(swing)
        spread = self.spread
        if spread is not None and spread > self.limit:
            self.advice = (
                f"extrema spread by {100 * spread:.0f} % (limit {100 * self.limit:.0f} %), counting starts again: "
                "wait for calm water, or choose a larger amplitude"
            )
            self.swings.clear()
            self.swings.append(swing)
        elif self.consecutive > 1:
            self.advice = ""
