"""Line following, thesis 8.3: by the yaw rate (Method 1) or by the heading loop that there is (Method 2).

d is the distance from the line, positive to starboard of it; phi = psi - gamma the heading relative to the line; u_r
the surge speed that a law is designed for. Both laws keep d at zero and approach it at the angle beta-bar.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from marine.control.base import within
from marine.control.model_function import Coefficients
from marine.control.structures import TransferFunction
from marine.vessel import DegreeOfFreedom

SLOWEST = 0.9
"""Part of u_r below which (8.47) does not believe the measured speed: a vessel that starts would turn on the spot."""


# Method 1: direct


@dataclass(frozen=True)
class DirectGains:
    """K_I, K_P of the yaw rate (Nm/rad, Nm s/rad) and K_P, K_D of the distance (rad/(s m), rad/m), (8.45), (8.47)."""

    integral_r: float
    proportional_r: float
    proportional_d: float
    derivative_d: float

    @classmethod
    def design(cls, alpha_r: float, a: Coefficients, u_r_m_s: float) -> DirectGains:
        """Return (8.49) for the model function a: (a1, a2, a3, a4) of d/d_ref; raise ValueError unless u_r > 0."""
        if not u_r_m_s > 0.0:
            raise ValueError(f"line following needs a surge speed above zero, not {u_r_m_s} m/s")
        a1, a2, a3, a4 = a
        return cls(a2 / a4 * alpha_r, a3 / a4 * alpha_r, 1.0 / (u_r_m_s * a2), a1 / (u_r_m_s * a2))


class DirectLine:
    """The yaw moment of Algorithm 8.6: I-P of the yaw rate (8.45) inside (8.47), its distance limited as in (8.58).

    The drag is compensated with the model's; anti-windup is back-calculation (8.29). Corrected: see docs/errata.md
    ((8.45) is I-P, (8.57) has K_D/K_P).
    """

    def __init__(
        self,
        yaw: DegreeOfFreedom,
        a: Coefficients,
        u_r_m_s: float,
        *,
        N_nm: float,
        approach_rad: float = math.radians(30.0),
        current_m_s: float = 0.0,
    ) -> None:
        """a: (a1, a2, a3, a4); N_nm: largest |N|; approach_rad: beta-bar; current_m_s: largest |nu| across the line.

        Raise ValueError when the current is too strong for the approach angle, (8.57), or the angle is none.
        """
        if not 0.0 < approach_rad < math.pi / 2.0:
            raise ValueError(
                f"the approach angle must lie between 0 and 90 degrees, not {math.degrees(approach_rad):g}"
            )
        room = u_r_m_s * math.sin(approach_rad) - current_m_s
        if room <= 0.0:
            raise ValueError(
                f"a current of {current_m_s:g} m/s is too much for {u_r_m_s:g} m/s at "
                f"{math.degrees(approach_rad):g} degrees, thesis (8.57): go faster or steeper"
            )
        self.gains = DirectGains.design(yaw.alpha, a, u_r_m_s)
        self.d_max_m = self.gains.derivative_d / self.gains.proportional_d * room
        self._yaw, self._u_r, self._limit = yaw, u_r_m_s, N_nm
        self._tracking_s = 0.5 * math.sqrt(a[3] / a[1])
        self.reset()

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = self._missing = 0.0

    def follow(self, N_nm: float, r_rad_s: float) -> None:
        """Take over without a jump: the next demand at a yaw rate, without time passing, is N."""
        self._missing = 0.0
        self._integral = N_nm + self.gains.proportional_r * r_rad_s - self._yaw.drag(r_rad_s)

    def reference(self, d_m: float, phi_rad: float, u_m_s: float, v_m_s: float) -> float:
        """Return the wanted yaw rate in rad/s, (8.58), with d' over ground from u and v."""
        speed = max(u_m_s, SLOWEST * self._u_r)
        d_dot = speed * math.sin(phi_rad) + v_m_s * math.cos(phi_rad)
        return -self.gains.proportional_d * within(d_m, self.d_max_m) - self.gains.derivative_d * d_dot

    def step(  # noqa: PLR0917
        self,
        dt_s: float,
        d_m: float,
        phi_rad: float,
        nu: tuple[float, float, float],
        missing: float = 0.0,
        turning_rad_s: float = 0.0,
    ) -> float:
        """Return N in Nm.

        nu: [u v r] over ground; missing: what the actuators gave less than N before, Nm; turning_rad_s: rate at which
        the line itself turns before the vessel, on a curve.
        """
        u, v, r = nu
        g = self.gains
        error = self.reference(d_m, phi_rad, u, v) + turning_rad_s - r
        self._integral += g.integral_r * error * dt_s + min(1.0, dt_s / self._tracking_s) * (self._missing + missing)
        wanted = self._integral - g.proportional_r * r + self._yaw.drag(r)
        N = within(wanted, self._limit)
        self._missing = N - wanted
        return N


# Method 2: indirect


@dataclass(frozen=True)
class HeadingLoop:
    """psi/psi_ref = (b1 s + 1) / (a3 s^3 + a2 s^2 + a1 s + 1), (8.50); a3 = 0 after Algorithm 8.7, (8.51)."""

    a1: float
    a2: float
    a3: float = 0.0
    b1: float = 0.0

    @classmethod
    def of(cls, loop: TransferFunction) -> HeadingLoop:
        """Return the loop that a design of Table 8.1 gives; raise ValueError for PID, which has two zeros."""
        a1, a2, a3 = (*(a / loop.denominator[-1] for a in loop.denominator[-2::-1]), 0.0)[:3]
        zeros = [b / loop.numerator[-1] for b in loop.numerator[-2::-1]]
        if len(zeros) > 1:
            raise ValueError("a heading loop may have one zero, (8.50): not PID")
        return cls(a1, a2, a3, *zeros)

    def simplified(self) -> HeadingLoop:
        """Return the loop without its fastest real pole p, b1 + 1/p in its place: Algorithm 8.7.

        The poles come from numpy.roots, not from Cardano's formulas, which fail for three real ones (D < 0, see
        docs/errata.md). An identified a3 that is not positive is below what two experiments resolve and is left out.
        Raise ValueError when the loop is not stable.
        """
        if self.a3 <= 0.0:
            simple = HeadingLoop(self.a1, self.a2, 0.0, self.b1)
        else:
            poles = np.roots([self.a3, self.a2, self.a1, 1.0])
            p = min(pole.real for pole in poles if abs(pole.imag) < 1e-9 * abs(pole))
            # (a3 s^3 + a2 s^2 + a1 s + 1) = (1 - s/p)(a2' s^2 + a1' s + 1)
            simple = HeadingLoop(self.a1 + 1.0 / p, -p * self.a3, 0.0, self.b1 + 1.0 / p)
        if min(simple.a1, simple.a2) <= 0.0:
            raise ValueError("the heading loop is not stable: repeat the self-oscillations, or mend its controller")
        return simple


@dataclass(frozen=True)
class IndirectGains:
    """Gains of (8.52): K_r in s, K_psi without unit, K_d in rad/m, K_Id in rad/(m s)."""

    K_r: float
    K_psi: float
    K_d: float
    K_Id: float

    @classmethod
    def design(cls, loop: HeadingLoop, a: Coefficients, u_r_m_s: float) -> IndirectGains:
        """Return the solution of (8.54) for a simplified loop and d/d_ref's model function a: (a1, a2, a3, a4).

        (8.53) has s^4 in front: its a_i are the model function's over a4. Raise ValueError when there is none.
        """
        if not u_r_m_s > 0.0:
            raise ValueError(f"line following needs a surge speed above zero, not {u_r_m_s} m/s")
        c1, c2, c3, c4 = a
        a0, a1, a2, a3 = 1.0 / c4, c1 / c4, c2 / c4, c3 / c4
        b, u = loop.b1, u_r_m_s
        matrix = np.array([[1 - a3 * b, b, 0, 0], [-a2 * b, 1, b * u, 0], [-a1 * b, 0, u, u * b], [-a0 * b, 0, 0, u]])
        right = np.array([a3 * loop.a2 - loop.a1, a2 * loop.a2 - 1.0, a1 * loop.a2, a0 * loop.a2])
        try:
            K_r, K_psi, K_d, K_Id = np.linalg.solve(matrix, right).tolist()
        except np.linalg.LinAlgError:
            raise ValueError("no gains give this model function: take another w0") from None
        return cls(K_r, K_psi, K_d, K_Id)


class IndirectLine:
    """The heading reference of Algorithm 8.8: (8.52) limited to the approach angle (8.59), with anti-windup (8.29).

    K_psi takes sin(phi), of which phi is the small-angle form (2.51): where phi jumps, half a turn away from the line,
    the reference would change sides and the vessel sail away between two ways to turn.
    """

    def __init__(
        self,
        loop: HeadingLoop,
        a: Coefficients,
        u_r_m_s: float,
        *,
        approach_rad: float = math.radians(30.0),
    ) -> None:
        """loop: as identified (it is simplified here); a: (a1, a2, a3, a4); approach_rad: beta-bar."""
        if not 0.0 < approach_rad < math.pi / 2.0:
            raise ValueError(
                f"the approach angle must lie between 0 and 90 degrees, not {math.degrees(approach_rad):g}"
            )
        self.gains = IndirectGains.design(loop.simplified(), a, u_r_m_s)
        self.limit_rad = approach_rad
        """Largest angle to the line that is demanded, (8.59)."""
        self._tracking_s = 0.5 * a[3] ** 0.25
        self.reset()

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = self._missing = 0.0

    def step(self, dt_s: float, d_m: float, phi_rad: float, r_rad_s: float) -> float:
        """Return the wanted heading relative to the line, in rad."""
        g = self.gains
        self._integral += -g.K_Id * d_m * dt_s + min(1.0, dt_s / self._tracking_s) * self._missing
        wanted = self._integral - g.K_psi * math.sin(phi_rad) - g.K_r * r_rad_s - g.K_d * d_m
        limited = within(wanted, self.limit_rad)
        self._missing = limited - wanted
        return limited
