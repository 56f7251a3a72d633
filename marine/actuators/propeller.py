"""What a propeller does besides pushing: the torque it leaves on the hull, and how slowly it follows; thesis 2.1."""

from __future__ import annotations

import math
from collections.abc import Iterable


def ambient_speed(u: float, v: float, wake: float) -> float:
    """Return u_a = (1 - u_wake) U in m/s with U = sqrt(u^2 + v^2), thesis (2.5), (2.6). u, v: m/s in {B}."""
    return (1.0 - wake) * math.hypot(u, v)


def torque(n: float, u_a: float, Q_nn: float, Q_nu: float) -> float:
    """Return the torque q = Q_nn n |n| - Q_nu |n| u_a in Nm of one propeller, thesis (2.4).

    n: command; u_a: ambient water speed in m/s; Q_nn: Nm per squared command; Q_nu: Nm s/m per command.
    """
    return Q_nn * n * abs(n) - Q_nu * abs(n) * u_a


def hull_torque(torques: Iterable[tuple[float, int]]) -> float:
    """Return the torque in Nm about the common axis of side-by-side propellers, thesis Fig. 2.4.

    torques: (q in Nm, spin) of each; the spin is +1 or -1 for the hand of the propeller. With the same hand the
    torques add up and roll the vessel (a); with opposite hands equal ones cancel (b).
    """
    return sum(spin * q for q, spin in torques)


def lagged(value: float, target: float, dt_s: float, time_constant_s: float) -> float:
    """Return where a first-order lag is after dt_s on the way from value to a target that stands still; exact."""
    if time_constant_s <= 0.0:
        return target
    return target + (value - target) * math.exp(-dt_s / time_constant_s)
