"""Direct and reverse spiral of two simulated ships, thesis 4.4: one stable on a straight course, one not."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from marine.identification.manoeuvres import Spiral, direct_spiral, reverse_spiral
from marine.identification.result import FloatArray
from services.cli.figure_parts import Figure
from services.cli.svg import Chart

Rate = TypeVar("Rate", float, FloatArray)

_STEP_S = 0.1
_HOLD_S = 120.0
_LEVELS_RAD = np.radians(np.concatenate([np.arange(20.0, -20.5, -1.0), np.arange(-19.0, 20.5, 1.0)]))
_INERTIA_S, _CUBIC_S3 = 3.0, 400.0
"""Chosen: Norrbin's ship T r' = delta - a r - b r^3, r in rad/s, delta in rad."""
_SHIPS = {"stable on a straight course": 2.0, "not stable on a straight course": -2.0}
"""Chosen: a in s."""


def spirals() -> Figure:
    """Both spirals of both ships, and what is read from them."""
    charts = []
    rows = [f"{'ship':<34}{'spiral':<10}{'loop, degrees of rudder':>24}{'dr/d(delta) at 0, 1/s':>24}"]
    for name, a in _SHIPS.items():
        chart = Chart(name, "rudder, degrees", "steady rate of turn, deg/s")
        for label, found in (("direct", direct(a)), ("reverse", reverse(a))):
            rudder, r = np.degrees(found.rudder_rad).tolist(), np.degrees(found.r_rad_s).tolist()
            (chart.points if label == "direct" else chart.line)(rudder, r, label)
            jumps = label == "direct" and found.loop_width_rad > 0.0
            slope = f"{'jumps':>24}" if jumps else f"{found.slope_per_s:24.3f}"
            rows.append(f"{name:<34}{label:<10}{np.degrees(found.loop_width_rad):24.1f}{slope}")
        charts.append(chart)
    caption = (
        "Direct spiral (rudder angles held one after the other, to port and back) and reverse spiral (rates of turn "
        "held by steering) of two simulated ships, Norrbin's 3 r' = delta - a r - 400 r^3 with a = 2 and a = -2 s. "
        "The unstable ship jumps over rates that only steering holds: the loop of the direct spiral, the bend of the "
        "reverse one."
    )
    return Figure(tuple(charts), caption, tuple(rows))


def direct(a: float) -> Spiral:
    """Return the direct spiral: each rudder angle held for two minutes."""
    rudder = np.repeat(_LEVELS_RAD, round(_HOLD_S / _STEP_S))
    r = np.zeros(len(rudder))
    for k in range(len(rudder) - 1):
        r[k + 1] = _after(a, float(r[k]), float(rudder[k]))
    return direct_spiral(np.arange(len(rudder), dtype=float) * _STEP_S, r, rudder, hold_s=0.5 * _HOLD_S)


def reverse(a: float) -> Spiral:
    """Return the reverse spiral: a PI pilot holds each rate, the rudder that it takes is averaged over the end."""
    rates = np.radians(np.linspace(-6.0, 6.0, 25))
    r, integral = np.zeros_like(rates), np.zeros_like(rates)
    taken: list[FloatArray] = []
    for _ in range(round(_HOLD_S / _STEP_S)):
        integral += 2.0 * (rates - r) * _STEP_S
        rudder = 8.0 * (rates - r) + integral
        r = _after(a, r, rudder)
        taken.append(rudder)
    return reverse_spiral(rates.tolist(), np.mean(taken[len(taken) // 2 :], axis=0).tolist())


def _after(a: float, r: Rate, rudder: Rate) -> Rate:
    return r + _STEP_S / _INERTIA_S * (rudder - a * r - _CUBIC_S3 * r**3)
