"""Figures of the standard ship manoeuvres of thesis 4.4: turning circle, zig-zag, direct and reverse spiral.

Definitions follow IMO MSC.137(76) (advance, transfer, tactical diameter, overshoot, initial turning) and the ITTC
manoeuvring guideline 7.5-02-06-01 (spirals). Frames and signs are the project's: x, y in {E}, psi from x towards y,
starboard positive; records are arrays in SI of shape (n,), psi unwrapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, radians

import numpy as np
from scipy.signal import savgol_filter

from marine.identification.checks import sampled
from marine.identification.result import FloatArray, IdentificationError

_STEADY_TURN = pi
"""A turn is taken as steady in its last half circle."""
_REACHED = 0.9
"""Share of the largest rudder angle at which the rudder counts as put over."""


@dataclass(frozen=True)
class TurningCircle:
    """Figures of a turning circle, in m and s, from the time the rudder began to move.

    advance: along the first heading until it changed by 90 degrees; transfer: across it; tactical diameter: across at
    180 degrees; steady diameter 2 U/|r| and the rest from the last half turn, nan where the record ends earlier.
    """

    advance_m: float
    transfer_m: float
    tactical_diameter_m: float
    steady_diameter_m: float
    time_90_s: float
    time_180_s: float
    approach_speed_m_s: float
    steady_speed_m_s: float
    steady_rate_rad_s: float


@dataclass(frozen=True)
class ZigZag:
    """Figures of a zig-zag, angles in rad, times in s, from the first execute.

    overshoots: heading beyond that at each counter rudder, in order; initial_turning_s: to the second execute;
    advance_m: way along the first course until then (nan without positions); reach_s: until back on the first course;
    period_s: from the first return to the course to the third, nan if the record ends before.
    """

    overshoots_rad: tuple[float, ...]
    executes_s: tuple[float, ...]
    initial_turning_s: float
    advance_m: float
    reach_s: float
    period_s: float


@dataclass(frozen=True)
class Spiral:
    """Steady rate of turn r in rad/s over rudder angle in rad, in the order in which it was measured, shape (n,).

    loop_width: range of rudder angles about zero for which r depends on where the ship comes from: rad, 0 for a
    ship that is stable in a straight line. slope: dr/d(rudder) at r = 0 in 1/s: negative there for an unstable ship
    (a reverse spiral can follow it, a direct one jumps).
    """

    rudder_rad: FloatArray
    r_rad_s: FloatArray
    loop_width_rad: float
    slope_per_s: float


def turning_circle(
    t_s: FloatArray, x_m: FloatArray, y_m: FloatArray, psi_rad: FloatArray, *, rudder_s: float
) -> TurningCircle:
    """Return the figures of a turning circle to either side.

    rudder_s: time at which the rudder began to move (see `rudder_over`); what lies before is the approach. Raises
    IdentificationError when there is no approach, or when the heading changes by less than half a turn.
    """
    t = np.asarray(t_s, dtype=float)
    dt_s = sampled(t, "angular", eta=psi_rad)
    if not t[0] <= rudder_s < t[-1]:
        raise IdentificationError(f"the rudder moved at {rudder_s:g} s, the record is from {t[0]:g} to {t[-1]:g} s")
    begun = int(np.searchsorted(t, rudder_s))
    turned = np.abs(psi_rad - psi_rad[begun])
    if np.max(turned[begun:]) < pi:
        raise IdentificationError(
            f"the heading changed by {np.degrees(np.max(turned[begun:])):.0f} degrees only: turn for 180 at least"
        )
    side = np.sign(psi_rad[-1] - psi_rad[begun])
    ahead, across = _along(x_m, y_m, float(psi_rad[begun]), begun)
    at_90, at_180 = (_first(turned, begun, angle) for angle in (0.5 * pi, pi))
    speed = _speed(x_m, y_m, dt_s, (at_90 - begun) * dt_s / 6.0)
    last = np.flatnonzero(turned >= turned[-1] - _STEADY_TURN)
    steady = turned[-1] >= 2.0 * pi
    way = slice(int(last[0]), len(t))
    rate = (psi_rad[-1] - psi_rad[way][0]) / (t[-1] - t[way][0])
    U = float(np.mean(speed[way]))
    nan = float("nan")
    return TurningCircle(
        advance_m=_at(ahead, at_90),
        transfer_m=float(side) * _at(across, at_90),
        tactical_diameter_m=float(side) * _at(across, at_180),
        steady_diameter_m=2.0 * U / abs(float(rate)) if steady else nan,
        time_90_s=_at(t, at_90) - rudder_s,
        time_180_s=_at(t, at_180) - rudder_s,
        approach_speed_m_s=float(speed[begun]),
        steady_speed_m_s=U if steady else nan,
        steady_rate_rad_s=float(rate) if steady else nan,
    )


def rudder_over(t_s: FloatArray, rudder_rad: FloatArray, *, hold_s: float = 5.0) -> float:
    """Return when the rudder began to move to where it was held, in s.

    The rudder counts as put over where it first stays beyond 90 % of its median over the second half of the record for
    hold_s; from there back to the last time it was within 10 %. Raises IdentificationError if it was never held.
    """
    final = float(np.median(rudder_rad[len(rudder_rad) // 2 :]))
    over = np.sign(final) * rudder_rad >= _REACHED * abs(final)
    dt_s = float(t_s[-1] - t_s[0]) / (len(t_s) - 1)
    need = max(1, round(hold_s / dt_s))
    held = np.convolve(over, np.ones(need), mode="valid") >= need
    if final == 0.0 or not held.any():
        raise IdentificationError("the rudder was not held at one angle: this is no turning circle")
    first = int(np.argmax(held))
    small = np.flatnonzero(np.sign(final) * rudder_rad[: first + 1] <= (1.0 - _REACHED) * abs(final))
    return float(t_s[small[-1] if len(small) else 0])


def zigzag_figures(
    t_s: FloatArray,
    psi_rad: FloatArray,
    rudder_rad: FloatArray,
    *,
    x_m: FloatArray | None = None,
    y_m: FloatArray | None = None,
) -> ZigZag:
    """Return overshoots and times of a zig-zag (Algorithm 4.1), read from when the rudder was reversed.

    Raises IdentificationError with fewer than two reversals of the rudder, or if the heading does not follow it.
    """
    t, psi = np.asarray(t_s, dtype=float), np.asarray(psi_rad, dtype=float)
    sampled(t, "angular", eta=psi, tau=rudder_rad)
    orders = executes(np.asarray(rudder_rad, dtype=float))
    if len(orders) < 3:
        raise IdentificationError(f"{max(len(orders) - 1, 0)} reversals of the rudder: a zig-zag has two at least")
    start, side = orders[0], float(np.sign(rudder_rad[orders[1]]))
    course = side * (psi - psi[start])
    if course[orders[1]] <= 0.0:
        raise IdentificationError("the heading does not follow the rudder: one of the two has the wrong sign")
    overshoots = []
    for number, (k, end) in enumerate(zip(orders[1:], [*orders[2:], len(t) - 1], strict=True)):
        swing = course if number % 2 == 0 else -course
        top = k + int(np.argmax(swing[k : end + 1]))
        if top < end or number < len(orders) - 2:  # an extremum, not the end of the record
            overshoots.append(float(swing[top] - swing[k]))
    returns = t[orders[1] :][np.flatnonzero(np.diff(np.sign(course[orders[1] :])))]
    advance = float("nan")
    if x_m is not None and y_m is not None:
        ahead, _ = _along(x_m, y_m, float(psi[start]), start)
        advance = float(ahead[orders[1]])
    return ZigZag(
        overshoots_rad=tuple(overshoots),
        executes_s=tuple(float(t[k] - t[start]) for k in orders),
        initial_turning_s=float(t[orders[1]] - t[start]),
        advance_m=advance,
        reach_s=float(returns[0] - t[start]) if len(returns) else float("nan"),
        period_s=float(returns[2] - returns[0]) if len(returns) > 2 else float("nan"),
    )


def initial_turning_ability(
    t_s: FloatArray,
    x_m: FloatArray,
    y_m: FloatArray,
    psi_rad: FloatArray,
    *,
    rudder_s: float,
    change_rad: float = radians(10.0),
) -> float:
    """Return the way in m from the first movement of the rudder until the heading changed (IMO: by 10 degrees)."""
    begun = int(np.searchsorted(t_s, rudder_s))
    turned = np.abs(psi_rad - psi_rad[begun])
    if np.max(turned[begun:]) < change_rad:
        raise IdentificationError(f"the heading never changes by {np.degrees(change_rad):.0f} degrees")
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
    return _at(way, _first(turned, begun, change_rad)) - float(way[begun])


def direct_spiral(
    t_s: FloatArray, r_rad_s: FloatArray, rudder_rad: FloatArray, *, hold_s: float, settled: float = 0.05
) -> Spiral:
    """Return the direct spiral (Dieudonne): steady r at rudder angles held one after the other, down and up again.

    hold_s: shortest time in s for which an angle counts as held; r is the mean over the last quarter of that.
    settled: largest change of r over this quarter, relative to the largest |r|. Raises IdentificationError when r has
    not settled at a rudder angle, or when fewer than four angles were held.
    """
    t, r = np.asarray(t_s, dtype=float), np.asarray(r_rad_s, dtype=float)
    dt_s = sampled(t, "angular", nu=r, tau=rudder_rad)
    edges = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(rudder_rad)) > 1e-6) + 1, [len(t)]])
    angles, rates = [], []
    for begin, end in pairwise(edges.tolist()):
        if (end - begin) * dt_s < hold_s:
            continue
        last = r[end - (end - begin) // 4 : end]
        if abs(last[-1] - last[0]) > settled * float(np.max(np.abs(r))):
            raise IdentificationError(
                f"at {np.degrees(rudder_rad[begin]):.1f} degrees of rudder the rate still changes: hold it longer"
            )
        angles.append(float(rudder_rad[begin]))
        rates.append(float(np.mean(last)))
    return _spiral(angles, rates)


def reverse_spiral(r_rad_s: Sequence[float], rudder_rad: Sequence[float]) -> Spiral:
    """Return the reverse spiral (Bech) from pairs of a rate held by steering and the mean rudder that it took.

    r_rad_s: rad/s, at least four values of both signs; rudder_rad: rad.
    """
    order = np.argsort(r_rad_s)
    return _spiral(np.asarray(rudder_rad, dtype=float)[order].tolist(), np.asarray(r_rad_s)[order].tolist())


def _spiral(angles: list[float], rates: list[float]) -> Spiral:
    rudder, r = np.array(angles), np.array(rates)
    if len(r) < 4 or r.min() >= 0.0 or r.max() <= 0.0:
        raise IdentificationError(f"{len(r)} steady turns: a spiral needs four at least, to both sides")
    return Spiral(rudder, r, _loop_width(rudder, r), _slope_at_zero(rudder, r))


def _loop_width(rudder: FloatArray, r: FloatArray) -> float:
    """Return by how far the branches of turns to either side overlap in rudder angle."""
    return max(0.0, float(np.max(rudder[r < 0.0]) - np.min(rudder[r > 0.0])))


def _slope_at_zero(rudder: FloatArray, r: FloatArray) -> float:
    """Return dr/d(rudder) at r = 0: the straight line through the two slowest turns to either side."""
    slowest = np.argsort(np.abs(r))
    near = np.concatenate([slowest[r[slowest] > 0.0][:2], slowest[r[slowest] < 0.0][:2]])
    line = float(np.polyfit(r[near], rudder[near], 1)[0])  # rudder over r: it has one value even where r jumps
    return 1.0 / line if line else float("inf")


def executes(rudder: FloatArray) -> list[int]:
    """Return the samples at which the rudder leaves for the other side; the first one from amidships.

    What lasts less than a quarter of the longest hold is steering before the manoeuvre.
    """
    top = float(np.quantile(np.abs(rudder), 0.9))
    side = np.where(rudder > 0.8 * top, 1, np.where(rudder < -0.8 * top, -1, 0))
    edges = np.concatenate([[0], np.flatnonzero(np.diff(side)) + 1, [len(side)]])
    held = [(int(k), int(end - k)) for k, end in pairwise(edges) if side[k]]
    longest = max((n for _, n in held), default=0)
    begun = [k for k, n in held if n >= 0.25 * longest]
    found: list[int] = []
    for number, k in enumerate(begun):
        if number and side[k] == side[begun[number - 1]]:
            continue
        before = np.flatnonzero(side[k] * rudder[:k] <= (-0.8 * top if found else 0.5 * top))
        found.append(int(before[-1]) if len(before) else 0)
    return found


def _along(x_m: FloatArray, y_m: FloatArray, psi_rad: float, origin: int) -> tuple[FloatArray, FloatArray]:
    """Return positions from sample `origin` along the heading psi and to starboard of it, in m."""
    x, y = x_m - x_m[origin], y_m - y_m[origin]
    c, s = np.cos(psi_rad), np.sin(psi_rad)
    return x * c + y * s, y * c - x * s


def _speed(x_m: FloatArray, y_m: FloatArray, dt_s: float, window_s: float) -> FloatArray:
    """Return the speed in m/s from slopes of cubics over a window: noise of positions is no speed."""
    window = min(2 * max(2, round(0.5 * window_s / dt_s)) + 1, len(x_m) - 1 + len(x_m) % 2)
    u, v = (savgol_filter(z, window, 3, deriv=1, delta=dt_s) for z in (x_m, y_m))
    out: FloatArray = np.hypot(u, v)
    return out


def _first(turned: FloatArray, begun: int, angle: float) -> float:
    """Return the (fractional) sample at which the change of heading first reaches an angle."""
    k = begun + int(np.argmax(turned[begun:] >= angle))
    step = turned[k] - turned[k - 1]
    return float(k - (turned[k] - angle) / step) if step > 0.0 else float(k)


def _at(values: FloatArray, sample: float) -> float:
    return float(np.interp(sample, np.arange(len(values)), values))
