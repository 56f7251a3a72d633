"""What a loop or a law will do before it is engaged: its step on the identified model, within the actuators' limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from marine.control.base import ZERO, ControlLaw, Reference, Vector3, within
from marine.control.single_loop import TRACKING_TIME, SingleLoop
from marine.control.structures import LoopDesign
from marine.frames import wrap_angle
from marine.guidance.reference_filter import ReferenceFilter
from marine.vessel import DegreeOfFreedom, HorizontalModel

SETTLED = 0.05
"""Part of a step within which it counts as settled."""
RUNAWAY = 1e3
"""A response this many times the step is not followed further."""
REST, REST_S = 0.01, 5.0
"""A law's response that stays within this part of the step for so long is over."""


@dataclass(frozen=True)
class StepResponse:
    """A step of the reference at t = 0. Lists of one length: s, m or rad, N or Nm as the limits leave it."""

    t_s: list[float]
    eta: list[float]
    tau: list[float]
    overshoot: float
    """Largest eta beyond the reference, as part of the step."""
    settling_s: float
    """From here on within SETTLED of the step; infinite when it is not at the end."""
    saturated_s: float
    """Time at the limits."""
    peak: float
    """Largest |tau| demanded, N or Nm: above the limit it saturates."""
    activity: float
    """IADC: integral of |tau'|, N or Nm: the way that the actuators go."""


def step_response(  # noqa: PLR0917
    loop: LoopDesign, true: DegreeOfFreedom, step: float, limit: float, duration_s: float, dt_s: float
) -> StepResponse:
    """Simulate a step (m or rad) from rest of a loop on a vessel, with |tau| <= limit (N or Nm)."""
    law = SingleLoop(loop, TRACKING_TIME * natural_time_s(loop))
    eta = nu = missing = peak = saturated_s = eta_before = 0.0
    t_s, etas, taus = [0.0], [0.0], [0.0]
    stepped = step
    for n in range(1, round(duration_s / dt_s) + 1):
        law.advance(dt_s, step - eta, eta - eta_before, missing, stepped)
        stepped = 0.0
        demand = law.demand(nu)
        given = within(demand, limit)
        missing = given - demand
        peak = max(peak, abs(demand))
        saturated_s += dt_s if missing else 0.0
        eta_before = eta
        eta, nu = _move(true, eta, nu, given, dt_s)
        if not abs(eta) < RUNAWAY * abs(step):
            break
        t_s.append(n * dt_s)
        etas.append(eta)
        taus.append(given)
    return _judged(t_s, etas, taus, step, saturated_s, peak)


def law_step(  # noqa: PLR0917
    law: ControlLaw,
    true: HorizontalModel,
    axis: int,
    step: float,
    shaping: ReferenceFilter | None,
    duration_s: float,
    dt_s: float,
    *,
    aside: bool = False,
) -> StepResponse:
    """Simulate a step (m or rad) of surge, sway or yaw (axis 0, 1, 2) of a whole law on a vessel, from rest.

    dt_s: from one navigation state to the next, as the law runs; shaping: what makes a motion of the step, None: the
    law gets the step. aside: the vessel is pushed off its reference by the step, and comes back. The law is used up: it
    keeps what its integrals hold. Ends early after REST_S of rest.
    """
    dof, limit = (true.surge, true.sway, true.yaw)[axis], law.limits[axis]
    nu = saturated_s = peak = 0.0
    begin, target = (-step, 0.0) if aside else (0.0, step)
    eta = begin
    t_s, etas, taus = [0.0], [0.0], [0.0]
    law.follow(ZERO, ZERO, ZERO)
    if shaping:
        shaping.start(ZERO, ZERO)
    rest_from_s = 0.0
    for n in range(1, round(duration_s / dt_s) + 1):
        reference = Reference(_on(axis, target))
        if shaping:
            shaping.step(dt_s, reference.eta)
            reference = Reference(shaping.eta, shaping.rate, shaping.acceleration)
        here = wrap_angle(eta) if axis == 2 else eta
        tau = law.step(dt_s, reference, _on(axis, here), _on(axis, nu), ZERO)[axis]
        peak = max(peak, abs(tau))
        saturated_s += dt_s if abs(tau) >= limit else 0.0
        eta, nu = _move(dof, eta, nu, tau, dt_s)
        if not abs(eta) < RUNAWAY * abs(step):
            break
        t_s.append(n * dt_s)
        etas.append(eta - begin)
        taus.append(tau)
        if abs(eta - target) > REST * abs(step):
            rest_from_s = t_s[-1]
        elif t_s[-1] - rest_from_s > REST_S:
            break
    return _judged(t_s, etas, taus, step, saturated_s, peak)


def _on(axis: int, value: float) -> Vector3:
    """Return a vector with one component."""
    return (value if axis == 0 else 0.0, value if axis == 1 else 0.0, value if axis == 2 else 0.0)


def _judged(  # noqa: PLR0917
    t_s: list[float], eta: list[float], tau: list[float], step: float, saturated_s: float, peak: float
) -> StepResponse:
    """Return a response with what is said of it; one that ends outside SETTLED has not settled."""
    outside = [t for t, e in zip(t_s, eta, strict=True) if abs(e - step) > SETTLED * abs(step)]
    return StepResponse(
        t_s=t_s,
        eta=eta,
        tau=tau,
        overshoot=max(0.0, *(e / step - 1.0 for e in eta)),
        settling_s=outside[-1] if outside[-1] < t_s[-1] else math.inf,
        saturated_s=saturated_s,
        peak=peak,
        activity=sum(abs(b - a) for a, b in pairwise(tau)),
    )


def natural_time_s(loop: LoopDesign) -> float:
    """Return 1/w0 of a loop: the n-th root of its model function's last coefficient."""
    g = loop.gains
    if loop.structure.integral:
        return float((loop.model.alpha / g.integral) ** (1.0 / 3.0))
    return math.sqrt(loop.model.alpha / g.proportional)


def _move(dof: DegreeOfFreedom, eta: float, nu: float, tau: float, dt_s: float) -> tuple[float, float]:
    """Return eta and nu after dt_s of constant tau, by the midpoint rule."""
    middle = nu + 0.5 * dt_s * (tau - dof.drag(nu)) / dof.alpha
    return eta + dt_s * middle, nu + dt_s * (tau - dof.drag(middle)) / dof.alpha
