"""Simulation examples of thesis chapter 6: a static second-order process (6.1), the width of a relay (Fig. 6.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import cont2discrete, tf2ss

from marine.identification.describing_function import relay
from marine.identification.oscillation import Oscillation, measure
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import FloatArray
from marine.identification.self_oscillation import marine_parameters, transfer_function
from marine.vessel import DegreeOfFreedom

SECOND_ORDER = ((2.0,), (1.0, 1.2, 0.5))
"""Example 6.1 gives the equations of n = 2, m = 0 without numbers; b_0 and a_0, a_1, a_2 are chosen."""
SECOND_ORDER_RELAYS = ((1.0, 0.3), (1.0, 0.8))
"""(C, x_a) of the two experiments that (6.11) asks for; chosen."""
_K, _T = 50.0, 0.3
"""Example 6.3: 50/(s (0.3 s + 1))."""


@dataclass(frozen=True)
class WidthError:
    """Errors in % of K and T of Example 6.3, for a width x_a as set and for x_a* as switched (6.5)."""

    x_a: float
    switched: float
    as_set: tuple[float, float]
    modified: tuple[float, float]


def around_process(
    b: Sequence[float], a: Sequence[float], C: float, x_a: float, *, dt_s: float, duration_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (t, y, u) of a relay with hysteresis around a linear process, exact between samples; shape (n,) each.

    b, a: coefficients by rising powers of s; u = relay(-y) once in dt_s, held.
    """
    A, B, out, _, _ = cont2discrete(tf2ss(list(b)[::-1], list(a)[::-1]), dt_s)
    n = round(duration_s / dt_s)
    x, u = np.zeros((A.shape[0], 1)), C
    y_out, u_out = np.empty(n), np.empty(n)
    for k in range(n):
        y = (out @ x).item()
        u = C if -y >= x_a else -C if -y <= -x_a else u
        y_out[k], u_out[k] = y, u
        x = A @ x + B * u
    return np.arange(n, dtype=float) * dt_s, y_out, u_out


@cache
def second_order() -> tuple[FloatArray, FloatArray, tuple[Oscillation, ...]]:
    """Return (a, b, oscillations) of Example 6.1: the process found by (6.16)-(6.19) from two simulated experiments."""
    oscillations = []
    for C, x_a in SECOND_ORDER_RELAYS:
        t, y, u = around_process(*SECOND_ORDER, C, x_a, dt_s=0.002, duration_s=30.0)
        half = len(t) // 2
        oscillations.append(measure(t[half:], y[half:], u[half:], axis="linear")[0])
    gains = [relay(o.C, o.x_a, o.X_m, o.x_0).gain for o in oscillations]
    a, b = transfer_function(gains, [o.omega for o in oscillations], 2, 0)
    return a, b, tuple(oscillations)


@cache
def width_errors(dt_s: float) -> tuple[WidthError, ...]:
    """Return the errors of Fig. 6.3 for x_a from 5 to 20, sampled once in dt_s."""
    widths = np.arange(5.0, 20.01, 0.5)
    loop = RelayLoop(DegreeOfFreedom(_T / _K, 1.0 / _K, 0.0), 1.0, widths, sample_time_s=dt_s)
    t, etas, taus = loop.run(60.0, runs=len(widths), steps=1)
    half = len(t) // 2
    out = []
    for k, x_a in enumerate(widths.tolist()):
        o, _ = measure(t[half:], etas[half:, k], taus[half:, k], axis="linear")
        out.append(WidthError(x_a, o.x_a, _percent(Oscillation(o.C, x_a, o.X_m, o.omega)), _percent(o)))
    return tuple(out)


def _percent(o: Oscillation) -> tuple[float, float]:
    p = marine_parameters(o)
    K, T = 1.0 / p["beta"], p["alpha"] / p["beta"]
    return 100.0 * (K / _K - 1.0), 100.0 * (T / _T - 1.0)
