"""A simulator whose vessel is not what its file says: twice the inertia, half the drag."""

from __future__ import annotations

import dataclasses

from bus.config import Deployment
from marine.vessel import DegreeOfFreedom, HorizontalModel, Vessel
from services.simulator.service import Simulator, SimulatorConfig

HEAVY = 'simulation = true\nservices = { simulator = "tests.system.heavy_simulator:HeavySimulator" }'


def heavier(model: HorizontalModel) -> HorizontalModel:
    """Return a model with twice the inertia and half the drag of surge, sway and yaw."""
    surge, sway, yaw = (
        DegreeOfFreedom(2.0 * dof.alpha, 0.5 * dof.beta, 0.5 * dof.beta_quadratic)
        for dof in (model.surge, model.sway, model.yaw)
    )
    return HorizontalModel(surge, sway, yaw)


class HeavySimulator(Simulator):
    """Simulate a vessel that nobody knows."""

    def __init__(self, config: SimulatorConfig, vessel: Vessel, deployment: Deployment) -> None:
        super().__init__(config, dataclasses.replace(vessel, dynamics=heavier(vessel.model)), deployment)
