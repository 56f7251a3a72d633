"""What a loop will do before it is engaged: its step on the identified model, within the actuators' limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from marine.control.single_loop import TRACKING_TIME, SingleLoop
from marine.control.structures import LoopDesign
from marine.vessel import DegreeOfFreedom

SETTLED = 0.05
"""Part of a step within which it counts as settled."""


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
    eta = nu = tau = missing = activity = peak = saturated_s = eta_before = 0.0
    t_s, etas, taus = [0.0], [0.0], [0.0]
    stepped = step
    for n in range(1, round(duration_s / dt_s) + 1):
        law.advance(dt_s, step - eta, eta - eta_before, missing, stepped)
        stepped = 0.0
        demand = law.demand(nu)
        given = max(-limit, min(limit, demand))
        missing = given - demand
        activity += abs(given - tau)
        tau = given
        peak = max(peak, abs(demand))
        saturated_s += dt_s if missing else 0.0
        eta_before = eta
        eta, nu = _move(true, eta, nu, tau, dt_s)
        if not abs(eta) < 1e3 * abs(step):
            break
        t_s.append(n * dt_s)
        etas.append(eta)
        taus.append(tau)
    outside = [t for t, e in zip(t_s, etas, strict=True) if abs(e - step) > SETTLED * abs(step)]
    settled = len(t_s) > duration_s / dt_s and outside[-1] < t_s[-1]
    return StepResponse(
        t_s=t_s,
        eta=etas,
        tau=taus,
        overshoot=max(0.0, *(e / step - 1.0 for e in etas)),
        settling_s=outside[-1] if settled else math.inf,
        saturated_s=saturated_s,
        peak=peak,
        activity=activity,
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
