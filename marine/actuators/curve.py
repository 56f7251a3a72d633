"""Static thrust characteristics of a propeller and their exact inverses, thesis (2.4), (2.7), (2.8).

Every form is a quadratic for each direction of rotation, so that one curve with a closed inverse covers them all:
purely quadratic, affine (2.7), asymmetric (2.8), quadratic and then straight, and bilinear (2.4) at a given speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Side:
    """One direction of rotation: a n^2 + b n for 0 <= n <= knee, then straight with `slope`, continuously.

    a: N per squared command; b, slope: N per command; knee: command.
    """

    a: float
    b: float = 0.0
    knee: float = math.inf
    slope: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what has no inverse: ValueError."""
        if not all(map(math.isfinite, (self.a, self.b, self.slope))) or math.isnan(self.knee):
            raise ValueError(f"thrust characteristic {self}: not a number")
        rises = self.a > 0.0 or (self.a == 0.0 and self.b > 0.0)
        if not rises or self.knee <= 0.0 or (self.knee < math.inf and self.slope <= 0.0):
            raise ValueError(f"thrust characteristic {self}: thrust must grow with the command")

    def thrust(self, n: float) -> float:
        """Return the size of the thrust in N at a command n >= 0. With b < 0 small commands give less than zero."""
        if n > self.knee:
            return (self.a * self.knee + self.b) * self.knee + self.slope * (n - self.knee)
        return (self.a * n + self.b) * n

    def command(self, thrust_n: float) -> float:
        """Return the command n >= 0 that gives a thrust > 0 in N, exactly; 0 for none."""
        if thrust_n <= 0.0:
            return 0.0
        if self.knee < math.inf:
            above = thrust_n - (self.a * self.knee + self.b) * self.knee
            if above > 0.0:
                return self.knee + above / self.slope
        root = math.sqrt(self.b * self.b + 4.0 * self.a * thrust_n)
        return 2.0 * thrust_n / (self.b + root) if self.b >= 0.0 else (root - self.b) / (2.0 * self.a)


@dataclass(frozen=True, slots=True)
class ThrustCurve:
    """tau(n) in N of a signed command n, thesis (2.8): one quadratic forward, one backward."""

    forward: Side
    backward: Side

    @classmethod
    def quadratic(cls, k_t: float) -> ThrustCurve:
        """Return tau = k_t |n| n, pladypos (1) and thesis (2.7) with b = 0. k_t in N per squared command."""
        return cls(Side(k_t), Side(k_t))

    @classmethod
    def affine(cls, a: float, b: float) -> ThrustCurve:
        """Return tau = a |n| n + b n, thesis (2.7)."""
        return cls(Side(a, b), Side(a, b))

    @classmethod
    def asymmetric(cls, a_f: float, b_f: float, a_b: float, b_b: float) -> ThrustCurve:
        """Return thesis (2.8): coefficients of their own for turning forward and backward."""
        return cls(Side(a_f, b_f), Side(a_b, b_b))

    @classmethod
    def bilinear(cls, T_nn: float, T_nu: float, u_a: float) -> ThrustCurve:
        """Return thesis (2.4), tau = T_nn |n| n - T_nu |n| u_a, at the ambient water speed u_a in m/s.

        In water that comes from ahead a propeller must turn at T_nu u_a / T_nn before it pushes forward at all; below
        that it brakes. The inverse is the branch that drives: forward thrust by turning faster than that, backward
        thrust by turning backward.
        """
        return cls(Side(T_nn, -T_nu * u_a), Side(T_nn, T_nu * u_a))

    def thrust(self, n: float) -> float:
        """Return the thrust in N of a signed command."""
        return self.forward.thrust(n) if n >= 0.0 else -self.backward.thrust(-n)

    def command(self, thrust_n: float) -> float:
        """Return the signed command whose thrust in N is the given one, exactly."""
        return self.forward.command(thrust_n) if thrust_n > 0.0 else -self.backward.command(-thrust_n)
