"""Least squares on a running system: positions and forces as they come, an estimate at any time; thesis 4.2."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np

from marine.identification.least_squares import RecursiveLeastSquares, half_window, smoothed, window_functions
from marine.identification.result import Axis, Drag, Identified

_LONGEST_GAP_S = 0.5
"""Positions further apart are not joined: the window begins anew."""


class RunningEstimate:
    """Recursive least squares (4.3)-(4.8) on integrals over windows, which need no velocity: only eta is measured.

    Positions and forces come with their own times and are put on one grid, dt_s apart: positions by straight lines, a
    force (held until the next) as means. A window ends every half of its length. forgetting: weight of the past per
    equation. delay_s: known delay from tau to eta.
    """

    def __init__(
        self,
        window_s: float,
        *,
        dt_s: float = 0.1,
        drag: Drag = "linear",
        axis: Axis = "angular",
        delay_s: float = 0.0,
        forgetting: float = 1.0,
    ) -> None:
        self._half = half_window(window_s, dt_s)
        self._phi, self._phi_1, self._phi_2 = window_functions(self._half, dt_s)
        self._squares = RecursiveLeastSquares(dt_s, drag=drag, axis=axis, forgetting=forgetting)
        self._dt_s, self._delay_s = dt_s, delay_s
        self._positions: deque[float] = deque(maxlen=2 * self._half + 1)
        self._means: deque[float] = deque(maxlen=2 * self._half)
        self._forces: deque[tuple[float, float]] = deque()
        self._last: tuple[float, float] | None = None
        self._next_s = 0.0
        self._since = 0

    def force(self, t_s: float, tau: float) -> None:
        """Take the force (N, Nm) that acts from t_s on; times rise."""
        self._forces.append((t_s, tau))

    def position(self, t_s: float, eta: float) -> None:
        """Take a position (m) or unwrapped heading (rad) measured at t_s; times rise."""
        last, self._last = self._last, (t_s, eta)
        if last is None or not 0.0 < t_s - last[0] <= _LONGEST_GAP_S:
            self._positions.clear()
            self._means.clear()
            self._next_s = t_s
        while self._next_s <= t_s:
            at_s = self._next_s
            part = 1.0 if last is None or t_s == last[0] else (at_s - last[0]) / (t_s - last[0])
            self._sample(at_s, eta if not self._positions or last is None else last[1] + part * (eta - last[1]))
            self._next_s += self._dt_s

    def result(self) -> Identified:
        """Return what is known by now; raises IdentificationError before there is anything to know."""
        return self._squares.result()

    def _sample(self, t_s: float, eta: float) -> None:
        if self._positions:
            self._means.append(self._mean(t_s - self._dt_s - self._delay_s, t_s - self._delay_s))
        self._positions.append(eta)
        self._since += 1
        if len(self._positions) == 2 * self._half + 1 and self._since >= self._half:
            self._since = 0
            self._equation()

    def _mean(self, begin_s: float, end_s: float) -> float:
        """Return the mean force from begin to end; what lies before is forgotten."""
        while len(self._forces) > 1 and self._forces[1][0] <= begin_s:
            self._forces.popleft()
        if not self._forces:
            return 0.0
        ends = [*self._forces, (max(end_s, self._forces[-1][0]), 0.0)]
        impulse = sum(
            tau * max(min(until_s, end_s) - max(since_s, begin_s), 0.0)
            for (since_s, tau), (until_s, _) in pairwise(ends)
        )
        return impulse / (end_s - begin_s)

    def _equation(self) -> None:
        eta, cells = np.array(self._positions), np.array(self._means)
        nu = np.gradient(smoothed(eta, max(2, self._half // 2)), self._dt_s)
        tau = np.concatenate([cells[:1], 0.5 * (cells[1:] + cells[:-1]), cells[-1:]])  # held: means of neighbours
        way = eta - eta[0]
        drags = (-float(self._phi_1 @ way), float(self._phi @ (np.abs(nu) * nu)))
        self._squares.take(float(self._phi_2 @ way), drags, float(self._phi @ tau))
