"""The uncoupled model that estimator and controllers take, from any richer model: thesis 2.5.2."""

from __future__ import annotations

from marine.dynamics.asv import linearised
from marine.dynamics.small_vessel import SmallVesselDynamics
from marine.vessel import (
    AsvModel,
    CoupledModel,
    DegreeOfFreedom,
    Dynamics,
    HorizontalModel,
    SixDofModel,
    SmallVesselModel,
)


def uncoupled(dynamics: Dynamics) -> HorizontalModel:
    """Return (2.29)-(2.32) of a model: couplings, Coriolis terms and the distance of the centre of gravity left out."""
    match dynamics:
        case HorizontalModel():
            return dynamics
        case CoupledModel():
            return _of_coupled(dynamics)
        case SixDofModel():
            return _of_six_dof(dynamics)
        case SmallVesselModel():
            yaw = SmallVesselDynamics(dynamics).yaw_at(dynamics.design_n_squared)
            return HorizontalModel(dynamics.surge, dynamics.sway, yaw)
        case AsvModel():
            return linearised(dynamics)


def _of_coupled(m: CoupledModel) -> HorizontalModel:
    inertias = (
        m.mass_kg + m.added_surge_kg,
        m.mass_kg + m.added_sway_kg,
        m.inertia_kg_m2 + m.added_yaw_kg_m2,
    )
    surge, sway, yaw = map(DegreeOfFreedom, inertias, m.drag, m.drag_quadratic)
    return HorizontalModel(surge, sway, yaw)


def _of_six_dof(m: SixDofModel) -> HorizontalModel:
    rigid = (m.mass_kg, m.mass_kg, m.mass_kg, *m.inertia_kg_m2[:3])
    alpha = [r + a for r, a in zip(rigid, m.added, strict=True)]
    surge, sway, heave, _, _, yaw = map(DegreeOfFreedom, alpha, m.drag, m.drag_quadratic)
    return HorizontalModel(surge, sway, yaw, heave, m.weight_n - m.buoyancy_n)
