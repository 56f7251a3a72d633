"""The vessel as control/gains says it is: with the identified models that an operator has engaged, or the file's again.

What takes it: estimator, controller, helm with its guard, and experiments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from bus.messages import AxisModel, ControlGains, TunedAxis
from bus.service import Input
from marine.vessel import DegreeOfFreedom, Vessel


def with_models(vessel: Vessel, models: Mapping[TunedAxis, AxisModel]) -> Vessel:
    """Return a vessel with other models of some axes; itself when they are its own."""
    changed: dict[str, Any] = {axis: DegreeOfFreedom(**model.model_dump()) for axis, model in models.items()}
    model = replace(vessel.model, **changed)
    return vessel if model == vessel.model else replace(vessel, model=model)


def vessel_in_force(before: Vessel, gains: Input[ControlGains]) -> Vessel:
    """Return the vessel of now from the one before, which is returned itself when nothing has changed."""
    told = gains.latest if gains.updated else None
    return with_models(before, told.tuning.models) if told else before
