"""Dynamic positioning by LQR with integral action, designed from the vessel file."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marine.control.base import Parameters, Vector3
from marine.control.stability import limited
from marine.control.state_feedback import StateFeedback
from marine.control.structures import STRUCTURES, Gains, LoopDesign
from marine.vessel import DegreeOfFreedom, Vessel


@dataclass(frozen=True)
class LqrParameters(Parameters):
    """Bryson's rule: errors that are worth the whole force of the actuators."""

    position_m: float = field(default=0.1, metadata={"doc": "distance that is worth the actuators' whole force"})
    integral_m_s: float = field(default=0.5, metadata={"doc": "the same for the distance's integral over time"})
    heading_rad: float = field(default=0.2, metadata={"doc": "turn that is worth the actuators' whole moment"})
    integral_rad_s: float = field(default=1.0, metadata={"doc": "the same for the turn's integral over time"})

    def __post_init__(self) -> None:
        if min(self.position_m, self.integral_m_s, self.heading_rad, self.integral_rad_s) <= 0.0:
            raise ValueError("errors must be positive")


class Lqr(StateFeedback):
    """LQR with integral action for each of surge, sway and yaw, weighed by Bryson's rule.

    Minimises int (int e / z)^2 + (e / p)^2 + (tau / limit)^2 dt, sizes p and z being the parameters. Riccati's
    equation is solved for alpha eta'' = tau: the drag is compensated as in the I-PD law (8.5). An axis without
    actuators gets no gains. Takes a reference that the vessel can follow.
    """

    name = "lqr"
    Parameters = LqrParameters

    @classmethod
    def for_vessel(cls, parameters: LqrParameters, vessel: Vessel, limits: Vector3) -> Lqr:
        """Return the law designed for a vessel; raise ValueError when (8.22) does not allow it."""
        p, model = parameters, vessel.model
        surge = lqr_design(model.surge, limits[0], p.position_m, p.integral_m_s)
        sway = lqr_design(model.sway, limits[1], p.position_m, p.integral_m_s)
        yaw = lqr_design(model.yaw, limits[2], p.heading_rad, p.integral_rad_s)
        return cls((surge, sway, yaw), p.integral_m_s / p.position_m / 2.0, limits)


def lqr_design(model: DegreeOfFreedom, limit: float, size: float, integral_size: float) -> LoopDesign:
    """Return the PI-D loop with the gains of the regulator for states [int e, e, e'], input tau.

    limit in N or Nm; size in m or rad, integral_size in m s or rad s. For one input Riccati's equation is a spectral
    factorisation: the closed loop's polynomial p has p(s) p(-s) = -s^6 + (limit/alpha)^2 (1/z^2 - s^2/p^2). Anderson
    and Moore: Optimal Control, 1990, section 5.2. (No import of scipy: a running controller designs, too.)
    """
    if limit <= 0.0:
        return LoopDesign(STRUCTURES["PI-D"], Gains(0.0, 0.0, 0.0), model)
    scale = (limit / model.alpha) ** 2
    roots = np.roots([-1.0, 0.0, 0.0, 0.0, -scale / size**2, 0.0, scale / integral_size**2])
    _, c2, c1, c0 = np.poly(roots[roots.real < 0.0]).real.tolist()
    gains = Gains(integral=model.alpha * c0, proportional=model.alpha * c1, derivative=model.alpha * c2)
    return limited(LoopDesign(STRUCTURES["PI-D"], gains, model))
