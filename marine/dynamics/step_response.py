"""What a step response of one uncoupled degree of freedom comes to, thesis 4.3, pladypos 4.

The responses themselves are in `marine.identification.step`.

They hold for drag of one kind, constant or linear (thesis (2.34)); others raise ValueError. tau is the step in N or Nm.
"""

from __future__ import annotations

import math

from marine.vessel import DegreeOfFreedom


def steady_speed(dof: DegreeOfFreedom, tau: float) -> float:
    """Return the speed in m/s or rad/s at which drag balances tau, for drag of any kind: (4.31), (4.36) together."""
    b, q = dof.beta, dof.beta_quadratic
    if b == 0.0 and q == 0.0:
        raise ValueError("without drag there is no steady speed")
    size = abs(tau)
    return math.copysign(2.0 * size / (b + math.sqrt(b * b + 4.0 * q * size)), tau) if tau else 0.0


def time_constant(dof: DegreeOfFreedom, tau: float) -> float:
    """Return T_L = alpha / beta (4.32) or T_N = alpha / sqrt(beta_quadratic |tau|) (4.37), in s.

    After it the response has reached 63 % (4.33) or 76 % (4.38) of the steady speed.
    """
    if _drag_is_constant(dof):
        return dof.alpha / dof.beta
    return dof.alpha / math.sqrt(dof.beta_quadratic * abs(tau))


def velocity_error(dof: DegreeOfFreedom, tau: float, eta_0: float = 0.0) -> float:
    """Return lim (eta(t) - k_ss t), in m or rad: (4.44) or (4.48)."""
    if _drag_is_constant(dof):
        return eta_0 - dof.alpha * tau / dof.beta**2
    return eta_0 - math.copysign(dof.alpha / dof.beta_quadratic * math.log(2.0), tau)


def _drag_is_constant(dof: DegreeOfFreedom) -> bool:
    if (dof.beta > 0.0) == (dof.beta_quadratic > 0.0):
        raise ValueError("closed forms hold for drag of one kind: beta or beta_quadratic")
    return dof.beta > 0.0
