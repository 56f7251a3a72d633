"""Turning away from a wall: what is left to a boat that cannot push back."""

from __future__ import annotations

import math
from bisect import bisect_left

from marine.control.base import Vector3
from marine.guidance.abilities import TURN_SHARE, Abilities, yaw_limit_at
from marine.guidance.reference_filter import terminal_speed
from marine.vessel import Rudder, Vessel

STEERAGE = 0.2
"""Slower than this part of its speed ahead a boat does not turn for a wall: it is let coast."""
RESERVE_S = 1.0
"""The turn begins so long before it must."""
_SPEEDS = 16
_ARC = tuple(math.pi * k / 12 for k in range(13))
"""A boat that has turned by so much, half a turn, goes back where it came from."""


class TurnAway:
    """Keeps a way out open: a half turn to one of the sides that stays clear of all walls.

    The turn: straight on until the rudder is over and the yaw rate has followed (the lag of a first-order response
    delays a ramp by its time constant), then a circle with the rate that TURN_SHARE of the moment gives at this
    speed. When the better side comes as near to a wall as may be, that turn is made, at this speed.
    """

    def __init__(self, vessel: Vessel) -> None:
        """vessel: one that goes ahead and steers."""
        ahead, yaw, pool = Abilities(vessel).ahead_m_s, vessel.model.yaw, vessel.pool
        self._surge, self._radius_m = vessel.model.surge, vessel.radius_m
        self._speeds = [ahead * (STEERAGE + (0.9 - STEERAGE) * k / (_SPEEDS - 1)) for k in range(_SPEEDS)]
        self._moments = [yaw_limit_at(vessel, u) for u in self._speeds]
        self._rates = [terminal_speed(yaw, TURN_SHARE * N) for N in self._moments]
        over = [a.n_max / a.rate_per_s for a in vessel.actuators if isinstance(a, Rudder) and a.rate_per_s]
        seen = [s.sample_time_s + s.delay_s for s in vessel.sensors if s.kind in ("position", "compass", "camera")]
        self._delay_s = 2.0 * max(over, default=0.0) + max(seen, default=0.0) + vessel.actuation_delay_s
        self._alpha = yaw.alpha
        self._size = (pool.length_x_m, pool.length_y_m)

    def kept(self, tau: Vector3, eta: Vector3, nu: Vector3, margin_m: float) -> tuple[Vector3, bool]:
        """Return [X Y N] as it may act, and whether it was changed; margin_m: from the walls to the origin of {B}."""
        u, (x, y, _) = nu[0], eta
        if u < self._speeds[0]:
            return tau, False
        at = min(bisect_left(self._speeds, u), _SPEEDS - 1)
        rate, N = self._rates[at], self._moments[at]
        lag_s, margin_m = self._alpha * rate / (TURN_SHARE * N), margin_m + RESERVE_S * u
        reach = 2.0 * u / rate + u * (self._delay_s + 2.0 * lag_s) + margin_m
        if min(x, y, self._size[0] - x, self._size[1] - y) > reach:
            return tau, False
        room, side = max((self._room(eta, nu, side, rate, lag_s), side) for side in (-1.0, 1.0))
        if room > margin_m:
            return tau, False
        X = self._surge.drag(u) if room > self._radius_m else min(0.0, tau[0])  # too late: slower at least
        return (X, tau[1], side * N), True

    def _room(self, eta: Vector3, nu: Vector3, side: float, rate: float, lag_s: float) -> float:
        """Return how near to a wall, in m, a half turn to a side brings the boat."""
        (x, y, psi), (u, v, r) = eta, nu
        straight_s = self._delay_s + lag_s * max(0.0, 1.0 - side * r / rate)
        psi += r * self._delay_s  # the rudder is not over yet
        c, s = math.cos(psi), math.sin(psi)
        x, y = x + straight_s * (c * u - s * v), y + straight_s * (s * u + c * v)
        radius = u / rate
        m_x, m_y = x - side * radius * s, y + side * radius * c
        turned = (psi + side * angle for angle in _ARC)
        arc = [(m_x + side * radius * math.sin(a), m_y - side * radius * math.cos(a)) for a in turned]
        return min(min(p, q, self._size[0] - p, self._size[1] - q) for p, q in [(x, y), *arc])
