"""Least squares on a recorded manoeuvre: thesis 4.2.

Model (2.33): alpha nu' + beta(nu) nu = tau + Delta, written as a regression for nu' (4.19)-(4.22, corrected: see
docs/errata.md) on differences, or on integrals over windows, which need no derivative of a quantised signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve, savgol_filter

from marine.identification.checks import sampled, saturated
from marine.identification.result import (
    Axis,
    DataUsed,
    Drag,
    FloatArray,
    IdentificationError,
    Identified,
    Parameter,
    drag_of,
    drag_warnings,
    parameters,
    require_physical,
)

_BATCHES = 50
"""Pieces of the record whose scores are taken as independent when the covariance is estimated."""
_ILL_CONDITIONED = 1e7


def regress(
    regressors: FloatArray, y: FloatArray, batches: int = _BATCHES
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (theta, covariance, residuals) of y = Phi theta, (4.15).

    regressors: Phi, shape (n, p); y: shape (n,). The covariance (p, p) allows for residuals that are correlated in
    time: sandwich estimate over batches of neighbouring rows, nan for no more batches than parameters. Raises
    IdentificationError when columns cannot be told apart.
    """
    n, p = regressors.shape
    if n < 2 * p:
        raise IdentificationError(f"{n} equations for {p} parameters: record longer")
    scale = np.linalg.norm(regressors, axis=0)
    if not (scale > 0.0).all():
        raise IdentificationError("a regressor is zero throughout: excite the vessel in this axis")
    phi = regressors / scale
    normal = phi.T @ phi
    if np.linalg.cond(normal) > _ILL_CONDITIONED:
        raise IdentificationError(
            "the data do not tell the parameters apart (force, motion and offset are proportional to each other): "
            "vary the force, in both directions"
        )
    inverse = np.linalg.inv(normal)
    theta = inverse @ (phi.T @ y)
    residuals = y - phi @ theta
    starts = np.unique(np.linspace(0, n, min(batches, n), endpoint=False, dtype=int))
    scores = np.add.reduceat(phi * residuals[:, None], starts, axis=0)
    few = len(starts) / (len(starts) - p) if len(starts) > p else np.nan
    covariance = few * inverse @ (scores.T @ scores) @ inverse
    return theta / scale, covariance / np.outer(scale, scale), residuals


def uncoupled(
    t_s: FloatArray,
    tau: FloatArray,
    *,
    nu: FloatArray | None = None,
    eta: FloatArray | None = None,
    drag: Drag = "linear",
    axis: Axis = "angular",
    window_s: float | None = None,
    delay_s: float = 0.0,
    tau_limit: float | None = None,
) -> Identified:
    """Identify alpha, drag and Delta of one degree of freedom: (4.20) for constant drag, (4.22) for linear drag.

    t_s, tau, nu, eta: shape (n,); tau[k] acts from t[k] to t[k+1]. Give the velocity nu, or only the position or
    heading eta (unwrapped), from which nu is then the difference quotient. window_s: None for Euler's differences as
    in the thesis; a time for integrals: both sides are weighted with a smooth window of this length and integrated by
    parts (modulating functions), so that nothing is differentiated. Take a third of the time between changes of tau.
    delay_s: known delay from tau to motion. tau_limit: the actuators' limit, for a warning.
    """
    signals = {"tau": tau} | ({} if nu is None else {"nu": nu}) | ({} if eta is None else {"eta": eta})
    dt_s = sampled(t_s, axis, **signals)
    if nu is None and eta is None:
        raise IdentificationError("neither velocity nu nor position eta is given")
    force = _delayed(np.asarray(tau, dtype=float), delay_s, dt_s)
    build = _differences if window_s is None else _integrals
    y, force, nu_used, one = build(dt_s, force, nu, eta, window_s or 0.0)
    powers = {"constant": [nu_used.constant], "linear": [nu_used.quadratic]}
    columns = [-x for x in (powers["constant"] + powers["linear"] if drag == "both" else powers[drag])]
    theta, covariance, residuals = regress(np.column_stack([*columns, force, one]), y)
    names = (*drag_of(drag), "alpha", "delta")
    values, stds = _physical(names, theta, covariance)
    require_physical(values, "excite the vessel more")
    how = "Euler's differences" if window_s is None else f"integrals over {window_s:g} s"
    return Identified(
        method=f"least squares, {how}",
        model=f"{drag} drag",
        parameters=parameters(axis, values, stds),
        data=DataUsed(len(t_s), float(t_s[-1] - t_s[0]), len(y), "equations"),
        citation="thesis (4.20)" if drag == "constant" else "thesis (4.22)",
        warnings=drag_warnings(values) + saturated(np.asarray(tau), tau_limit),
        residuals=residuals,
        residual_unit="m/s^2" if axis == "linear" else "rad/s^2",
    )


def coupled(t_s: FloatArray, nu: FloatArray, tau: FloatArray, *, drag: Drag = "constant") -> dict[str, Identified]:
    """Identify surge, sway and yaw with their couplings, (4.17), (4.18, corrected: one product column).

    nu: [u v r], tau: [X Y N], shape (n, 3) each. Parameters of each result: theta_1 of the drag (theta_1 |nu| with drag
    "linear"), theta_2 of the product (r v, u r, u v), theta_3 of the force (absent where no force acts), delta. Surge's
    theta_2 and sway's are negative reciprocals of each other if the model holds; a warning says by how much not.
    """
    products = {"surge": nu[:, 2] * nu[:, 1], "sway": nu[:, 0] * nu[:, 2], "yaw": nu[:, 0] * nu[:, 1]}
    found: dict[str, Identified] = {}
    for i, (name, product) in enumerate(products.items()):
        axis: Axis = "angular" if name == "yaw" else "linear"
        dt_s = sampled(t_s, axis, **{"nu": nu[:, i]})
        x = nu[:-1, i]
        driven = np.ptp(tau[:, i]) > 0.0
        columns = [x * np.abs(x) if drag == "linear" else x, product[:-1], np.ones_like(x)]
        names = ["theta_1", "theta_2", "delta"]
        if driven:
            columns.insert(2, tau[:-1, i])
            names.insert(2, "theta_3")
        theta, covariance, residuals = regress(np.column_stack(columns), np.diff(nu[:, i]) / dt_s)
        stds = np.sqrt(np.diag(covariance))
        units = _coupled_units(axis, drag)
        found[name] = Identified(
            method="least squares, coupled",
            model=f"{drag} drag, coupled",
            parameters=tuple(
                Parameter(n, float(v), units[n], float(s)) for n, v, s in zip(names, theta, stds, strict=True)
            ),
            data=DataUsed(len(t_s), float(t_s[-1] - t_s[0]), len(x), "equations"),
            citation="thesis (4.18)",
            warnings=("theta_1 is positive: no drag was found",) if theta[0] > 0.0 else (),
            residuals=residuals,
            residual_unit="m/s^2" if axis == "linear" else "rad/s^2",
        )
    reciprocity = found["surge"]["theta_2"] * found["sway"]["theta_2"]
    if not 0.8 < -reciprocity < 1.25:
        warning = f"theta_2 of surge and sway should multiply to -1, not to {reciprocity:.2f}: poor excitation of sway"
        found = {name: one.warned(warning) for name, one in found.items()}
    return found


class RecursiveLeastSquares:
    """Least squares that takes one sample after the other, for a running system: (4.3)-(4.8) with forgetting.

    forgetting: weight of the past per sample, 1 for none (then it ends where `uncoupled` on differences ends).
    """

    def __init__(self, dt_s: float, *, drag: Drag = "linear", axis: Axis = "angular", forgetting: float = 1.0) -> None:
        self.names = (*drag_of(drag), "alpha", "delta")
        self._dt_s, self._drag, self._axis, self._forgetting = dt_s, drag, axis, forgetting
        self._theta: FloatArray = np.zeros(len(self.names))
        self._P: FloatArray = 1e12 * np.eye(len(self.names))
        self._last: tuple[float, float] | None = None
        self._squares, self._weight, self._samples = 0.0, 0.0, 0

    def update(self, nu: float, tau: float) -> None:
        """Take the velocity now and the force that acts from now on."""
        if self._last is not None:
            nu_0, tau_0 = self._last
            self.take((nu - nu_0) / self._dt_s, (nu_0, abs(nu_0) * nu_0), tau_0)
        self._last = (nu, tau)

    def take(self, acceleration: float, drags: tuple[float, float], tau: float) -> None:
        """Take one equation: nu', (nu, |nu| nu) and tau at one time, or weighted over one window."""
        terms = {"constant": drags[:1], "linear": drags[1:], "both": drags}[self._drag]
        phi = np.array([*(-x for x in terms), tau, 1.0])
        error = acceleration - float(phi @ self._theta)
        P_phi = self._P @ phi
        denominator = self._forgetting + float(phi @ P_phi)
        self._theta = self._theta + P_phi * (error / denominator)
        P = (self._P - np.outer(P_phi, P_phi) / denominator) / self._forgetting
        self._P = 0.5 * (P + P.T)
        self._squares = self._forgetting * self._squares + error**2 * self._forgetting / denominator
        self._weight = self._forgetting * self._weight + 1.0
        self._samples += 1

    def result(self) -> Identified:
        """Return what is known by now; raises IdentificationError before there is anything to know."""
        if self._samples < 2 * len(self.names):
            raise IdentificationError(f"{self._samples} samples are too few")
        variance = self._squares / max(self._weight - len(self.names), 1.0)
        values, stds = _physical(self.names, self._theta, self._P * variance)
        require_physical(values, "excite the vessel more")
        return Identified(
            method="least squares, recursive",
            model=f"{self._drag} drag",
            parameters=parameters(self._axis, values, stds),
            data=DataUsed(self._samples + 1, self._samples * self._dt_s, self._samples, "equations"),
            citation="thesis (4.3)-(4.8), (4.20), (4.22)",
            warnings=drag_warnings(values),
        )


@dataclass(frozen=True)
class _Drags:
    """The two drag terms before their coefficients: nu and |nu| nu."""

    constant: FloatArray
    quadratic: FloatArray


_Equations = tuple[FloatArray, FloatArray, _Drags, FloatArray]


def _differences(
    dt_s: float, tau: FloatArray, nu: FloatArray | None, eta: FloatArray | None, _window_s: float
) -> _Equations:
    """Return (nu', tau, drags, 1) by Euler's forward difference."""
    if nu is None:
        assert eta is not None
        nu, tau = np.diff(np.asarray(eta, dtype=float)) / dt_s, tau[:-1]
    nu = np.asarray(nu, dtype=float)
    x = nu[:-1]
    return np.diff(nu) / dt_s, tau[:-1], _Drags(x, np.abs(x) * x), np.ones_like(x)


def _integrals(
    dt_s: float, tau: FloatArray, nu: FloatArray | None, eta: FloatArray | None, window_s: float
) -> _Equations:
    """Return (nu', tau, drags, 1) weighted with phi over a window and integrated by parts.

    phi(s) = (1 - s^2)^3, s in [-1, 1]: zero with its first two derivatives at the ends, so that
    int phi nu' = -int phi' nu = int phi'' eta and no boundary terms are left.
    """
    half = half_window(window_s, dt_s)
    if len(tau) < 6 * half:
        raise IdentificationError(f"{len(tau) * dt_s:.1f} s are too short for windows of {window_s:g} s")
    phi, phi_1, phi_2 = window_functions(half, dt_s)

    def weighted(x: FloatArray, kernel: FloatArray) -> FloatArray:
        out: FloatArray = fftconvolve(x, kernel[::-1], mode="valid")
        return out

    # tau[k] is held from t[k] to t[k+1]: as a point function it is the mean of its two neighbours
    tau = np.concatenate([[tau[0]], 0.5 * (tau[1:] + tau[:-1])])
    if nu is not None:
        v = np.asarray(nu, dtype=float)
        y, drag, inner = -weighted(v, phi_1), weighted(v, phi), v
    else:
        assert eta is not None
        x = np.asarray(eta, dtype=float)
        origin = x - x[0]
        y, drag = weighted(origin, phi_2), -weighted(origin, phi_1)
        inner = np.gradient(smoothed(x, max(2, half // 2)), dt_s)
    quadratic = weighted(np.abs(inner) * inner, phi)
    stride = max(1, half // 4)
    y, force = y[::stride], weighted(tau, phi)[::stride]
    return y, force, _Drags(drag[::stride], quadratic[::stride]), np.ones_like(y)


def half_window(window_s: float, dt_s: float) -> int:
    """Return half the samples of a window of that length in s."""
    return max(2, round(window_s / dt_s / 2))


def window_functions(half: int, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return phi of `_integrals` and its first two derivatives, shape (2 half + 1,) each."""
    phi = (1.0 - (np.arange(-half, half + 1) / half) ** 2) ** 3
    phi /= np.sum(phi)
    # differences of the sampled window, not samples of its derivatives: constants and straight lines cancel exactly
    padded = np.concatenate([[0.0], phi, [0.0]])
    return phi, (padded[2:] - padded[:-2]) / (2.0 * dt_s), (padded[2:] - 2.0 * phi + padded[:-2]) / dt_s**2


def smoothed(x: FloatArray, half: int) -> FloatArray:
    """Return x after a Savitzky-Golay filter of third order: |nu| nu cannot do without a derivative."""
    out: FloatArray = savgol_filter(x, 2 * half + 1, 3) if half > 1 else x
    return out


def _delayed(tau: FloatArray, delay_s: float, dt_s: float) -> FloatArray:
    """Return tau as it acts after a delay; parts of a sample count as a mean of neighbours."""
    if delay_s == 0.0:
        return tau
    steps = delay_s / dt_s
    k = int(steps)
    part = steps - k
    padded = np.concatenate([np.full(k + 1, tau[0]), tau])
    return (1.0 - part) * padded[1 : len(tau) + 1] + part * padded[: len(tau)]


def _physical(
    names: tuple[str, ...], theta: FloatArray, covariance: FloatArray
) -> tuple[dict[str, float], dict[str, float]]:
    """Return (values, standard deviations) of [drag.. alpha delta] from theta = [drag/alpha.. 1/alpha delta/alpha]."""
    force = names.index("alpha")
    inverse = float(theta[force])
    values = {n: float(theta[i]) / inverse for i, n in enumerate(names)}
    values["alpha"] = 1.0 / inverse
    stds: dict[str, float] = {}
    for i, name in enumerate(names):
        gradient = np.zeros(len(names))
        gradient[i] = 1.0 / inverse
        gradient[force] = -values[name] / inverse
        stds[name] = float(np.sqrt(gradient @ covariance @ gradient))
    return {n: values[n] for n in ("alpha", *names[:force], "delta")}, stds


def _coupled_units(axis: Axis, drag: Drag) -> dict[str, str]:
    if axis == "linear":
        return {"theta_1": "1/m" if drag == "linear" else "1/s", "theta_2": "1", "theta_3": "1/kg", "delta": "m/s^2"}
    theta_1 = "1/rad" if drag == "linear" else "1/s"
    return {"theta_1": theta_1, "theta_2": "rad/m^2", "theta_3": "1/(kg m^2)", "delta": "rad/s^2"}
