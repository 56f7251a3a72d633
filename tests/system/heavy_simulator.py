"""A simulator whose vessel is not what its file says: twice the inertia, half the drag."""

from __future__ import annotations

import dataclasses

from bus.config import Deployment
from marine.vessel import DegreeOfFreedom, HorizontalModel, Vessel
from services.simulator.service import Simulator, SimulatorConfig

HEAVY = 'simulation = true\nservices = { simulator = "tests.system.heavy_simulator:HeavySimulator" }'


def heavier(model: HorizontalModel, times: float = 2.0) -> HorizontalModel:
    """Return a model with so many times the inertia of surge, sway and yaw, and the drag divided by that."""
    surge, sway, yaw = (
        DegreeOfFreedom(times * dof.alpha, dof.beta / times, dof.beta_quadratic / times)
        for dof in (model.surge, model.sway, model.yaw)
    )
    return HorizontalModel(surge, sway, yaw)


class HeavySimulator(Simulator):
    """Simulate a vessel that nobody knows."""

    def __init__(self, config: SimulatorConfig, vessel: Vessel, deployment: Deployment) -> None:
        super().__init__(config, dataclasses.replace(vessel, dynamics=heavier(vessel.model)), deployment)
