"""The heading of a vessel that only steers: one loop of yaw in a structure of thesis Table 8.1."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from marine.control.base import ControlLaw, Parameters, Reference, Vector3
from marine.control.model_function import bessel
from marine.control.preview import natural_time_s
from marine.control.single_loop import TRACKING_TIME, SingleLoop
from marine.control.stability import limited
from marine.control.structures import STRUCTURES, Gains, LoopDesign, Structure, design
from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom, Vessel

_FASTER = 1.25
_TRIALS = 20


def bessel_design(
    dof: DegreeOfFreedom, w0_rad_s: float, structure: Structure = STRUCTURES["I-PD"], *, fixed: bool = False
) -> LoopDesign:
    """Return a loop by Bessel's model function; unless w0 is fixed a faster one where (8.22) does not allow it."""
    for _ in range(_TRIALS):
        try:
            return limited(design(structure, dof, bessel(structure.order, w0_rad_s)))
        except ValueError:
            if fixed:
                raise
            w0_rad_s *= _FASTER
    raise ValueError(f"no model function up to {w0_rad_s:.2g} rad/s gives a stable loop, thesis (8.22)")


@dataclass(frozen=True)
class HeadingParameters(Parameters):
    """Design of the heading loop."""

    structure: Literal["I-PD", "P-D", "PI-D"] = field(
        default="I-PD", metadata={"doc": "of thesis Table 8.1: I-PD, P-D or PI-D"}
    )
    yaw_w0_rad_s: float | None = field(
        default=None, metadata={"doc": "characteristic frequency; None: the vessel file's [hold]"}
    )

    def __post_init__(self) -> None:
        bessel(2, 1.0 if self.yaw_w0_rad_s is None else self.yaw_w0_rad_s)

    def design(self, vessel: Vessel) -> LoopDesign:
        """Return the loop for a vessel; raise ValueError when what is asked for is not allowed, (8.22)."""
        w0 = self.yaw_w0_rad_s or vessel.steering_w0_rad_s
        return bessel_design(vessel.model.yaw, w0, STRUCTURES[self.structure], fixed=self.yaw_w0_rad_s is not None)


class Heading(ControlLaw):
    """The heading alone, by I-PD, P-D or PI-D of thesis Table 8.1: what lines, paths and speeds are steered by."""

    name = "heading"
    serves = "steering"
    Parameters = HeadingParameters

    def __init__(self, parameters: HeadingParameters, vessel: Vessel, limits: Vector3) -> None:
        """Raise ValueError when the loop is not allowed, (8.22)."""
        super().__init__(limits)
        self.parameters = parameters
        loop = parameters.design(vessel)
        self._psi = SingleLoop(loop, TRACKING_TIME * natural_time_s(loop))
        self._psi_rad = 0.0

    @classmethod
    def for_vessel(cls, parameters: HeadingParameters, vessel: Vessel, limits: Vector3) -> Heading:
        """Return the law designed for a vessel; raise ValueError when (8.22) does not allow it."""
        return cls(parameters, vessel, limits)

    @property
    def designs(self) -> tuple[LoopDesign, LoopDesign, LoopDesign]:
        """The designs of surge and sway, which do nothing, and of yaw."""
        loop = self._psi.design
        idle = LoopDesign(loop.structure, Gains(0.0, 0.0, 0.0), loop.model)
        return idle, idle, loop

    def engage(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Set the integral so that the next moment, without time passing, is N."""
        self._psi.follow(tau[2], nu[2])
        self._psi_rad = eta[2]

    def demand(self, dt_s: float, reference: Reference, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau; see `ControlLaw.step`."""
        self._psi.advance(dt_s, self.error[2], wrap_angle(eta[2] - self._psi_rad), missing[2])
        self._psi_rad = eta[2]
        return 0.0, 0.0, self._psi.demand(nu[2])

    @property
    def held(self) -> Vector3:
        """What integral and position part hold."""
        return 0.0, 0.0, self._psi.action
