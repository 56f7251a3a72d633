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

    def __post_init__(self) -> None:
        model_function(self.model_function, 2, 1.0 if self.w0_rad_s is None else self.w0_rad_s)


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
        a, m = model_function(parameters.model_function, 2, w0), vessel.model
        surge, sway, yaw = (limited(design(STRUCTURES["P-D"], dof, a)) for dof in (m.surge, m.sway, m.yaw))
        return cls((surge, sway, yaw), 1.0, limits)
