"""What stands in a vessel file, table by table, and its conversion to SI (`marine.vessel`)."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Annotated, Literal

from pydantic import Field, model_validator

from bus.config import Section
from marine import vessel as v
from services.vessel_actuators import Actuator, NotNegative, Positive, Share

Six = tuple[float, float, float, float, float, float]
SixNotNegative = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
ThreeNotNegative = tuple[NotNegative, NotNegative, NotNegative]


class Units(Section):
    """[units]: what one unit of the numbers under [model] and of thrust is in SI. Positions are always in m."""

    length_m: Positive = 1.0
    force_n: Positive = 1.0
    moment_nm: Positive = 1.0
    angle_rad: Positive = 1.0


class DegreeOfFreedom(Section):
    """alpha, beta, beta_quadratic of thesis (2.33), (2.34), all positive, in the paper's units."""

    alpha: Positive
    beta: NotNegative = 0.0
    beta_quadratic: NotNegative = 0.0

    def in_si(self, length_or_angle: float, force_or_moment: float) -> v.DegreeOfFreedom:
        """Return the parameters in SI, given what the paper's units are."""
        scale = force_or_moment / length_or_angle
        return v.DegreeOfFreedom(self.alpha * scale, self.beta * scale, self.beta_quadratic * scale / length_or_angle)


class Uncoupled(Section):
    """[model] kind = "uncoupled": thesis (2.29)-(2.34)."""

    kind: Literal["uncoupled"]
    surge: DegreeOfFreedom
    sway: DegreeOfFreedom
    yaw: DegreeOfFreedom
    heave: DegreeOfFreedom | None = None
    net_weight: float = 0.0

    def in_si(self, units: Units) -> v.HorizontalModel:
        """Return the model in SI."""
        length, force = units.length_m, units.force_n
        return v.HorizontalModel(
            surge=self.surge.in_si(length, force),
            sway=self.sway.in_si(length, force),
            yaw=self.yaw.in_si(units.angle_rad, units.moment_nm),
            heave=self.heave.in_si(length, force) if self.heave else None,
            net_weight_n=self.net_weight * force,
        )


class Coupled(Section):
    """[model] kind = "coupled": thesis (2.28), in SI; added masses and drags are positive."""

    kind: Literal["coupled"]
    mass_kg: Positive
    inertia_kg_m2: Positive
    added_surge_kg: NotNegative
    added_sway_kg: NotNegative
    added_yaw_kg_m2: NotNegative
    drag: ThreeNotNegative
    drag_quadratic: ThreeNotNegative
    added_surge_sway_kg: float = 0.0
    x_g_m: float = 0.0
    y_g_m: float = 0.0

    def in_si(self, _units: Units) -> v.CoupledModel:
        """Return the model."""
        return v.CoupledModel(**self.model_dump(exclude={"kind"}))


class SixDof(Section):
    """[model] kind = "six_dof": thesis (2.14)-(2.26), in SI; added masses and drags are positive."""

    kind: Literal["six_dof"]
    mass_kg: Positive
    inertia_kg_m2: Six
    added: SixNotNegative
    drag: SixNotNegative
    drag_quadratic: SixNotNegative
    weight_n: NotNegative
    buoyancy_n: NotNegative
    r_g_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    r_b_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def in_si(self, _units: Units) -> v.SixDofModel:
        """Return the model."""
        return v.SixDofModel(**self.model_dump(exclude={"kind"}))


class YawAtSpeed(DegreeOfFreedom):
    """Yaw at one thrust setting n^2 as in thesis Table 7.12: its input is the rudder angle in rad."""

    n_squared: Positive


class SmallVessel(Section):
    """[model] kind = "small_vessel": thesis (2.38), (3.6)."""

    kind: Literal["small_vessel"]
    surge: DegreeOfFreedom
    sway: DegreeOfFreedom
    yaw: list[YawAtSpeed] = Field(min_length=1)
    design_n_squared: Positive
    yaw_bias_nm: float = 0.0

    def in_si(self, units: Units, moment_nm: float) -> v.SmallVesselModel:
        """Return the model in SI; moment_nm: what the rudders do per n^2 and rad, 2 L k_r2 of thesis (2.37)."""
        points = sorted(self.yaw, key=lambda point: point.n_squared)
        return v.SmallVesselModel(
            surge=self.surge.in_si(units.length_m, units.force_n),
            sway=self.sway.in_si(units.length_m, units.force_n),
            yaw=tuple(v.YawAtSpeed(p.n_squared, p.in_si(units.angle_rad, p.n_squared * moment_nm)) for p in points),
            design_n_squared=self.design_n_squared,
            yaw_bias_nm=self.yaw_bias_nm,
        )


class Asv(Section):
    """[model] kind = "asv": asv (4), (12), (13). Coefficients by the name of their term: U2r = 0.1."""

    kind: Literal["asv"]
    damping_speed: dict[str, float]
    damping_yaw: dict[str, float]
    inertia_speed: dict[str, float]
    inertia_yaw: dict[str, float]
    tanh_speed: tuple[float, float]
    tanh_yaw: tuple[float, float]
    max_speed_m_s: Positive
    max_yaw_rad_s: Positive
    submerged_length_m: Positive
    design_speed_m_s: Positive

    @model_validator(mode="after")
    def _known_terms(self) -> Asv:
        for name in ("damping_speed", "damping_yaw", "inertia_speed", "inertia_yaw"):
            terms = (*TERMS, "tanh") if name.startswith("inertia") else TERMS
            for term in getattr(self, name):
                if term not in terms:
                    raise ValueError(f"{name}: no such term {term!r}; known: {', '.join(terms)}")
        return self

    def in_si(self, _units: Units) -> v.AsvModel:
        """Return the model."""
        rest = self.model_dump(exclude={"kind", "damping_speed", "damping_yaw", "inertia_speed", "inertia_yaw"})
        return v.AsvModel(
            damping_speed=_coefficients(self.damping_speed, TERMS),
            damping_yaw=_coefficients(self.damping_yaw, TERMS),
            inertia_speed=_coefficients(self.inertia_speed, (*TERMS, "tanh")),
            inertia_yaw=_coefficients(self.inertia_yaw, (*TERMS, "tanh")),
            **rest,
        )


TERMS = ("1", "U", "r", "U2", "Ur", "r2", "U3", "U2r", "Ur2", "r3", "U4", "U3r", "U2r2", "Ur3", "r4")


def _coefficients(given: dict[str, float], terms: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(given.get(term, 0.0) for term in terms)


Model = Annotated[Uncoupled | Coupled | SixDof | SmallVessel | Asv, Field(discriminator="kind")]


_DEGREES = {"deg": "rad", "deg/s": "rad/s"}


class Sensor(Section):
    """[[sensor]]: quantisation, noise, bias and range in `unit`, which must fit the kind; times in s."""

    kind: v.SensorKind
    unit: Literal["m", "m/s", "rad", "rad/s", "deg", "deg/s"]
    sample_time_s: Positive
    quantisation: NotNegative = 0.0
    noise: NotNegative = 0.0
    bias: float = 0.0
    delay_s: NotNegative = 0.0
    dropout: Share = 0.0
    range_max: Positive | None = None

    @model_validator(mode="after")
    def _unit_fits(self) -> Sensor:
        wanted = v.SENSOR_UNITS[self.kind]
        if _DEGREES.get(self.unit, self.unit) != wanted:
            raise ValueError(f"a {self.kind} measures in {wanted}, not in {self.unit}")
        return self

    def in_si(self) -> v.Sensor:
        """Return the sensor in SI."""
        scale = math.pi / 180.0 if self.unit in _DEGREES else 1.0
        return v.Sensor(
            kind=self.kind,
            sample_time_s=self.sample_time_s,
            quantisation=self.quantisation * scale,
            noise=self.noise * scale,
            bias=self.bias * scale,
            delay_s=self.delay_s,
            dropout=self.dropout,
            range_max=None if self.range_max is None else self.range_max * scale,
        )


class Pool(Section):
    """[pool]: the tank, or the patch of sea that is simulated."""

    length_x_m: Positive
    length_y_m: Positive


class Camera(Section):
    """[camera]: above the pool. A vessel without one is shown on a map of the pool that has this form."""

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    scale_px_per_m: Positive
    height_m: Positive
    rate_hz: Positive


class Tether(Section):
    """[tether]: pulls the vessel towards an anchor in {E} when it is taut."""

    anchor_x_m: float
    anchor_y_m: float
    slack_m: NotNegative
    stiffness_n_m: NotNegative
    x_m: float = 0.0


class Validity(Section):
    """[validity]: how long a prediction without measurements counts as a pose, per mode; hold_s where not given."""

    hold_s: Positive = 0.25
    heading_s: Positive | None = None
    depth_s: Positive | None = None
    speed_s: Positive | None = None
    line_s: Positive | None = None
    path_s: Positive | None = None
    distance_s: Positive = 6.0

    def in_si(self) -> v.Validity:
        """Return it with hold_s where a mode says nothing."""
        given = self.model_dump(exclude_none=True)
        return v.Validity(**{field.name: given.get(field.name, self.hold_s) for field in fields(v.Validity)})


class Bias(Section):
    """[bias]: constant disturbance in {B}, in the paper's units: thesis tau_E."""

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    K: float = 0.0
    M: float = 0.0
    N: float = 0.0

    def in_si(self, units: Units) -> v.Vector6:
        """Return [X Y Z K M N] in N and Nm."""
        force, moment = units.force_n, units.moment_nm
        return self.X * force, self.Y * force, self.Z * force, self.K * moment, self.M * moment, self.N * moment


class Hold(Section):
    """[hold]: characteristic frequency of the model function for dynamic positioning; of the heading in steering."""

    w0_rad_s: Positive
    heading_w0_rad_s: Positive | None = None


class VesselFile(Section):
    """A whole vessel file."""

    title: str
    sources: list[str] = Field(min_length=1)
    controlled: list[v.Axis] = Field(min_length=1)
    radius_m: Positive
    command_delay_s: NotNegative = 0.0
    units: Units = Units()
    model: Model
    actuator: list[Actuator] = Field(min_length=1)
    sensor: list[Sensor] = Field(min_length=1)
    pool: Pool
    camera: Camera | None = None
    bias: Bias = Bias()
    tether: Tether | None = None
    validity: Validity = Validity()
    hold: Hold
