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
        share = min(1.0, dt_s / self._time_s)
        a, b, c = (slow + share * (now - slow) for slow, now in zip(self._slow, signal, strict=True))
        self._slow = a, b, c
        return signal[0] - a, signal[1] - b, signal[2] - c
