"""Robust stability of loops designed by a model function, thesis 8.1.2.

All conditions are Routh-Hurwitz at a frozen speed: (8.13) says K_D* + beta_true(nu) - beta_compensated(nu) >
alpha_true K_I / K_P. For large steps with quadratic drag they hold with the limiter only (docs/errata.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from marine.control.model_function import Coefficients
from marine.control.structures import LoopDesign
from marine.vessel import DegreeOfFreedom


@dataclass(frozen=True)
class Uncertainty:
    """Relative errors of the identified parameters, p of (8.17), (8.18): (identified - true) / true.

    The default is the worst case of (8.23), (8.27): drag 20 % too high, inertia 10 % too low.
    """

    drag: float = 0.2
    inertia: float = -0.1


def drag_bound(a: Coefficients, errors: Uncertainty = Uncertainty()) -> float:
    """Return the largest stable beta(nu)/alpha in 1/s of an I-PD loop, thesis (8.22), with the default (8.23).

    For constant drag the design is allowed when beta/alpha is smaller; for linear drag it bounds the speed, (8.26),
    (8.27): |nu| < bound alpha / beta_nunu.
    """
    a1, a2, a3 = a
    return (errors.drag + 1.0) / errors.drag * (a2 / a3 - 1.0 / (a1 * (errors.inertia + 1.0)))


def speed_bound(loop: LoopDesign, errors: Uncertainty = Uncertainty()) -> float:
    """Return the |nu| in m/s or rad/s up to which a loop is stable with such errors, thesis (8.26).

    Infinite without linear drag. Negative when the constant drag alone breaks (8.22): the design is not allowed.
    For structures without D the same condition is written with the vessel's damping.
    """
    g, model = loop.gains, loop.model
    alpha_true = model.alpha / (1.0 + errors.inertia)
    beta_true = model.beta / (1.0 + errors.drag)
    needed = alpha_true * g.integral / g.proportional
    room = g.derivative + beta_true - loop.beta - needed
    per_speed = model.beta_quadratic * errors.drag / (1.0 + errors.drag)
    if room <= 0.0:
        return -1.0
    return room / per_speed if per_speed > 0.0 else math.inf


def limited(loop: LoopDesign, errors: Uncertainty = Uncertainty()) -> LoopDesign:
    """Return the loop with its limiter set to (8.26); raise ValueError when the design is not allowed."""
    bound = speed_bound(loop, errors)
    if bound <= 0.0:
        raise ValueError(
            f"not stable with drag {100.0 * errors.drag:.0f} % too high and inertia {-100.0 * errors.inertia:.0f} % "
            "too low, thesis (8.22): take a faster model function"
        )
    return replace(loop, speed_limit=bound)


def is_stable_at(loop: LoopDesign, true: DegreeOfFreedom, nu: float) -> bool:
    """Whether a loop is stable on the true vessel at a frozen speed nu, thesis (8.13), (8.21), (8.24), (8.25), (8.28).

    The four cases of 8.1.2 are one: constant, linear or both kinds of drag, in the model and in truth.
    """
    g = loop.gains
    compensated = loop.beta + loop.model.beta_quadratic * min(abs(nu), loop.speed_limit)
    damping = g.derivative + true.beta + true.beta_quadratic * abs(nu) - compensated
    return damping * g.proportional > true.alpha * g.integral and damping > 0.0


@dataclass(frozen=True)
class Margins:
    """Margins of the loop opened at the actuators.

    gain_down, gain_up: factors between which the actuators' gain may be. delay_s: additional delay that makes the loop
    unstable. crossover_rad_s: where the open loop's gain is 1.
    """

    gain_down: float
    gain_up: float
    phase_deg: float
    crossover_rad_s: float
    delay_s: float


def margins(loop: LoopDesign) -> Margins:
    """Return the margins of L(s) = (K_D s^2 + K_P s + K_I) / (s^2 (alpha s + beta)), K_D with the compensated drag.

    For structures without an integral a factor s cancels.
    """
    g, alpha = loop.gains, loop.model.alpha
    K_D, beta = g.derivative - loop.beta, loop.model.beta
    # |numerator|^2 = |denominator|^2 as a polynomial in w^2.
    squared = [alpha**2, beta**2 - K_D**2, -(g.proportional**2 - 2.0 * K_D * g.integral), -(g.integral**2)]
    crossovers = [math.sqrt(w2.real) for w2 in np.roots(squared) if abs(w2.imag) < 1e-9 * abs(w2) and w2.real > 0.0]
    worst = Margins(*_gain_margins(loop), math.inf, 0.0, math.inf)
    for w in crossovers:
        s = 1j * w
        L = (K_D * s * s + g.proportional * s + g.integral) / (s * s * (alpha * s + beta))
        phase = (math.degrees(np.angle(L)) + 180.0) % 360.0
        if phase < worst.phase_deg:
            worst = replace(worst, phase_deg=phase, crossover_rad_s=w, delay_s=math.radians(phase) / w)
    return worst


def _gain_margins(loop: LoopDesign) -> tuple[float, float]:
    """Return the factors k between which (beta + k K_D) K_P > alpha K_I.

    With much constant drag K_D is negative (thesis Example 8.1): then more gain takes damping away.
    """
    K_D = loop.gains.derivative - loop.beta
    lacking = loop.model.alpha * loop.gains.integral / loop.gains.proportional - loop.model.beta
    if K_D > 0.0:
        return max(0.0, lacking / K_D), math.inf
    return 0.0, lacking / K_D if K_D < 0.0 else math.inf
