"""Identification from a zig-zag by integrals: thesis 4.4. Constant drag only (Nomoto's model, (4.49), (4.50))."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from marine.identification.checks import sampled, saturated
from marine.identification.result import (
    Axis,
    DataUsed,
    FloatArray,
    IdentificationError,
    Identified,
    drag_warnings,
    parameters,
    require_physical,
)


def integrals(
    t_s: FloatArray,
    eta: FloatArray,
    tau: FloatArray,
    *,
    nu: FloatArray | None = None,
    disturbance: bool = False,
    reference: float | None = None,
    axis: Axis = "angular",
    tau_limit: float | None = None,
) -> Identified:
    """Identify alpha, beta (and Delta) of alpha eta'' + beta eta' = tau + Delta from a zig-zag.

    t_s, eta (unwrapped heading), tau, nu: shape (n,). Between two extrema of eta (nu = 0): beta = int tau / (eta_2 -
    eta_1) (4.52); between two crossings of the reference: alpha = int tau / (nu_4 - nu_3) (4.53). Without `nu` its
    values at the crossings are slopes of a local parabola. disturbance: also find a constant Delta; then all intervals
    together are a linear least-squares problem (no iteration is needed when there are three extrema or more).
    reference: course about which the zig-zag was steered; None for the middle of the extrema.
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    t, x = np.asarray(t_s, dtype=float), np.asarray(eta, dtype=float)
    if nu is None:
        half = max(2, min(round(0.02 * len(x)), _half_period(tau) // 6))
        smooth, slope = (savgol_filter(x, 2 * half + 1, 2, deriv=d, delta=dt_s) for d in (0, 1))
    else:
        smooth, slope = x, np.asarray(nu, dtype=float)
    # tau[k] is held from t[k] to t[k+1]: its integral is straight in between
    impulse = np.concatenate([[0.0], np.cumsum(np.asarray(tau, dtype=float)[:-1] * np.diff(t))])
    turns = _extrema(smooth, t)
    if len(turns) < 2 + disturbance:
        raise IdentificationError(
            f"{len(turns)} extrema of the heading are too few: make a zig-zag of at least three turns"
        )
    peaks = np.interp(turns, t, smooth)
    middle = 0.5 * float(np.mean(peaks[:-1] + peaks[1:])) if reference is None else reference
    crossings = _zeros(smooth - middle, t)
    crossings = crossings[(crossings > turns[0]) & (crossings < turns[-1])] if len(turns) > 3 else crossings
    if len(crossings) < 2:
        raise IdentificationError("the heading crosses its reference less than twice: no interval for the inertia")
    slopes = np.interp(crossings, t, slope)
    drag_equation = (np.diff(peaks), np.diff(np.interp(turns, t, impulse)), np.diff(turns))
    mass_equation = (np.diff(slopes), np.diff(np.interp(crossings, t, impulse)), np.diff(crossings))
    values, stds = (_with_disturbance if disturbance else _undisturbed)(drag_equation, mass_equation)
    require_physical(values, "make a zig-zag of more turns")
    return Identified(
        method="zig-zag integrals" + (", with disturbance" if disturbance else ""),
        model="constant drag",
        parameters=parameters(axis, values, stds),
        data=DataUsed(len(t), float(t[-1] - t[0]), len(turns) - 1, "half turns"),
        citation="thesis (4.52), (4.53)",
        warnings=drag_warnings(values) + saturated(np.asarray(tau), tau_limit),
        residuals=mass_equation[1] - values["alpha"] * mass_equation[0] + values.get("delta", 0.0) * mass_equation[2],
        residual_unit="Ns" if axis == "linear" else "Nms",
    )


_Equation = tuple[FloatArray, FloatArray, FloatArray]
"""Change of eta or nu, impulse, duration of each interval."""


def _undisturbed(drag: _Equation, mass: _Equation) -> tuple[dict[str, float], dict[str, float]]:
    values, stds = {}, {}
    for name, (change, impulse, _) in (("alpha", mass), ("beta", drag)):
        each = impulse / change
        values[name] = float(np.mean(each))
        stds[name] = float(np.std(each, ddof=1) / np.sqrt(len(each))) if len(each) > 1 else float("nan")
    return values, stds


def _with_disturbance(drag: _Equation, mass: _Equation) -> tuple[dict[str, float], dict[str, float]]:
    """Solve [0 d_eta; d_nu 0] [alpha beta] - dt Delta = impulse over all intervals."""
    zeros = np.zeros_like
    matrix = np.column_stack(
        [
            np.concatenate([zeros(drag[0]), mass[0]]),
            np.concatenate([drag[0], zeros(mass[0])]),
            -np.concatenate([drag[2], mass[2]]),
        ]
    )
    right = np.concatenate([drag[1], mass[1]])
    theta, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-12)
    if rank < 3:
        raise IdentificationError("too few turns to tell drag and disturbance apart")
    free = len(right) - 3
    variance = float(np.sum((right - matrix @ theta) ** 2)) / free if free else float("nan")
    spread = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance)
    names = ("alpha", "beta", "delta")
    return dict(zip(names, theta.tolist(), strict=True)), dict(zip(names, spread.tolist(), strict=True))


def _half_period(tau: FloatArray) -> int:
    """Return the median number of samples between changes of the sign of tau."""
    changes = np.flatnonzero(np.diff(np.sign(tau - np.mean(tau))))
    return int(np.median(np.diff(changes))) if len(changes) > 1 else len(tau) // 4


def _zeros(x: FloatArray, t: FloatArray) -> FloatArray:
    """Return the times of zero crossings of x, by straight lines."""
    sign = np.where(x >= 0.0, 1, -1)
    k = np.flatnonzero(np.diff(sign))
    times: FloatArray = t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])
    return times


def _extrema(x: FloatArray, t: FloatArray) -> FloatArray:
    """Return the times of the extrema between crossings of the middle, each by a parabola through its neighbours."""
    middle = 0.5 * (np.max(x) + np.min(x))
    hysteresis = 0.1 * (np.max(x) - np.min(x))
    side = np.where(x > middle + hysteresis, 1, np.where(x < middle - hysteresis, -1, 0))
    decided = np.flatnonzero(side)
    edges = decided[1:][side[decided[1:]] != side[decided[:-1]]]
    first = edges[:-1]  # what lies before the first and after the last edge is no whole swing
    if len(first) == 0:
        return np.empty(0)
    times = []
    for begin, end in zip(first, edges[1:], strict=True):
        k = begin + int(np.argmax(np.abs(x[begin:end] - middle)))
        k = min(max(k, 1), len(x) - 2)
        a, b, c = x[k - 1], x[k], x[k + 1]
        bend = a - 2.0 * b + c
        shift = 0.5 * (a - c) / bend if bend else 0.0
        times.append(t[k] + np.clip(shift, -1.0, 1.0) * (t[k + 1] - t[k]))
    return np.array(times)
