"""Dynamic positioning without an integral: P-D, with the estimator's disturbance fed forward instead."""

from __future__ import annotations

from dataclasses import dataclass, field

from marine.control.base import Parameters, Vector3
from marine.control.model_function import model_function
from marine.control.stability import limited
from marine.control.state_feedback import StateFeedback
from marine.control.structures import STRUCTURES, design
from marine.vessel import Vessel


@dataclass(frozen=True)
class PDParameters(Parameters):
    """Design of the P-D positioning."""

    model_function: str = field(default="bessel", metadata={"doc": "bessel, butterworth, or coefficients a1,a2"})
    w0_rad_s: float | None = field(
        default=None, metadata={"doc": "characteristic frequency; None: the vessel file's [hold]"}
    )
    yaw_w0_rad_s: float | None = field(default=None, metadata={"doc": "the same for heading; None: as the position's"})

    def __post_init__(self) -> None:
        for w0 in (self.w0_rad_s, self.yaw_w0_rad_s):
            model_function(self.model_function, 2, 1.0 if w0 is None else w0)


class PD(StateFeedback):
    """P-D for each of surge, sway and yaw, thesis Table 8.1, with the estimator's disturbance fed forward.

    The drag is compensated; the integral action is the estimator's. Takes a reference that the vessel can follow.
    """

    name = "p_d"
    integral = False
    Parameters = PDParameters

    @classmethod
    def for_vessel(cls, parameters: PDParameters, vessel: Vessel, limits: Vector3) -> PD:
        """Return the law designed for a vessel."""
        w0 = vessel.hold_w0_rad_s if parameters.w0_rad_s is None else parameters.w0_rad_s
        yaw_w0 = w0 if parameters.yaw_w0_rad_s is None else parameters.yaw_w0_rad_s
        m = vessel.model
        surge, sway, yaw = (
            limited(design(STRUCTURES["P-D"], dof, model_function(parameters.model_function, 2, w)))
            for dof, w in ((m.surge, w0), (m.sway, w0), (m.yaw, yaw_w0))
        )
        return cls((surge, sway, yaw), 1.0, limits)
