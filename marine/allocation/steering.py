"""A propeller and a rudder in its flow, thesis Table 2.2(f): two commands for surge and yaw, not linear in either."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_GRID = 65
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_REFINEMENTS = 44  # golden sections: the cell of the grid shrinks by 1e-9


@dataclass(frozen=True)
class Steering:
    """X = t - R sin(delta), Y = -R cos(delta), N = L R cos(delta), with R = (k_flow U^2 + k_wash t) delta; (2.12).

    t: thrust of the propellers together in N, lower..upper; with several rudders k_flow and k_wash are their sums,
    all at the same angle, thesis (2.36). k_flow: k_r1 in N s^2/m^2 per rad; k_wash: N of rudder force per N of
    thrust and rad, k_r2 / a_thruster (2.7); lever_m: L, from the rudder forward to the centre of mass; delta_max:
    largest angle, rad, below the stall angle. A propeller that runs backward leaves the rudder its flow_squared alone
    (2.10).
    """

    lower: float
    upper: float
    k_flow: float
    k_wash: float
    lever_m: float
    delta_max: float

    def __post_init__(self) -> None:
        """Refuse what cannot be solved: ValueError."""
        if not self.lower <= 0.0 < self.upper:
            raise ValueError("limits of the thrust must enclose zero and allow some forward")
        if self.k_flow < 0.0 or self.k_wash < 0.0 or not 0.0 < self.delta_max < math.pi / 2.0 or self.lever_m == 0.0:
            raise ValueError("a rudder needs k_flow, k_wash >= 0, a lever, and an angle between 0 and 90 degrees")

    def forces(self, thrust_n: float, delta: float, U: float) -> tuple[float, float, float]:
        """Return (X, Y, N) in N and Nm of a thrust in N and a rudder angle in rad at a speed in m/s."""
        rudder = (self.k_flow * U * U + self.k_wash * max(0.0, thrust_n)) * delta
        Y = -rudder * math.cos(delta)
        return thrust_n - rudder * math.sin(delta), Y, -self.lever_m * Y

    def solve(
        self,
        X: float,
        N: float,
        U: float = 0.0,
        *,
        yaw_priority: float = 10.0,
        angles: tuple[float, float] = (-math.inf, math.inf),
    ) -> tuple[float, float]:
        """Return (thrust in N, rudder angle in rad) for a surge force in N and a yaw moment in Nm.

        The nearest that the limits allow; the error of each axis counts relative to what the vessel can do there at
        speed U, yaw by its priority. angles: where the rudder can be at this moment, by its rate.
        Without flow a rudder does nothing: to turn on the spot it has to push ahead.
        For each angle the best thrust is a formula, so the whole range of angles is searched and no start is guessed.
        """
        most = abs(self.forces(self.upper, self.delta_max, U)[2])
        rest = max(angles[0], min(angles[1], 0.0))
        if most == 0.0:
            return max(self.lower, min(self.upper, X)), rest
        weights = 1.0 / max(self.upper, -self.lower), yaw_priority / most
        low, high = sorted((0.0, math.copysign(self.delta_max, N * self.lever_m) if N else 0.0))
        low, high = max(low, angles[0]), min(high, angles[1])
        if low > high:  # it cannot get to that side yet
            low = high = rest
        grid = np.linspace(low, high, _GRID if low < high else 1)
        best = int(np.argmin([self._best(X, N, U, delta, weights)[0] for delta in grid.tolist()]))
        low, high = float(grid[max(0, best - 1)]), float(grid[min(len(grid) - 1, best + 1)])
        for _ in range(_REFINEMENTS):
            a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            if self._best(X, N, U, a, weights)[0] <= self._best(X, N, U, b, weights)[0]:
                high = b
            else:
                low = a
        delta = (low + high) / 2.0
        return self._best(X, N, U, delta, weights)[1], delta

    def _best(self, X: float, N: float, U: float, delta: float, w: tuple[float, float]) -> tuple[float, float]:
        """Return (weighted square error, thrust) of the best thrust at an angle: linear ahead, linear astern."""
        drag, turn = math.sin(delta) * delta, self.lever_m * math.cos(delta) * delta
        q, s = -self.k_flow * U * U * drag, self.k_flow * U * U * turn  # X and N without thrust
        p, r = 1.0 - self.k_wash * drag, self.k_wash * turn  # and per newton ahead
        wx, wn = w[0] * w[0], w[1] * w[1]
        ahead = (wx * p * (X - q) + wn * r * (N - s)) / (wx * p * p + wn * r * r)
        thrust = max(0.0, min(self.upper, ahead))
        cost = wx * (p * thrust + q - X) ** 2 + wn * (r * thrust + s - N) ** 2
        astern = max(self.lower, min(0.0, X - q))
        astern_cost = wx * (astern + q - X) ** 2 + wn * (s - N) ** 2
        return (cost, thrust) if cost <= astern_cost else (astern_cost, astern)
