"""Describing functions: the gain of a nonlinear element for a sine x = x_0 + X_m sin(omega t), thesis 5.1."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from marine.identification.result import FloatArray, IdentificationError

Nonlinearity = Callable[[FloatArray], FloatArray]
"""Maps a waveform to the output waveform, both shape (n,); hysteresis may look back along it."""

_POINTS = 8192


class DescribingFunction(NamedTuple):
    """Y_0 + (P + j Q) x*, (5.9)."""

    P: float
    Q: float
    Y_0: float

    @property
    def gain(self) -> complex:
        """G_N = P + j Q (5.7)."""
        return complex(self.P, self.Q)


def relay(C: float, x_a: float, X_m: float, x_0: float = 0.0) -> DescribingFunction:
    """Return the describing function of a relay with hysteresis, (5.11), (5.13), (5.14); with x_0 = 0 (5.15).

    C: output (N, Nm); x_a: hysteresis, X_m: amplitude, x_0: bias of the input (all m or rad). Raises
    IdentificationError unless x_a + |x_0| < X_m (7.12): then the relay does not switch twice a period.
    """
    if not x_a + abs(x_0) < X_m:
        raise IdentificationError(
            f"no self-oscillation: hysteresis {x_a:.4g} with bias {abs(x_0):.4g} is not below the amplitude {X_m:.4g}; "
            "choose a larger relay output or a smaller hysteresis"
        )
    up, down = (x_a - x_0) / X_m, (x_a + x_0) / X_m
    return DescribingFunction(
        P=2.0 * C / (np.pi * X_m) * float(np.sqrt(1.0 - up**2) + np.sqrt(1.0 - down**2)),
        Q=-4.0 * C * x_a / (np.pi * X_m**2),
        Y_0=C / np.pi * float(np.arcsin(down) - np.arcsin(up)),
    )


def numeric(nonlinearity: Nonlinearity, X_m: float, x_0: float = 0.0) -> DescribingFunction:
    """Return the describing function of any nonlinearity by quadrature of (5.10, corrected: see docs/errata.md)."""
    first = harmonic(nonlinearity, X_m, x_0, 1)
    return DescribingFunction(first.real / X_m, first.imag / X_m, harmonic(nonlinearity, X_m, x_0, 0).real)


def harmonic(nonlinearity: Nonlinearity, X_m: float, x_0: float, k: int) -> complex:
    """Return Y_Pk + j Y_Qk of the output (5.4); for k = 0 the mean Y_0."""
    phase = 2.0 * np.pi * (np.arange(2 * _POINTS) + 0.5) / _POINTS
    y = nonlinearity(x_0 + X_m * np.sin(phase))[_POINTS:]  # the second period: hysteresis has settled
    phase = phase[_POINTS:]
    if k == 0:
        return complex(np.mean(y))
    return complex(2.0 * np.mean(y * np.sin(k * phase)), 2.0 * np.mean(y * np.cos(k * phase)))


def relay_output(x: FloatArray, C: float, x_a: float) -> FloatArray:
    """Return what a relay with hysteresis makes of a waveform: +C after x >= x_a, -C after x <= -x_a (Fig. 5.1)."""
    level = np.where(x >= x_a, 1, np.where(x <= -x_a, -1, 0))
    decided = np.maximum.accumulate(np.where(level != 0, np.arange(len(x)), -1))
    return np.where(decided >= 0, C * level[decided], -C).astype(float)


def type_k(gain: complex, omega: float, k: int) -> complex:
    """Return the describing function that takes over k integrators of the process, (6.25): rotated by -90 k degrees."""
    return gain / (1j * omega) ** k


def with_delay(gain: complex, omega: float, delay_s: float) -> complex:
    """Return the describing function that takes over a delay of the process, (6.31)."""
    return complex(gain * np.exp(-1j * omega * delay_s))
