"""Thruster mapping, thesis 4.1: from commands and thrusts measured on a bench to a characteristic with an inverse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from marine.actuators import Side, ThrustCurve
from marine.identification.result import DataUsed, FloatArray, IdentificationError, Identified, Parameter

MODELS = ("quadratic", "affine", "asymmetric", "quadratic_linear")
"""Kinds of thrusters in a vessel file that can be fitted."""

_PER_SIDE = 4
_WORTH_A_WARNING = 0.05


@dataclass(frozen=True)
class ThrusterMap:
    """A fitted characteristic: the result, the curve in N over the command, and Bayes' information criterion."""

    identified: Identified
    curve: ThrustCurve
    bic: float

    @property
    def begins(self) -> float:
        """Size of the command at which the curve begins to push on both sides: a dead zone must be no smaller."""
        return max(-side.b / side.a if side.b < 0.0 else 0.0 for side in (self.curve.forward, self.curve.backward))


def fit_thruster(
    commands: FloatArray, thrusts_n: FloatArray, model: str | None = None, dead_zone: float = 0.0
) -> ThrusterMap:
    """Return the least-squares fit of a thrust characteristic, thesis (2.8) and its simpler relatives.

    commands, thrusts_n: shape (n,), one row per measurement; model: one of MODELS, None for the one with the lowest
    information criterion among those that have an inverse; dead_zone: commands up to this size are left out, since
    friction holds the propeller there. Raise IdentificationError with reason and remedy for data that do not suffice
    or a fit without an inverse.
    """
    n, tau = _checked(commands, thrusts_n, dead_zone)
    if model is not None:
        return _FITS[model](n, tau)
    maps = []
    reasons = []
    for fit in _FITS.values():
        try:
            maps.append(fit(n, tau))
        except IdentificationError as error:
            reasons.append(str(error))
    if not maps:
        raise IdentificationError("; ".join(reasons))
    return min(maps, key=lambda m: m.bic)


def dead_zone_of(commands: FloatArray, thrusts_n: FloatArray) -> float:
    """Return the largest command below which every thrust is negligible: under 1 % of the largest; 0.0 if none is."""
    size, small = np.abs(commands), np.abs(thrusts_n) < 0.01 * np.abs(thrusts_n).max()
    working = size[~small & (size > 0.0)]
    resting = size[small & (size < working.min(initial=math.inf))]
    return float(resting.max(initial=0.0))


def _checked(commands: FloatArray, thrusts_n: FloatArray, dead_zone: float) -> tuple[FloatArray, FloatArray]:
    n, tau = np.asarray(commands, dtype=float), np.asarray(thrusts_n, dtype=float)
    if n.shape != tau.shape or n.ndim != 1:
        raise IdentificationError(f"{n.size} commands and {tau.size} thrusts: give one thrust for each command")
    if bad := int(np.sum(~np.isfinite(n) | ~np.isfinite(tau))):
        raise IdentificationError(f"{bad} rows are not numbers: take them out")
    works = np.abs(n) > dead_zone
    n, tau = n[works], tau[works]
    for name, side in (("forward", n > 0.0), ("backward", n < 0.0)):
        if len(np.unique(n[side])) < _PER_SIDE:
            raise IdentificationError(
                f"{len(np.unique(n[side]))} commands {name} outside the dead zone: measure at least {_PER_SIDE}"
            )
    if np.sum(n * tau) <= 0.0:
        raise IdentificationError("thrust falls where the command grows: turn the sign of one of the columns")
    return n, tau


def _linear(
    kind: str, n: FloatArray, tau: FloatArray, regressors: dict[str, FloatArray], units: dict[str, str]
) -> tuple[dict[str, float], Identified, float]:
    """Return parameter values, result and information criterion of tau = sum of parameter times regressor."""
    names = list(regressors)
    Phi = np.column_stack([regressors[name] for name in names])
    theta, _, rank, _ = np.linalg.lstsq(Phi, tau, rcond=None)
    if rank < len(names):
        raise IdentificationError(f"{kind}: these commands cannot tell {', '.join(names)} apart: measure more of them")
    residuals = tau - Phi @ theta
    freedom = len(n) - len(names)
    variance = float(residuals @ residuals) / max(freedom, 1)
    stds = np.sqrt(np.diag(variance * np.linalg.inv(Phi.T @ Phi)))
    identified = Identified(
        method="thruster",
        model=kind,
        parameters=tuple(
            Parameter(name, float(value), units[name], float(std) if freedom > 0 else math.nan)
            for name, value, std in zip(names, theta, stds, strict=True)
        ),
        data=DataUsed(len(n), 0.0, len(np.unique(n)), "command"),
        citation="thesis 4.1, (2.7), (2.8)",
        residuals=residuals,
        residual_unit="N",
    )
    rms = identified.residual_rms
    if rms > _WORTH_A_WARNING * np.abs(tau).max():
        identified = identified.warned(f"{kind} leaves {rms:.3g} N unexplained: try another model or measure again")
    floor = 1e-12 * float(np.abs(tau).max())
    bic = len(n) * math.log(max(rms, floor) ** 2) + len(names) * math.log(len(n))
    return dict(zip(names, theta.tolist(), strict=True)), identified, bic


_A, _B = "N/command^2", "N/command"


def _quadratic(n: FloatArray, tau: FloatArray) -> ThrusterMap:
    value, identified, bic = _linear("quadratic", n, tau, {"k_t": np.abs(n) * n}, {"k_t": _A})
    return ThrusterMap(identified, _invertible("quadratic", n, _side("quadratic", value["k_t"], 0.0)), bic)


def _affine(n: FloatArray, tau: FloatArray) -> ThrusterMap:
    value, identified, bic = _linear("affine", n, tau, {"a": np.abs(n) * n, "b": n}, {"a": _A, "b": _B})
    return ThrusterMap(identified, _invertible("affine", n, _side("affine", value["a"], value["b"])), bic)


def _asymmetric(n: FloatArray, tau: FloatArray) -> ThrusterMap:
    ahead, astern = np.maximum(n, 0.0), np.minimum(n, 0.0)
    regressors = {"a_f": ahead**2, "b_f": ahead, "a_b": -(astern**2), "b_b": astern}
    value, identified, bic = _linear("asymmetric", n, tau, regressors, {"a_f": _A, "b_f": _B, "a_b": _A, "b_b": _B})
    forward = _side("asymmetric, forward", value["a_f"], value["b_f"])
    backward = _side("asymmetric, backward", value["a_b"], value["b_b"])
    return ThrusterMap(identified, _invertible("asymmetric", n, forward, backward), bic)


def _quadratic_linear(n: FloatArray, tau: FloatArray) -> ThrusterMap:
    """Fit k_t n^2 up to a knee and a line from there; the knee by search, the rest by least squares for each knee."""
    size = np.unique(np.abs(n))

    def at(knee: float) -> tuple[dict[str, float], Identified, float]:
        below, above = np.minimum(np.abs(n), knee), np.maximum(np.abs(n) - knee, 0.0)
        regressors = {"k_t": np.sign(n) * below**2, "slope": np.sign(n) * above}
        return _linear("quadratic_linear", n, tau, regressors, {"k_t": _A, "slope": _B})

    def cost(knee: float) -> float:
        return at(knee)[2]

    if len(size) < 5:
        raise IdentificationError("quadratic_linear: measure at least 5 different sizes of command")
    knee, spread = _search(cost, float(size[1]), float(size[-3]))
    value, identified, bic = at(knee)
    if value["k_t"] <= 0.0 or value["slope"] <= 0.0:
        raise IdentificationError("quadratic_linear: the fit falls somewhere and has no inverse: try another model")
    identified = replace(identified, parameters=(*identified.parameters, Parameter("knee", knee, "command", spread)))
    side = Side(value["k_t"], 0.0, knee, value["slope"])
    return ThrusterMap(identified, ThrustCurve(side, side), bic + math.log(len(n)))


def _search(cost: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return the least of n log(rms^2) over the knee and its standard deviation, from the curvature there."""
    from scipy.optimize import minimize_scalar

    grid = np.linspace(low, high, 41)
    best = int(np.argmin([cost(float(knee)) for knee in grid]))
    bounds = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 40)])
    knee = float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-9 * high}).x)
    step = 0.02 * (high - low)
    curvature = (cost(knee + step) - 2.0 * cost(knee) + cost(knee - step)) / step**2
    return knee, math.sqrt(2.0 / curvature) if curvature > 0.0 else math.nan


def _side(name: str, a: float, b: float) -> Side:
    try:
        return Side(a, b)
    except ValueError:
        raise IdentificationError(f"{name}: the fit a = {a:.4g}, b = {b:.4g} falls and has no inverse") from None


def _invertible(kind: str, n: FloatArray, forward: Side, backward: Side | None = None) -> ThrustCurve:
    """Return the curve; raise IdentificationError when it falls within the commands that were measured."""
    backward = backward or forward
    for side, sizes in ((forward, n[n > 0.0]), (backward, -n[n < 0.0])):
        least = float(sizes.min())
        if side.thrust(least) <= 0.0 or side.b + 2.0 * side.a * least <= 0.0:
            raise IdentificationError(
                f"{kind}: the fit (b = {side.b:.4g}) brakes at a command of {least:g}: state a larger dead zone, or "
                "take another model"
            )
    return ThrustCurve(forward, backward)


_FITS: dict[str, Callable[[FloatArray, FloatArray], ThrusterMap]] = {
    "quadratic": _quadratic,
    "affine": _affine,
    "asymmetric": _asymmetric,
    "quadratic_linear": _quadratic_linear,
}
