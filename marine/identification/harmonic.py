"""Identification by projection on the first harmonics, without the assumption that the oscillation is a sine.

The formulas of thesis Table 6.3 take the drag of a pure sine; a relay drives no pure sine, and drag is off by up to
25 % (docs/errata.md). Here the model alpha eta'' + beta(nu) nu = tau + Delta is multiplied by w(t) exp(-j k omega t),
k = 0 ... 3, and integrated over the *measured* tau and eta; the drag term is built from the measured harmonics of eta.
That balance holds for any tau: relay, zig-zag, sine, settled or not.

w lasts one and a half periods: half a period of a Hann window, flat for half a period, and down again. It falls to
zero smoothly, so that eta'' can be integrated by parts and no boundary terms remain. One begins every quarter of a
period: but for its ends all of the record counts the same, as in least squares. With one harmonic and one window the
equations would be as many as the parameters, and whatever the model leaves out would go into drag.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dct, dst
from scipy.interpolate import CubicSpline

from marine.identification.checks import sampled, saturated
from marine.identification.least_squares import regress
from marine.identification.oscillation import FEWEST, period
from marine.identification.result import (
    Axis,
    DataUsed,
    Drag,
    FloatArray,
    IdentificationError,
    Identified,
    drag_of,
    drag_warnings,
    parameters,
    require_physical,
)

HARMONICS = 9
"""Harmonics of eta that the velocity is built from; a relay's wave has little beyond."""
_PROJECTED = 3
"""Harmonics whose balances are used besides the mean, where each has enough samples a period."""
_SAMPLES = 8
"""Fewest samples of a period of the highest of these."""
_QUARTER = 16
"""Fewest points of a quarter of a period that the integrals are made with."""


def velocity(eta: FloatArray, dt_s: float, period_s: float) -> FloatArray:
    """Return nu of a record from its first harmonics, shape (n,): a sine series about the line between its ends.

    eta: shape (n,), unwrapped, any length; period_s: of the oscillation. Faster than its ninth harmonic is noise.
    """
    n, duration_s = len(eta), (len(eta) - 1) * dt_s
    line = np.linspace(eta[0], eta[-1], n)
    modes = np.arange(1, n - 1)
    series = dst(eta[1:-1] - line[1:-1], type=1) / (n - 1)
    series[modes > 2.0 * HARMONICS * duration_s / period_s] = 0.0
    slopes = np.concatenate([[0.0], 0.5 * series * np.pi * modes / duration_s, [0.0]])
    out: FloatArray = dct(slopes, type=1) + (eta[-1] - eta[0]) / duration_s
    return out


def project(
    t_s: FloatArray,
    eta: FloatArray,
    tau: FloatArray,
    *,
    drag: Drag = "linear",
    axis: Axis = "angular",
    delay_s: float = 0.0,
    tau_limit: float | None = None,
) -> Identified:
    """Identify alpha, drag and Delta from an oscillation by projection on its first harmonics.

    t_s, eta (unwrapped), tau: shape (n,); tau[k] acts from t[k] + delay_s to t[k+1] + delay_s. delay_s: known delay of
    the whole loop from tau to the measured eta. Standard deviations come from the spread between periods (nan for too
    few of them). Raises IdentificationError for less than two periods.
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    eta, tau = np.asarray(eta, dtype=float), np.asarray(tau, dtype=float)
    T_s = period(tau) * dt_s
    n = (len(tau) - 1) * dt_s / T_s
    if n < FEWEST:
        raise IdentificationError(f"{n:.2f} whole oscillations are too few: record {FEWEST} at least, better 5")
    if T_s < _SAMPLES * dt_s:
        raise IdentificationError(
            f"{T_s / dt_s:.0f} samples a period are too few: sample at least {_SAMPLES} times a period"
        )
    fine = int(T_s / dt_s / 4 / _QUARTER / 2)
    if fine > 1:  # more points a period than the integrals need: means of neighbours, tau held from the first of them
        eta, tau = (x[: len(x) // fine * fine].reshape(-1, fine).mean(axis=1) for x in (eta, tau))
        delay_s -= 0.5 * (fine - 1) * dt_s
        dt_s *= fine
    phi, y = _equations(eta, tau, T_s, dt_s, delay_s=delay_s, drag=drag)
    names = (*drag_of(drag), "alpha", "delta")
    theta, covariance, residuals = regress(phi, y, batches=int(n))
    values = {name: float(theta[names.index(name)]) for name in ("alpha", *names[:-2], "delta")}
    require_physical(values, "record more oscillations")
    spread = np.sqrt(np.diag(covariance))
    warnings = drag_warnings(values) + saturated(tau, tau_limit)
    if n < 5:
        warnings += (f"only {int(n)} whole oscillations (the thesis takes 5)",)
    return Identified(
        method="projection on the first harmonics",
        model=f"{drag} drag",
        parameters=parameters(axis, values, {name: float(spread[names.index(name)]) for name in values}),
        data=DataUsed(len(t_s), float(t_s[-1] - t_s[0]), int(n), "periods"),
        citation="thesis (6.33), harmonics without (6.41)'s sine; docs/errata.md",
        warnings=warnings,
        residuals=residuals,
        residual_unit="N" if axis == "linear" else "Nm",
    )


def _equations(
    eta: FloatArray, tau: FloatArray, T_s: float, dt_s: float, *, delay_s: float, drag: Drag
) -> tuple[FloatArray, FloatArray]:
    """Return (Phi, y) of the balances of all windows, shapes (m, p) and (m,): [drags, alpha, delta] and the force.

    All signals are put on the middles of cells that divide a quarter of a period; tau, which is held, as their means.
    """
    quarter = max(_QUARTER, round(T_s / dt_s / 4.0))
    h_s = T_s / 4.0 / quarter
    t_s = np.arange(len(tau), dtype=float) * dt_s
    edges_s = np.arange(max(delay_s, 0.0), t_s[-1], h_s)  # the force before the record is not known
    middles_s = 0.5 * (edges_s[1:] + edges_s[:-1])
    nu = CubicSpline(t_s, velocity(eta, dt_s, T_s))(middles_s)
    impulse = np.concatenate([[0.0], np.cumsum(tau) * dt_s])
    force = np.diff(np.interp(edges_s - delay_s, np.append(t_s, t_s[-1] + dt_s), impulse)) / h_s
    weights, bends = _kernels(quarter, T_s, min(_PROJECTED, int(T_s / dt_s / _SAMPLES)))
    terms = {"constant": [nu], "linear": [np.abs(nu) * nu], "both": [nu, np.abs(nu) * nu]}[drag]
    curve = CubicSpline(t_s, eta - np.linspace(eta[0], eta[-1], len(eta)))(middles_s)  # a line has no acceleration

    def integrals(y: FloatArray, kernels: FloatArray) -> FloatArray:
        out: FloatArray = (sliding_window_view(y, len(kernels))[::quarter] @ kernels).ravel()
        return out

    columns = [integrals(term, weights) for term in terms]
    columns += [integrals(curve, bends), -integrals(np.ones_like(nu), weights)]
    return np.column_stack(columns), integrals(force, weights)


def _kernels(quarter: int, T_s: float, harmonics: int) -> tuple[FloatArray, FloatArray]:
    """Return w exp(-j k omega t) and its second derivative, real and imaginary parts, over one window.

    Shapes (6 quarter, 2 harmonics + 1); each column of the first times a signal is its mean over a period.
    """
    s = 2.0 * np.pi * (np.arange(6 * quarter) + 0.5) / (4 * quarter)  # omega t
    out = np.minimum(s, 3.0 * np.pi - s)  # from the nearer end
    tapered, side = out < np.pi, np.where(s < 1.5 * np.pi, 1.0, -1.0)
    w = np.where(tapered, 0.5 * (1.0 - np.cos(out)), 1.0)
    slope = np.where(tapered, 0.5 * side * np.sin(out), 0.0)
    bend = np.where(tapered, 0.5 * np.cos(out), 0.0)
    omega_2 = (2.0 * np.pi / T_s) ** 2
    weights, bends = [w], [bend * omega_2]
    for k in range(1, harmonics + 1):
        carrier = np.exp(-1j * k * s)
        second = omega_2 * (bend - 2j * k * slope - k**2 * w) * carrier
        weights += [w * carrier.real, w * carrier.imag]
        bends += [second.real, second.imag]
    return np.column_stack(weights) / (4 * quarter), np.column_stack(bends) / (4 * quarter)
