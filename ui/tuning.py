"""What a tuning will do, computed for the page before it is engaged: beside the present one, on the same vessel."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from bus.messages import Shaping, TunedAxis, Tuning
from marine.vessel import Vessel
from services.tuning import TuningError, horizontal_limits, preview

Prediction = Mapping[TunedAxis, dict[str, Any]]


class PreviewRequest(BaseModel):
    """What the page asks: both tunings run on the models that the proposed one names."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    proposed: Tuning
    present: Tuning | None = None
    shaping: Shaping | None = None


class Previews:
    """Answers to `PreviewRequest` as JSON: {refused, axes: {axis: {proposed, present}}}. For one thread at a time."""

    def __init__(self, vessel: Vessel) -> None:
        self._vessel = vessel
        self._limits = horizontal_limits(vessel)
        self._present: tuple[str, Prediction] = ("", {})  # kept while a slider moves the other

    def __call__(self, payload: bytes) -> bytes:
        """Return the answer; raise ValueError for what is no request."""
        request = PreviewRequest.model_validate_json(payload)
        refused, axes = "", dict[str, dict[str, Any]]()
        try:
            for axis, found in self._predicted(request.proposed, request).items():
                axes.setdefault(axis, {})["proposed"] = found
        except TuningError as error:
            refused = str(error)
        key = request.model_dump_json(exclude={"proposed": {"law", "parameters"}})
        if key != self._present[0]:
            self._present = key, self._predicted(request.present, request) if request.present else {}
        for axis, found in self._present[1].items():
            axes.setdefault(axis, {})["present"] = found
        return json.dumps({"refused": refused, "axes": axes}).encode()

    def _predicted(self, tuning: Tuning, request: PreviewRequest) -> Prediction:
        return preview(tuning, self._vessel, self._limits, request.shaping, request.proposed.models)
