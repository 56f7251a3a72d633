"""Identification by projection on the first harmonic, without the assumption that the oscillation is a sine.

The formulas of thesis Table 6.3 take the drag of a pure sine; a relay drives no pure sine, and drag is off by up to
25 % (docs/errata.md). Here the model alpha eta'' + beta(nu) nu = tau + Delta is multiplied by w(t) exp(-j k omega t)
and integrated over whole periods of the *measured* tau and eta; the drag term is built from the measured harmonics of
eta. That balance holds for any periodic tau: relay, zig-zag, sine.

w is a Hann window over two periods: for a periodic motion it changes nothing (harmonics stay orthogonal), and where the
motion has not settled or drifts it removes the boundary terms, since eta'' is integrated by parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marine.identification.checks import sampled, saturated
from marine.identification.oscillation import whole_periods
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

ComplexArray = NDArray[np.complex128]


def velocity(eta: FloatArray, dt_s: float, periods: int) -> FloatArray:
    """Return nu of a record of whole periods from its first harmonics (Fourier series), shape (n,).

    eta: shape (n,), unwrapped. The straight line between the ends is taken out first, so that a drift is no jump.
    """
    n = len(eta)
    slope = (eta[-1] - eta[0]) / (n - 1)
    spectrum = np.fft.rfft(eta - eta[0] - slope * np.arange(n))
    spectrum[HARMONICS * periods + 1 :] = 0.0
    line = 2j * np.pi * np.arange(len(spectrum)) / (n * dt_s)
    out: FloatArray = np.fft.irfft(line * spectrum, n) + slope / dt_s
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
    """Identify alpha, drag and Delta from an oscillation by projection on its first harmonic.

    t_s, eta (unwrapped), tau: shape (n,); tau[k] acts from t[k] + delay_s to t[k+1] + delay_s. delay_s: known delay of
    the whole loop from tau to the measured eta. drag "both" adds the third harmonic, which needs a clean eta. Standard
    deviations come from pairs of periods (nan for fewer than three pairs).
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    starts = whole_periods(np.asarray(tau, dtype=float))
    n, first, last = len(starts) - 1, int(starts[0]), int(starts[-1])
    if last - first < 8 * n:
        raise IdentificationError(
            f"{(last - first) // n} samples a period are too few: sample at least 8 times a period"
        )
    eta, tau = np.asarray(eta, dtype=float), np.asarray(tau, dtype=float)
    phi, y = _equations(eta, tau, (first, last, n), dt_s, delay_s=delay_s, drag=drag)
    names = (*drag_of(drag), "alpha", "delta")
    whole = np.linalg.lstsq(phi.sum(axis=0), y.sum(axis=0), rcond=None)[0]
    values = {name: float(whole[names.index(name)]) for name in ("alpha", *names[:-2], "delta")}
    require_physical(values, "record more oscillations")
    single = (np.linalg.pinv(phi) @ y[:, :, None])[:, :, 0]
    enough = len(single) > 2
    spread = np.std(single, axis=0, ddof=1) / np.sqrt(len(single)) if enough else np.full(len(names), np.nan)
    warnings = drag_warnings(values) + saturated(np.asarray(tau), tau_limit)
    if n < 5:
        warnings += (f"only {n} whole oscillations (the thesis takes 5)",)
    return Identified(
        method="projection on the first harmonic",
        model=f"{drag} drag",
        parameters=parameters(axis, values, {name: float(spread[names.index(name)]) for name in values}),
        data=DataUsed(last - first, (last - first) * dt_s, n, "periods"),
        citation="thesis (6.33), first harmonic without (6.41)'s sine; docs/errata.md",
        warnings=warnings,
        residuals=(y - (phi @ whole)).ravel(),
        residual_unit="N" if axis == "linear" else "Nm",
    )


def _equations(
    eta: FloatArray, tau: FloatArray, span: tuple[int, int, int], dt_s: float, *, delay_s: float, drag: Drag
) -> tuple[FloatArray, FloatArray]:
    """Return (Phi, y) of each window, shapes (windows, m, p) and (windows, m): mean, first (and third) harmonic."""
    first, last, n = span
    balance = _Balance(n, (last - first) * dt_s)
    time = np.arange(last - first, dtype=float) * dt_s
    position = eta[first:last]
    nu = velocity(position, dt_s, n)
    terms = {"constant": [nu], "linear": [np.abs(nu) * nu], "both": [nu, np.abs(nu) * nu]}[drag]
    acts = (np.arange(len(tau), dtype=float) - first + 0.5) * dt_s + delay_s  # the middle of the time tau is held
    rows, right = [], []
    for k in (0, 1, 3) if drag == "both" else (0, 1):
        columns = [balance.integral(time, term, k) for term in terms]
        columns.append(balance.integral(time, position - np.mean(position), k, derivative=2))
        columns.append(-balance.integral(time, np.ones_like(nu), k))
        force = balance.integral(acts, tau, k) * np.sinc(k * n / (last - first))  # held over a sample, not a point
        left = np.stack(columns, axis=1)
        rows += [left.real, left.imag] if k else [left.real]
        right += [force.real, force.imag] if k else [force.real]
    return np.stack(rows, axis=1), np.stack(right, axis=1)


class _Balance:
    """Integrals over Hann windows of two periods each, one starting every period."""

    def __init__(self, periods: int, duration_s: float) -> None:
        self.periods, self.duration_s = periods, duration_s

    def integral(self, time: FloatArray, y: FloatArray, k: int, derivative: int = 0) -> ComplexArray:
        """Return the mean of y^(derivative) w exp(-j k omega t) over each window, shape (periods - 1,).

        time: s from the beginning of the first period, equally spaced; y: shape (n,). A second derivative (the only one
        that is needed) is moved to the window: (w exp)'' = (w'' - 2 j k omega w' - (k omega)^2 w) exp.
        """
        period = self.duration_s / self.periods
        at = time / period
        inside = (at >= 0.0) & (at < self.periods)
        at, y = at[inside], y[inside]
        number = np.minimum(at.astype(int), self.periods - 1)
        s = np.pi * (at - number)
        carrier = y * np.exp(-2j * np.pi * k * at)
        rise, slope, bend = (
            0.5 * (1.0 - np.cos(s)),
            0.5 * np.pi / period * np.sin(s),
            0.5 * (np.pi / period) ** 2 * np.cos(s),
        )
        omega = 2.0 * np.pi * k / period
        if derivative == 2:
            up = bend - 2j * omega * slope - omega**2 * rise
            down = -bend + 2j * omega * slope - omega**2 * (1.0 - rise)
        else:
            up, down = rise.astype(complex), (1.0 - rise).astype(complex)
        sums = [self._sum(number, carrier * part) for part in (up, down)]
        step = float(time[1] - time[0])
        mean: ComplexArray = (sums[0][:-1] + sums[1][1:]) * step / period
        return mean

    def _sum(self, number: NDArray[np.intp], values: ComplexArray) -> ComplexArray:
        parts = [np.bincount(number, weights=x, minlength=self.periods) for x in (values.real, values.imag)]
        total: ComplexArray = parts[0] + 1j * parts[1]
        return total
