"""Identification from open-loop step responses: pladypos (5)-(10), thesis 4.3 and Table 4.1.

tau is the force or moment of the step, applied to the vessel at rest at t = 0. Type 0: velocity is measured; Type 1:
position or heading is. `drag` is "constant" (linear model) or "linear" (nonlinear model).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from math import copysign, exp, log, sqrt, tanh

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from marine.identification.checks import require_sign, sampled, saturated
from marine.identification.result import (
    Axis,
    DataUsed,
    Drag,
    FloatArray,
    IdentificationError,
    Identified,
    drag_of,
    mean_and_std,
    parameters,
    require_physical,
)

STEADY = 0.98
"""A run that ends below this share of its fitted steady state is marked."""
_TAIL = 0.1
"""The steady state is the mean over this last share of a run."""


def velocity_response(t_s: FloatArray, tau: float, alpha: float, beta: float, drag: Drag) -> FloatArray:
    """Return nu(t) after a step: pladypos (5) for constant drag, (8) for linear drag; thesis (4.30), (4.35).

    t_s: s; tau: N or Nm; alpha, beta in SI (beta is the quadratic coefficient for linear drag); m/s or rad/s.
    """
    nu_ss, T = steady_state(tau, beta, drag), time_constant(tau, alpha, beta, drag)
    return nu_ss * (1.0 - np.exp(-t_s / T)) if drag == "constant" else nu_ss * np.tanh(t_s / T)


def position_response(
    t_s: FloatArray, tau: float, alpha: float, beta: float, drag: Drag, *, eta_0: float = 0.0
) -> FloatArray:
    """Return eta(t) after a step: thesis (4.42) for constant drag, (4.46) for linear drag (m or rad)."""
    return _travel(t_s, steady_state(tau, beta, drag), time_constant(tau, alpha, beta, drag), eta_0, drag)


def steady_state(tau: float, beta: float, drag: Drag) -> float:
    """Return the velocity that tau ends at: (4.31), (4.36), (4.47) corrected: see docs/errata.md."""
    return tau / beta if drag == "constant" else copysign(sqrt(abs(tau) / beta), tau)


def time_constant(tau: float, alpha: float, beta: float, drag: Drag) -> float:
    """Return T_L = alpha/beta (4.32), or T_N = alpha/sqrt(beta |tau|) (4.37), pladypos (10), in s."""
    return alpha / beta if drag == "constant" else alpha / sqrt(beta * abs(tau))


def from_type_0(tau: float, nu_ss: float, T_s: float, drag: Drag) -> tuple[float, float]:
    """Return (alpha, beta) from steady state and equivalent time constant: pladypos (6), (7), (9), (10); Table 4.1.

    T_s: the time at which the response reaches 63.2 % (constant drag) or 76.2 % = tanh 1 (linear drag) of nu_ss.
    """
    beta = tau / nu_ss if drag == "constant" else abs(tau) / nu_ss**2
    return T_s * abs(tau / nu_ss), beta


def from_type_1(tau: float, k_ss: float, eps_v: float, eta_0: float, drag: Drag) -> tuple[float, float]:
    """Return (alpha, beta) from slope and velocity error of the position: (4.43), (4.44), (4.47), (4.48), Table 4.1."""
    if drag == "constant":
        return (eta_0 - eps_v) * tau / k_ss**2, tau / k_ss
    return (eta_0 - eps_v) * tau / k_ss**2 / log(2.0), abs(tau) / k_ss**2


def type_0(
    t_s: FloatArray,
    nu: FloatArray,
    tau: float,
    *,
    drag: Drag = "linear",
    axis: Axis = "linear",
    tau_limit: float | None = None,
) -> Identified:
    """Identify from a measured velocity by the papers' formulas, pladypos (6), (7) or (9), (10).

    t_s: times from the step on (t = 0), shape (n,); nu: velocity, shape (n,). The steady state is the mean of the last
    tenth. Raises IdentificationError for data that show no step response.
    """
    sampled(t_s, axis, nu=nu)
    nu_ss = float(np.mean(nu[-max(2, round(_TAIL * len(nu))) :]))
    require_sign(tau, nu_ss)
    level = (1.0 - exp(-1.0) if drag == "constant" else tanh(1.0)) * nu_ss
    T_s = _first_crossing(t_s, np.asarray(nu, dtype=float), level)
    alpha, beta = from_type_0(tau, nu_ss, T_s, drag)
    residuals = nu - velocity_response(np.asarray(t_s), tau, alpha, beta, drag)
    marks = _not_steady(t_s, nu, T_s, drag) + saturated(np.array([tau]), tau_limit)
    return _result(
        "step response, Type 0", drag, axis, (alpha, beta), t=t_s, residuals=residuals, marks=marks, velocity=True
    )


def type_1(
    t_s: FloatArray,
    eta: FloatArray,
    tau: float,
    *,
    drag: Drag = "linear",
    axis: Axis = "angular",
    tau_limit: float | None = None,
) -> Identified:
    """Identify from a measured position or heading by slope and velocity error, Table 4.1.

    t_s: times from the step on, shape (n,); eta: position or unwrapped heading, shape (n,). The slope is fitted to the
    last third of the run.
    """
    sampled(t_s, axis, eta=eta)
    last = slice(2 * len(t_s) // 3, None)
    k_ss, eps_v = (float(x) for x in np.polyfit(t_s[last], eta[last], 1))
    require_sign(tau, k_ss)
    alpha, beta = from_type_1(tau, k_ss, eps_v, float(eta[0]), drag)
    require_physical({"alpha": alpha}, "the velocity error has the wrong sign: record from the step on")
    residuals = eta - position_response(np.asarray(t_s), tau, alpha, beta, drag, eta_0=float(eta[0]))
    T_s = time_constant(tau, alpha, beta, drag)
    marks = _ends_early(t_s, T_s, drag) + saturated(np.array([tau]), tau_limit)
    return _result(
        "step response, Type 1",
        drag,
        axis,
        (alpha, beta),
        t=t_s,
        residuals=residuals,
        marks=marks,
        velocity=False,
    )


def fit_response(
    t_s: FloatArray,
    tau: float,
    *,
    eta: FloatArray | None = None,
    nu: FloatArray | None = None,
    drag: Drag = "linear",
    axis: Axis = "linear",
    tau_limit: float | None = None,
) -> Identified:
    """Identify by fitting the whole response to eta (4.42), (4.46), or to nu (4.30), (4.35), with its covariance.

    Unlike the formulas it needs no steady state: it extrapolates, and says so.
    """
    given = [x for x in (eta, nu) if x is not None]
    if len(given) != 1:
        raise IdentificationError("give either eta or nu")
    t, y = np.asarray(t_s, dtype=float), np.asarray(given[0], dtype=float)
    sampled(t, axis, **({"eta": y} if eta is not None else {"nu": y}))

    def model(t: FloatArray, nu_ss: float, log_T: float, *eta_0: float) -> FloatArray:
        T = exp(min(log_T, 30.0))
        if eta is not None:
            return _travel(t, nu_ss, T, eta_0[0], drag)
        return nu_ss * (-np.expm1(-t / T) if drag == "constant" else np.tanh(t / T))

    start = _start(t, y, drag, velocity=eta is None)
    require_sign(tau, start[0])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", OptimizeWarning)  # data without any noise have no covariance
            best, covariance = curve_fit(model, t, y, start, maxfev=500)
    except RuntimeError:
        raise IdentificationError("no response to a step can be fitted: is t = 0 the step, and tau constant?") from None
    nu_ss, T_s = float(best[0]), exp(float(best[1]))
    alpha, beta = from_type_0(tau, nu_ss, T_s, drag)
    # alpha = T |tau| / |nu_ss|, beta = |tau| / |nu_ss|^p: relative errors add with these weights
    p = 1.0 if drag == "constant" else 2.0
    relative = np.array([[-1.0 / nu_ss, 1.0], [-p / nu_ss, 0.0]])
    known = np.isfinite(covariance).all()
    spread = np.sqrt(np.diag(relative @ covariance[:2, :2] @ relative.T)) if known else np.zeros(2)
    marks = _ends_early(t, T_s, drag) + saturated(np.array([tau]), tau_limit)
    return _result(
        "step response, whole fit",
        drag,
        axis,
        (alpha, beta),
        t=t,
        residuals=y - model(t, *best),
        marks=marks,
        velocity=eta is None,
        stds=(alpha * float(spread[0]), beta * float(spread[1])),
    )


def together(runs: Sequence[Identified]) -> Identified:
    """Return mean and standard deviation (ddof = 1) over runs of one method, as pladypos Table 2."""
    if not runs:
        raise IdentificationError("no runs to take the mean of")
    first = runs[0]
    if any((r.method, r.model) != (first.method, first.model) for r in runs):
        raise IdentificationError("runs of different methods or models have no common mean")
    summary = {p.name: mean_and_std(np.array([r[p.name] for r in runs])) for p in first.parameters}
    marks = tuple(f"run {i}: {w}" for i, r in enumerate(runs, 1) for w in r.warnings)
    axis: Axis = "linear" if first.parameter("alpha").unit == "kg" else "angular"
    return Identified(
        method=f"{first.method}, {len(runs)} runs",
        model=first.model,
        parameters=parameters(axis, {n: m for n, (m, _) in summary.items()}, {n: s for n, (_, s) in summary.items()}),
        data=DataUsed(sum(r.data.samples for r in runs), sum(r.data.duration_s for r in runs), len(runs), "runs"),
        citation=first.citation,
        warnings=marks,
        residuals=np.concatenate([r.residuals for r in runs]),
        residual_unit=first.residual_unit,
    )


def equal(one: Identified, other: Identified, name: str) -> tuple[float, float]:
    """Return (difference in %, difference in standard deviations) of one parameter of two results of many runs.

    The equality of surge and sway that pladypos section 6 leaves to future work: Welch's statistic of two means; below
    2 standard deviations they may be taken as equal.
    """
    a, b = one.parameter(name), other.parameter(name)
    error = sqrt(a.std**2 / one.data.pieces + b.std**2 / other.data.pieces)
    return 200.0 * (a.value - b.value) / (a.value + b.value), abs(a.value - b.value) / error


def _start(t: FloatArray, y: FloatArray, drag: Drag, *, velocity: bool) -> list[float]:
    """Return [nu_ss, log T] of a velocity or [nu_ss, log T, eta_0] of a position to begin a fit with."""
    last = slice(2 * len(t) // 3, None)
    if velocity:
        nu_ss = float(np.mean(y[last]))
        return [nu_ss, log(float(t[int(np.argmax(y / nu_ss >= 0.7))] - t[0]) + float(t[1] - t[0]))]
    k_ss, eps_v = (float(x) for x in np.polyfit(t[last], y[last], 1))
    T = (float(y[0]) - eps_v) / k_ss if k_ss else 0.0
    return [k_ss, log(max(T if drag == "constant" else T / log(2.0), 2.0 * float(t[1] - t[0]))), float(y[0])]


def _travel(t: FloatArray, nu_ss: float, T: float, eta_0: float, drag: Drag) -> FloatArray:
    """Return the integral of the velocity response, written so that it does not overflow at t >> T (4.46)."""
    if drag == "constant":
        return eta_0 + nu_ss * (t + T * np.expm1(-t / T))
    return eta_0 + nu_ss * (t + T * (np.log1p(np.exp(-2.0 * t / T)) - log(2.0)))


def _first_crossing(t: FloatArray, nu: FloatArray, level: float) -> float:
    """Return the time at which nu / level first reaches 1, between samples by a straight line."""
    above = np.flatnonzero(nu / level >= 1.0)
    k = int(above[0])
    if k == 0:
        raise IdentificationError("the run starts at its final speed: record from rest, with t = 0 at the step")
    return float(t[k - 1] + (t[k] - t[k - 1]) * (level - nu[k - 1]) / (nu[k] - nu[k - 1]))


def _share_reached(t_s: float, T_s: float, drag: Drag) -> float:
    return 1.0 - exp(-t_s / T_s) if drag == "constant" else tanh(t_s / T_s)


def _ends_early(t: FloatArray, T_s: float, drag: Drag) -> tuple[str, ...]:
    reached = _share_reached(float(t[-1]), T_s, drag)
    if reached >= STEADY:
        return ()
    return (f"ends at {100.0 * reached:.0f} % of its steady state below {100.0 * STEADY:.0f} %: formulas are biased",)


def _not_steady(t: FloatArray, nu: FloatArray, T_s: float, drag: Drag) -> tuple[str, ...]:
    """Mark a run by what a fit of the whole response says of its end: its own last tenth cannot tell."""
    thin = max(1, len(t) // 2000)  # a mark needs no more points
    t, nu = np.asarray(t)[::thin], np.asarray(nu)[::thin]
    scale = float(np.mean(nu[-max(2, round(_TAIL * len(nu))) :]))
    shape = (lambda t, k, T: k * -np.expm1(-t / T)) if drag == "constant" else (lambda t, k, T: k * np.tanh(t / T))
    try:
        (_, fitted), _ = curve_fit(shape, t, nu / scale, [1.0, T_s], bounds=([0.1, 0.01 * T_s], [1e3, 1e3 * T_s]))
    except RuntimeError:
        return ("no steady state could be fitted",)
    return _ends_early(t, float(fitted), drag)


def _result(
    method: str,
    drag: Drag,
    axis: Axis,
    values: tuple[float, float],
    *,
    t: FloatArray,
    residuals: FloatArray,
    marks: tuple[str, ...],
    velocity: bool,
    stds: tuple[float, float] = (float("nan"), float("nan")),
) -> Identified:
    (name,) = drag_of(drag)
    length = "m" if axis == "linear" else "rad"
    return Identified(
        method=method,
        model=f"{drag} drag",
        parameters=parameters(axis, {"alpha": values[0], name: values[1]}, {"alpha": stds[0], name: stds[1]}),
        data=DataUsed(len(t), float(t[-1] - t[0]), 1, "runs"),
        citation="pladypos (5)-(10), thesis 4.3",
        warnings=marks,
        residuals=np.asarray(residuals, dtype=float),
        residual_unit=f"{length}/s" if velocity else length,
    )
