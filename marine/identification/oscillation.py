"""Reading a self-oscillation from a record: half periods, extrema, switching points; thesis 6.5 and 6.7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marine.identification.checks import sampled
from marine.identification.result import Axis, FloatArray, IdentificationError

NDArrayInt = NDArray[np.intp]

SPREAD = 0.10
"""Largest standard deviation of extrema, relative to the amplitude, that the thesis accepts (6.7)."""
FEWEST = 2
"""Whole periods below which nothing is identified; the thesis takes five."""
_ROUNDED = 0.1
"""Part of C by which whole commands may miss the relay's level: with what the other axes need they round otherwise."""


@dataclass(frozen=True)
class Oscillation:
    """A self-oscillation of the relay's input e = reference - eta.

    C: relay output (N, Nm); x_a: hysteresis at which the relay really switched, x_a* of 6.5 (m, rad); X_m: amplitude;
    x_0: bias; omega: rad/s; duty: (T_H - T_L)/(T_H + T_L), T_H the time at +C. periods: how many were averaged.
    """

    C: float
    x_a: float
    X_m: float
    omega: float
    x_0: float = 0.0
    duty: float = 0.0
    periods: int = 1


def reversals(tau: FloatArray) -> NDArrayInt:
    """Return the samples after which tau crosses the middle of its range, shape (n,)."""
    out: NDArrayInt = np.flatnonzero(np.diff(np.sign(tau - 0.5 * (tau.max() + tau.min()))))
    return out


def upward(tau: FloatArray) -> NDArrayInt:
    """Return the samples at which tau goes up through the middle of its range: where periods begin, shape (n,).

    A crossing counts only after tau was in the lowest quarter and when it reaches the highest, so that noise does not.
    """
    low, high = float(np.min(tau)), float(np.max(tau))
    level = np.where(tau > high - 0.25 * (high - low), 1, np.where(tau < low + 0.25 * (high - low), -1, 0))
    decided = np.flatnonzero(level)
    reached = decided[1:][(level[decided[1:]] == 1) & (level[decided[:-1]] == -1)]
    above = tau > 0.5 * (low + high)
    begun = np.flatnonzero(above[1:] & ~above[:-1]) + 1
    out: NDArrayInt = begun[np.searchsorted(begun, reached, side="right") - 1] if begun.size else begun
    return out


def measure(
    t_s: FloatArray, eta: FloatArray, tau: FloatArray, *, reference: float = 0.0, axis: Axis = "angular"
) -> tuple[Oscillation, tuple[str, ...]]:
    """Return the mean oscillation of a relay experiment and warnings about it.

    t_s, eta, tau: shape (n,); tau[k] follows from eta[k]. Whole periods from the first switch to +C to the last are
    used. Raises IdentificationError for fewer than two, a tau that is not a relay's, hysteresis and bias above the
    amplitude (7.12), a relay that works against its sign.
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    tau = np.asarray(tau, dtype=float)
    middle = 0.5 * float(np.min(tau) + np.max(tau))
    C = float(np.mean(np.abs(tau - middle)))
    share = np.mean(np.abs(np.abs(tau - middle) - C) < _ROUNDED * C)
    if share < 0.95:
        raise IdentificationError(
            f"tau is no relay's: {100 * (1 - share):.0f} % of it lies between its two levels (saturation, ramps); "
            "use the projection on harmonics or least squares"
        )
    e = reference - np.asarray(eta, dtype=float)
    up = _enough(upward(tau))
    down = upward(-tau)
    down = down[(down > up[0]) & (down < up[-1])]
    e_up, e_down = e[up], e[down]
    if np.mean(e_up) <= np.mean(e_down):
        raise IdentificationError("the relay pushes away from its reference: tau or eta has the wrong sign")
    top, bottom = np.maximum.reduceat(e, up)[:-1], np.minimum.reduceat(e, up)[:-1]
    amplitudes, T = 0.5 * (top - bottom), np.diff(up) * dt_s
    found = Oscillation(
        C=C,
        x_a=0.5 * float(np.mean(e_up) - np.mean(e_down)),
        X_m=float(np.mean(amplitudes)),
        omega=float(2.0 * np.pi / np.mean(T)),
        x_0=0.5 * float(np.mean(top) + np.mean(bottom)),
        duty=float(np.mean(np.sign(tau[up[0] : up[-1]] - middle))),
        periods=len(up) - 1,
    )
    if axis == "angular" and found.X_m > np.pi:
        raise IdentificationError("the heading oscillates by more than half a turn: were degrees given for radians?")
    return found, _judge(found, top, bottom, T, dt_s)


def whole_periods(tau: FloatArray) -> NDArrayInt:
    """Return the samples at which the periods of tau begin, the end of the last one included, shape (periods + 1,).

    Counted from switches up or from switches down, whichever gives more periods.
    """
    return _enough(max(upward(tau), upward(-tau), key=len))


def period(tau: FloatArray) -> float:
    """Return the mean period of tau in samples, from a switch to the next of its kind; at least one is needed."""
    switches = [upward(tau), upward(-tau)]
    periods = sum(max(len(starts) - 1, 0) for starts in switches)
    if periods == 0:
        raise IdentificationError(f"0 whole oscillations are too few: record {FEWEST} at least, better 5")
    return sum(float(starts[-1] - starts[0]) for starts in switches if len(starts)) / periods


def _enough(starts: NDArrayInt) -> NDArrayInt:
    periods = max(len(starts) - 1, 0)
    if periods < FEWEST:
        raise IdentificationError(f"{periods} whole oscillations are too few: record {FEWEST} at least, better 5")
    return starts


def _judge(found: Oscillation, top: FloatArray, bottom: FloatArray, T: FloatArray, dt_s: float) -> tuple[str, ...]:
    warnings: list[str] = []
    if np.any(found.x_a + np.abs(0.5 * (top + bottom)) >= 0.5 * (top - bottom)):
        warnings.append("an oscillation breaks x_a + |x_0| < X_m (7.12): choose a larger C or a smaller x_a")
    if found.periods < 5:
        warnings.append(f"only {found.periods} whole oscillations (the thesis takes 5)")
    spread = max(float(np.std(top)), float(np.std(bottom))) / found.X_m
    if spread > SPREAD:
        warnings.append(
            f"extrema spread by {100 * spread:.0f} % (limit {100 * SPREAD:.0f} %): not settled, or disturbed"
        )
    if float(np.ptp(T)) > max(3.0 * dt_s, 0.2 * float(np.mean(T))):
        warnings.append("periods differ from each other: not settled, or disturbed")
    return tuple(warnings)
