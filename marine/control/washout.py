"""The part of a signal that changes: a high-pass of first order, s T / (s T + 1)."""

from __future__ import annotations

from marine.control.base import ZERO, Vector3


class Washout:
    """What is new of an estimated disturbance, to be fed forward beside an integral, which keeps what lasts.

    It does what the integral does, sooner. Where the vessel does not get what is demanded (a thruster has failed and
    nobody knows: a quarter of the force is left in its direction), the estimator sees the rest as a disturbance, and
    fed forward it keeps the loop's damping: docs/actuator-failures.md.
    """

    def __init__(self, time_s: float) -> None:
        """time_s: T, about 1 / w0 of the loop."""
        self._time_s = time_s
        self._slow = ZERO

    def start(self, signal: Vector3) -> None:
        """Take the signal of this moment for what lasts."""
        self._slow = signal

    def step(self, dt_s: float, signal: Vector3) -> Vector3:
        """Return the part that is new, dt_s after the step before."""
        share = dt_s / self._time_s if dt_s < self._time_s else 1.0
        (x, y, n), (slow_x, slow_y, slow_n) = signal, self._slow
        slow_x += share * (x - slow_x)
        slow_y += share * (y - slow_y)
        slow_n += share * (n - slow_n)
        self._slow = slow_x, slow_y, slow_n
        return x - slow_x, y - slow_y, n - slow_n
