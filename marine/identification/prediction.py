"""What a relay experiment will do, before it is made: existence, amplitude, frequency; thesis 5.2, 5.4 (Goldfarb)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from marine.vessel import DegreeOfFreedom


@dataclass(frozen=True)
class Prediction:
    """Expected self-oscillation; X_m is None when none exists, and `reason` says why."""

    X_m: float | None
    omega: float | None
    reason: str = ""


def goldfarb(G: Callable[[float], complex], C: float, x_a: float, omegas: tuple[float, float]) -> Prediction:
    """Return where G(j omega) = -1/G_N(X_m), (5.35), for a relay with hysteresis and a linear process.

    G: frequency response; omegas: range of frequencies that is searched (rad/s). The inverse negative describing
    function of this relay is -pi/(4 C) (sqrt(X_m^2 - x_a^2) + j x_a): a line of constant imaginary part, so that the
    frequency comes from Im G alone and X_m from |G|.
    """
    offset = np.pi * x_a / (4.0 * C)

    def distance(omega: float) -> float:
        return G(omega).imag + offset

    for omega in _roots(distance, omegas):
        value = G(omega)
        if value.real < 0.0 and abs(value) > offset * (1.0 + 1e-6):
            return Prediction(4.0 * C * abs(value) / np.pi, omega)
    return Prediction(None, None, "the Nyquist curve does not meet -1/G_N: the relay would not oscillate")


def oscillation(dof: DegreeOfFreedom, C: float, x_a: float, delay_s: float = 0.0) -> Prediction:
    """Return the expected self-oscillation of one degree of freedom with both forms of drag, (5.17).

    C: N or Nm; x_a: m or rad. |nu| nu counts as 8/(3 pi) X_m omega nu. Without a delay x_a = 0 does not oscillate
    (thesis Fig. 7.2).
    """
    q = 8.0 / (3.0 * np.pi) * dof.beta_quadratic

    def amplitude(omega: float) -> float:
        """X_m at which |G| = pi X_m/(4 C): alpha, drag and amplitude balance the relay."""
        low, high = 0.0, 4.0 * C / np.pi / (dof.alpha * omega**2)

        def excess(X: float) -> float:
            return X * abs(complex(dof.alpha * omega**2, (dof.beta + q * X * omega) * omega)) - 4.0 * C / np.pi

        return float(brentq(excess, low, high * (1.0 + 1e-9))) if excess(high) > 0.0 else high

    def distance(omega: float) -> float:
        X = amplitude(omega)
        process = np.exp(-1j * omega * delay_s) / complex(-dof.alpha * omega**2, (dof.beta + q * X * omega) * omega)
        return float(process.imag) + np.pi * x_a / (4.0 * C)

    # omega of an oscillation with the amplitude x_a and no drag bounds the search from above, generously
    scale = np.sqrt(4.0 * C / (np.pi * dof.alpha * max(x_a, 1e-12)))
    top = scale if delay_s == 0.0 else min(scale, np.pi / delay_s)
    for omega in _roots(distance, (1e-3 * top, 10.0 * top if delay_s == 0.0 else top)):
        X_m = amplitude(omega)
        if X_m > x_a * (1.0 + 1e-6):
            return Prediction(X_m, omega)
    return Prediction(
        None, None, "no self-oscillation: hysteresis is too wide for this output, or zero without a delay in the loop"
    )


def _roots(f: Callable[[float], float], limits: tuple[float, float]) -> list[float]:
    grid = np.geomspace(*limits, 400)
    values = np.array([f(float(w)) for w in grid])
    crossings = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    return [float(brentq(f, grid[i], grid[i + 1], xtol=1e-12)) for i in crossings]
