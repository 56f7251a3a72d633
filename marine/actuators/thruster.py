"""Characteristic of a thruster, its inverse, and what rounding and dead zone leave of a demanded thrust."""

from __future__ import annotations

import math

from marine.vessel import Thruster


def max_thrust(thruster: Thruster) -> float:
    """Return the thrust in N at the largest command, K_T n_max^2."""
    return thruster.k_t * thruster.n_max * thruster.n_max


def thrust(thruster: Thruster, command: float) -> float:
    """Return the thrust in N of a command: tau = K_T |n| n, pladypos (1), saturated, zero within the dead zone."""
    n = max(-thruster.n_max, min(thruster.n_max, command))
    return thruster.k_t * abs(n) * n if abs(n) > thruster.dead_zone else 0.0


def command(thruster: Thruster, thrust_n: float) -> float:
    """Return the command whose thrust is nearest to a demanded one in N, within the limits.

    The inverse characteristic n = sgn(tau) sqrt(|tau| / K_T), rounded for whole commands. In the dead zone and
    between whole commands the choice is by thrust, not by command: near zero the characteristic is so flat that
    rounding the command would be up to half as much again wrong in thrust.
    """
    wanted = abs(thrust_n)
    n = min(thruster.n_max, math.sqrt(wanted / thruster.k_t))
    if not thruster.integer and n > thruster.dead_zone:
        return math.copysign(n, thrust_n)
    if thruster.integer:
        low, high = float(math.floor(n)), float(math.ceil(n))
        first_working = math.floor(thruster.dead_zone) + 1.0
    else:
        low, high = 0.0, n
        first_working = math.nextafter(thruster.dead_zone, math.inf)
    if low <= thruster.dead_zone:
        low, high = 0.0, max(high, first_working)
    if high > thruster.n_max:
        high = low
    k_t = thruster.k_t
    nearest = low if wanted - k_t * low * low <= k_t * high * high - wanted else high
    return math.copysign(nearest, thrust_n) if nearest else 0.0
