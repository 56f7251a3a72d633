"""Identification by projection on the first harmonic, without the assumption that the oscillation is a sine.

The formulas of thesis Table 6.3 take the drag of a pure sine; a relay drives no pure sine, and drag is off by up to 25
% (docs/errata.md). Here the model alpha eta'' + beta(nu) nu = tau + Delta is multiplied by exp(-j omega t) and
integrated over whole periods of the *measured* tau and eta; the drag term is built from the measured harmonics of eta.
The balance of the first harmonic then holds exactly, for any periodic tau: relay, zig-zag, sine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marine.identification.checks import sampled, saturated
from marine.identification.oscillation import NDArrayInt, whole_periods
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

HARMONICS = 11
"""Harmonics of eta that the drag is built from; odd ones fall with the third power of their order."""
_PHASES = 128

ComplexArray = NDArray[np.complex128]


def coefficients(y: FloatArray, starts: NDArrayInt, orders: int, *, held: bool) -> ComplexArray:
    """Return the complex Fourier coefficients of each period, shape (periods, orders + 1).

    y = Re sum c_k exp(j k phase), shape (n,); starts: first sample of each period and the end of the last.
    held: y is held from one sample to the next (a command) and not a sampled curve. c_0 is the mean.
    """
    lengths = np.diff(starts)
    index = np.arange(starts[0], starts[-1])
    length = np.repeat(lengths, lengths)
    step = np.exp(-2j * np.pi * (index - np.repeat(starts[:-1], lengths)) / length)
    part = y[starts[0] : starts[-1]].astype(complex)
    out = np.empty((len(lengths), orders + 1), dtype=complex)
    for k in range(orders + 1):
        out[:, k] = np.add.reduceat(part, starts[:-1] - starts[0]) * (2.0 if k else 1.0) / lengths
        part *= step
        if held and k:
            turn = 2j * np.pi * k / lengths
            out[:, k] *= (1.0 - np.exp(-turn)) / turn
    return out


def velocity_wave(eta: ComplexArray, omega: FloatArray) -> FloatArray:
    """Return nu over one period from harmonics of eta, shape (periods, 128)."""
    k = np.arange(eta.shape[1])
    phase = np.exp(2j * np.pi * np.outer(k, np.arange(_PHASES) / _PHASES))
    out: FloatArray = ((1j * omega[:, None] * k * eta) @ phase).real
    return out


def mean_quadratic(eta: FloatArray, starts: NDArrayInt, dt_s: float) -> float:
    """Return the mean of |nu| nu over whole periods of a position: what drag takes out of a biased oscillation."""
    c = coefficients(eta, starts, HARMONICS, held=False).mean(axis=0, keepdims=True)
    nu = velocity_wave(c, np.array([2.0 * np.pi / (float(np.mean(np.diff(starts))) * dt_s)]))
    return float(np.mean(np.abs(nu) * nu))


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
    """Identify alpha, drag and Delta from an oscillation by projection on its first harmonic.

    t_s, eta (unwrapped), tau: shape (n,); tau[k] acts from t[k] + delay_s to t[k+1] + delay_s. delay_s: known delay of
    the whole loop from tau to the measured eta. drag "both" adds the third harmonic, which needs a clean eta. Standard
    deviations come from the single periods.
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    starts = whole_periods(np.asarray(tau, dtype=float))
    lengths = np.diff(starts)
    if np.min(lengths) < 8:
        raise IdentificationError(f"{np.min(lengths)} samples a period are too few: sample at least 8 times a period")
    # one period is not measured to better than a sample, all of them together are: the mean has the exact balance
    eta_k = coefficients(np.asarray(eta, dtype=float), starts, HARMONICS, held=False)
    tau_k = coefficients(np.asarray(tau, dtype=float), starts, 3, held=True)
    omega = 2.0 * np.pi / (lengths * dt_s)
    mean_omega = np.array([2.0 * np.pi / (float(np.mean(lengths)) * dt_s)])
    names = (*drag_of(drag), "alpha", "delta")
    (whole,) = _balance(_mean(eta_k), _mean(tau_k), mean_omega, drag, delay_s)
    values = {n: float(whole[names.index(n)]) for n in ("alpha", *names[:-2], "delta")}
    require_physical(values, "record more oscillations")
    single = _balance(eta_k, tau_k, omega, drag, delay_s)
    spread = np.std(single, axis=0, ddof=1) / np.sqrt(len(single))
    warnings = drag_warnings(values) + saturated(np.asarray(tau), tau_limit)
    if len(lengths) < 5:
        warnings += (f"only {len(lengths)} whole oscillations: standard deviations are rough",)
    return Identified(
        method="projection on the first harmonic",
        model=f"{drag} drag",
        parameters=parameters(axis, values, {n: float(spread[names.index(n)]) for n in values}),
        data=DataUsed(int(starts[-1] - starts[0]), float((starts[-1] - starts[0]) * dt_s), len(lengths), "periods"),
        citation="thesis (6.33), first harmonic without (6.41)'s sine; docs/errata.md",
        warnings=warnings,
        residuals=single[:, names.index("alpha")] - values["alpha"],
        residual_unit="kg" if axis == "linear" else "kg m^2",
    )


def _mean(c: ComplexArray) -> ComplexArray:
    mean: ComplexArray = c.mean(axis=0, keepdims=True)
    return mean


def _balance(eta: ComplexArray, tau: ComplexArray, omega: FloatArray, drag: Drag, delay_s: float) -> FloatArray:
    """Return [drag.., alpha, delta] for each row of coefficients, shape (periods, p)."""
    nu = velocity_wave(eta, omega)
    terms = {"constant": [nu], "linear": [np.abs(nu) * nu], "both": [nu, np.abs(nu) * nu]}[drag]
    spectra = [np.fft.rfft(term, axis=1) * 2.0 / _PHASES for term in terms]
    orders = (1, 3) if drag == "both" else (1,)
    rows, right = [], []
    for k in orders:
        jw = 1j * k * omega
        force = tau[:, k] * np.exp(-jw * delay_s)
        columns = np.stack([*(s[:, k] for s in spectra), jw**2 * eta[:, k]], axis=1)
        rows += [columns.real, columns.imag]
        right += [force.real, force.imag]
    phi, y = np.stack(rows, axis=1), np.stack(right, axis=1)
    theta = (np.linalg.pinv(phi) @ y[:, :, None])[:, :, 0]
    mean_drag = sum(theta[:, i] * np.mean(term, axis=1) for i, term in enumerate(terms))
    return np.column_stack([theta, mean_drag - tau[:, 0].real])
