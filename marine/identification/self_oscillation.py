"""Identification by use of self-oscillations (IS-O) with describing functions: thesis chapter 6."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marine.identification.checks import saturated
from marine.identification.describing_function import relay, type_k, with_delay
from marine.identification.harmonic import velocity
from marine.identification.oscillation import Oscillation, measure, whole_periods
from marine.identification.result import (
    Axis,
    DataUsed,
    Drag,
    FloatArray,
    IdentificationError,
    Identified,
    drag_of,
    parameters,
    require_physical,
)


def marine_parameters(o: Oscillation, delay_s: float = 0.0) -> dict[str, float]:
    """Return alpha, beta and beta_quadratic of alpha eta'' + beta(nu) nu = tau + Delta: Table 6.3, (6.38)-(6.43).

    Only one of the two drags holds; which one, two experiments tell (`model_choice`). (6.43) corrected: see
    docs/errata.md. delay_s: known delay of the loop, (6.31). Units follow those of the oscillation (SI: m or rad).
    """
    gain = with_delay(relay(o.C, o.x_a, o.X_m, o.x_0).gain, o.omega, delay_s)
    return {
        "alpha": gain.real / o.omega**2,
        "beta": -gain.imag / o.omega,
        "beta_quadratic": -3.0 * np.pi / 8.0 * gain.imag / (o.X_m * o.omega**2),
    }


def from_record(
    t_s: FloatArray,
    eta: FloatArray,
    tau: FloatArray,
    *,
    reference: float = 0.0,
    drag: Drag = "linear",
    axis: Axis = "angular",
    delay_s: float = 0.0,
    tau_limit: float | None = None,
) -> Identified:
    """Identify from a relay experiment with the formulas of Table 6.3, x_a corrected to x_a* (6.5).

    t_s, eta (unwrapped), tau: shape (n,). These formulas replace the oscillation by a sine: with purely quadratic drag
    they miss drag by up to 25 %; `harmonic.project` does not. delta: -mean(tau) + mean drag ((6.40), (6.44) corrected:
    see docs/errata.md).
    """
    if drag == "both":
        raise IdentificationError("one oscillation gives one drag coefficient: use harmonic.project for both")
    found, warnings = measure(t_s, eta, tau, reference=reference, axis=axis)
    every = marine_parameters(found, delay_s)
    (name,) = drag_of(drag)
    values = {"alpha": every["alpha"], name: every[name]}
    require_physical(values, "is the delay right, and is this a self-oscillation?")
    starts = whole_periods(np.asarray(tau, dtype=float))
    dt_s = float(t_s[-1] - t_s[0]) / (len(t_s) - 1)
    whole = slice(starts[0], starts[-1])
    delta = -float(np.mean(tau[whole]))
    if drag == "linear":
        nu = velocity(np.asarray(eta, dtype=float)[whole], dt_s, 2.0 * np.pi / found.omega)
        delta += values[name] * float(np.mean(np.abs(nu) * nu))
    return Identified(
        method="self-oscillation, describing function",
        model=f"{drag} drag",
        parameters=parameters(axis, values | {"delta": delta}),
        data=DataUsed(int(starts[-1] - starts[0]), float((starts[-1] - starts[0]) * dt_s), found.periods, "periods"),
        citation="thesis Table 6.3, (6.31), 6.5",
        warnings=warnings + saturated(np.asarray(tau), tau_limit),
    )


def transfer_function(
    gains: Sequence[complex],
    omegas: Sequence[float],
    n: int,
    m: int,
    *,
    integrators: int = 0,
    delay_s: float = 0.0,
    unit_gain: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return (a, b) of sum b_i s^i / (sum a_i s^i) / s^k exp(-s T_d), a_0 = 1: general matrix algorithm, (6.16)-(6.19).

    gains: describing function G_N of each experiment, omegas: its frequency in rad/s; n, m: orders of denominator and
    numerator; integrators: k of (6.25); delay_s: T_d of (6.31); unit_gain: b_0 = 1 is known, (6.51). a: shape (n + 1,),
    b: shape (m + 1,). Real and imaginary parts of sum a_i (jw)^i + G_N sum b_i (jw)^i = 0 (corrected: see
    docs/errata.md). Raises IdentificationError with too few or too similar experiments, (6.11).
    """
    known = 1 if unit_gain else 0
    unknowns = n + m + 1 - known
    if 2 * len(omegas) < unknowns:
        raise IdentificationError(f"{unknowns} parameters need {-(-unknowns // 2)} experiments, not {len(omegas)}")
    jw = 1j * np.asarray(omegas, dtype=float)
    G = np.array([with_delay(type_k(g, w, integrators), w, delay_s) for g, w in zip(gains, omegas, strict=True)])
    columns = [jw**i for i in range(1, n + 1)] + [G * jw**i for i in range(known, m + 1)]
    left = np.column_stack(columns)
    right = -np.ones_like(jw) - (G if unit_gain else 0.0)
    matrix, y = np.vstack([left.real, left.imag]), np.concatenate([right.real, right.imag])
    scale = np.linalg.norm(matrix, axis=0)
    theta, _, rank, _ = np.linalg.lstsq(matrix / scale, y, rcond=1e-10)
    if rank < unknowns:
        raise IdentificationError("the experiments are too similar: repeat one with another C or x_a")
    theta = theta / scale
    b = np.concatenate([[1.0], theta[n:]]) if unit_gain else theta[n:]
    return np.concatenate([[1.0], theta[:n]]), b


def heading_closed_loop(gains: Sequence[complex], omegas: Sequence[float]) -> dict[str, float]:
    """Return a_1, a_2, a_3, b_1 of (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1): (6.52, corrected: see docs/errata.md).

    gains, omegas: of two (or more) relay experiments on the reference of a heading controller (Fig. 6.9).
    """
    a, b = transfer_function(gains, omegas, 3, 1, unit_gain=True)
    return {"a_1": float(a[1]), "a_2": float(a[2]), "a_3": float(a[3]), "b_1": float(b[1])}
