"""What the controller does in a mode: one class a file in this folder, found by the law that helm/state names."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from pydantic import Field

from bus.config import Section
from bus.messages import HelmState, WallState
from marine.control.base import ControlLaw, Vector3
from marine.control.heading import HeadingParameters
from marine.guidance.reference_filter import MotionLimits, ReferenceFilter
from marine.vessel import Axis, SensorKind, Vessel

Ours = tuple[bool, bool, bool]
"""Which of surge, sway and yaw are the controller's."""
ALL: Ours = (True, True, True)


class GuidanceConfig(Section):
    """What [controller] says of guidance, where the vessel's own values do not do."""

    line: Literal["line_of_sight", "direct", "indirect"] = Field(
        "line_of_sight", description="how a vessel that steers only follows lines: docs/guidance.md"
    )
    line_w0_rad_s: float | None = Field(None, gt=0, description="of direct and indirect; none: 0.7 of the heading's")
    lookahead_m: float | None = Field(None, gt=0, description="of line_of_sight; none: from speed and heading loop")
    approach_deg: float = Field(30.0, gt=0, lt=90, description="largest angle to a line on the way to it")
    heading: Literal["I-PD", "P-D", "PI-D"] = Field(
        "I-PD", description="structure of the heading loop on the way, thesis Table 8.1; P-D: no integral of its own"
    )
    heading_w0_rad_s: float | None = Field(None, gt=0, description="heading on the way; none: the vessel file's [hold]")
    speed_w0_rad_s: float | None = Field(None, gt=0, description="speed ahead; none: the vessel file's [hold]")

    @property
    def steering(self) -> HeadingParameters:
        """The heading loop's design as configured."""
        return HeadingParameters(self.heading, self.heading_w0_rad_s)


@dataclass
class Tools:
    """What the guidance of all modes shares. `positioning` may be exchanged while it runs: then `engage` comes next."""

    vessel: Vessel
    limits: Vector3
    """Largest |X|, |Y|, |N|."""
    positioning: ControlLaw | None
    motion: MotionLimits
    """What the reference of a fully actuated vessel may do."""
    filter: ReferenceFilter | None
    """None: the law gets steps as they are."""
    config: GuidanceConfig
    steering: HeadingParameters = field(default_factory=HeadingParameters)
    """Design of the heading loop, where there is no positioning law or on the way."""


@dataclass(slots=True)
class Seen:
    """What there is to know in one step. eta, nu, tau as those of `ControlLaw`."""

    dt_s: float
    eta: Vector3
    nu: Vector3
    given: Vector3
    """What the actuators give."""
    missing: Vector3
    """What they gave of the demand before less that demand; of an axis that another has: all that it gave."""
    disturbance: Vector3
    """As the estimator sees it, in {E}."""
    ours: Ours
    along_m: float
    """How far this request's path was followed by a controller that was restarted, or before a pause; else 0."""
    wall: WallState | None = None
    """The wall ahead, where a laser module sees one."""


class Guidance(ABC):
    """What the controller does while helm/state names `law`. Pure: no clock, no bus.

    `engage` comes before the first `step`, after every pause, and when the axes change hands; the next demand, with
    dt_s = 0, shall be what the actuators give. A mode of the helm is a row of `services.helm_modes.MODES`.
    """

    law: ClassVar[str]
    needs: ClassVar[tuple[Axis, ...]] = ()
    """Axes that a vessel must control; of classes for the same law the first that fits is taken."""
    sensor: ClassVar[SensorKind | None] = None
    """What a vessel must have besides."""

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when the vessel cannot do it."""
        self.tools = tools

    @classmethod
    def fits(cls, vessel: Vessel) -> bool:
        """Return whether a vessel has the axes and the sensor."""
        return set(cls.needs) <= set(vessel.controlled) and (cls.sensor is None or bool(vessel.sensor(cls.sensor)))

    @abstractmethod
    def engage(self, order: HelmState, seen: Seen) -> None:
        """Make ready to take over from what the actuators give."""

    @abstractmethod
    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Return the demanded [X Y N] in N and Nm; what it says on axes that are not ours does not count."""

    @abstractmethod
    def told(self) -> dict[str, Any]:
        """Return fields of control/status: law, errors, where the reference is."""


def reference_told(eta: Vector3) -> dict[str, float]:
    """Return the reference of this moment as control/status has it."""
    return {"reference_x_m": eta[0], "reference_y_m": eta[1], "reference_psi_rad": eta[2]}
