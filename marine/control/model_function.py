"""Model functions: the closed loop that a controller is designed for, thesis (8.4)."""

from __future__ import annotations

import math

import numpy as np

Coefficients = tuple[float, ...]
"""(a1, ..., an) of G(s) = 1/(an s^n + ... + a1 s + 1), ai in s^i."""


def bessel(order: int, w0_rad_s: float) -> Coefficients:
    """Return Bessel's filter with characteristic frequency w0 as a model function.

    For n = 3: s^3 + 2.433 s^2 + 2.466 s + 1 with s/w0, thesis 8.1.1 (corrected: see docs/errata.md); that is
    scipy.signal.bessel(n, w0, analog=True, norm="phase"). The coefficients are those of the reverse Bessel
    polynomial, with s scaled so that the first and the last are equal.
    """
    n = order
    theta = [
        math.factorial(2 * n - k) // (2 ** (n - k) * math.factorial(k) * math.factorial(n - k)) for k in range(n + 1)
    ]
    s = theta[0] ** (1.0 / n) / w0_rad_s
    return tuple(theta[k] / theta[0] * s**k for k in range(1, n + 1))


def butterworth(order: int, w0_rad_s: float) -> Coefficients:
    """Return Butterworth's filter with cut-off w0; for n = 3: s^3 + 2 s^2 + 2 s + 1 with s/w0, thesis 8.1.2."""
    a = [1.0]
    for k in range(1, order + 1):
        angle = math.pi / (2.0 * order)
        a.append(a[-1] * math.cos((k - 1) * angle) / math.sin(k * angle))
    return tuple(a[k] / w0_rad_s**k for k in range(1, order + 1))


NAMED = {"bessel": bessel, "butterworth": butterworth}


def model_function(description: str, order: int, w0_rad_s: float) -> Coefficients:
    """Return the model function that a configuration describes: a name of NAMED at w0, or "a1,a2,..." as given.

    Raise ValueError when it is neither, is of another order or is not stable.
    """
    if description in NAMED:
        if not (math.isfinite(w0_rad_s) and w0_rad_s > 0.0):
            raise ValueError(f"w0 must be positive, not {w0_rad_s:g} rad/s")
        return NAMED[description](order, w0_rad_s)
    try:
        a = tuple(float(part) for part in description.split(","))
    except ValueError:
        names = " or ".join(NAMED)
        raise ValueError(f"{description!r} is no model function: {names}, or coefficients a1,a2,...") from None
    if len(a) != order:
        raise ValueError(f"a model function of order {order} has {order} coefficients a1,a2,..., not {len(a)}")
    if not all(math.isfinite(c) for c in a) or not is_stable((*a[::-1], 1.0)):
        raise ValueError(f"the model function {description} is not stable")
    return a


def is_stable(polynomial: tuple[float, ...]) -> bool:
    """Whether all roots of a polynomial (highest power first) lie in the left half-plane."""
    roots = np.roots(polynomial)
    return polynomial[0] != 0.0 and len(roots) == len(polynomial) - 1 and bool(np.all(roots.real < 0.0))
