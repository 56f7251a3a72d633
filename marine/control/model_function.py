"""Model functions: the closed loop that a controller is designed for, thesis (8.4)."""

from __future__ import annotations

import math


def bessel(order: int, w0_rad_s: float) -> tuple[float, ...]:
    """Return (a1, ..., an) of G(s) = 1/(an s^n + ... + a1 s + 1): Bessel's filter with characteristic frequency w0.

    For n = 3: s^3 + 2.433 s^2 + 2.466 s + 1 with s/w0, thesis 8.1.1 (corrected: see docs/errata.md); that is
    scipy.signal.bessel(n, w0, analog=True, norm="phase"). The coefficients are those of the reverse Bessel
    polynomial, with s scaled so that the first and the last are equal. ai in s^i.
    """
    n = order
    theta = [
        math.factorial(2 * n - k) // (2 ** (n - k) * math.factorial(k) * math.factorial(n - k)) for k in range(n + 1)
    ]
    s = theta[0] ** (1.0 / n) / w0_rad_s
    return tuple(theta[k] / theta[0] * s**k for k in range(1, n + 1))
