"""A vessel as plain frozen values in SI: what `services.vessels` makes of a file and all mathematics takes.

Signs: {B} is x forward, y starboard, z down; psi from x towards y (SNAME). beta > 0 is drag (thesis (2.33)), added
mass > 0 is inertia: SNAME's coefficients are the negative of both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]

Axis = Literal["X", "Y", "Z", "K", "M", "N"]
AXES: tuple[Axis, ...] = ("X", "Y", "Z", "K", "M", "N")
"""Components of the wrench tau: surge, sway, heave in N; roll, pitch, yaw in Nm."""


COMMAND_DIGITS = 2
"""Decimals of a command in its actuator's unit: what the link to the platform carries (docs/link-protocol.md)."""


# Models: parameters of marine.dynamics


@dataclass(frozen=True)
class DegreeOfFreedom:
    """One uncoupled degree of freedom: alpha nu' + (beta + beta_quadratic |nu|) nu = Delta + tau, thesis (2.33).

    alpha: total inertia, kg or kg m^2. beta: constant drag, N s/m or Nm s/rad. beta_quadratic: linear drag (the
    thesis' name for a drag coefficient that grows linearly with speed), N s^2/m^2 or Nm s^2/rad^2.
    """

    alpha: float
    beta: float
    beta_quadratic: float

    def drag(self, nu: float) -> float:
        """Return the drag force or moment at velocity nu (m/s or rad/s), in N or Nm, with the sign of nu."""
        return (self.beta + self.beta_quadratic * abs(nu)) * nu


@dataclass(frozen=True)
class HorizontalModel:
    """Uncoupled model of surge, sway and yaw, and of heave if the vessel dives, thesis (2.29)-(2.32)."""

    surge: DegreeOfFreedom
    sway: DegreeOfFreedom
    yaw: DegreeOfFreedom
    heave: DegreeOfFreedom | None = None
    net_weight_n: float = 0.0
    """W - B of (2.31): pulls down when positive."""


@dataclass(frozen=True)
class CoupledModel:
    """Coupled model in the horizontal plane, thesis (2.28).

    added_*: added masses -X_udot, -Y_vdot (kg), -N_rdot (kg m^2), -X_vdot (kg). Drags: [surge, sway, yaw], constant
    (N s/m, Nm s/rad) and linear (N s^2/m^2, Nm s^2/rad^2).
    """

    mass_kg: float
    inertia_kg_m2: float
    added_surge_kg: float
    added_sway_kg: float
    added_yaw_kg_m2: float
    drag: Vector3
    drag_quadratic: Vector3
    added_surge_sway_kg: float = 0.0
    x_g_m: float = 0.0
    y_g_m: float = 0.0


@dataclass(frozen=True)
class SixDofModel:
    """Full model, thesis (2.14)-(2.26).

    r_g_m, r_b_m: centres of gravity and buoyancy in {B}. inertia_kg_m2: [I_x I_y I_z I_xy I_xz I_yz] of (2.17) about
    the origin of {B}. added: diagonal of M_A (2.22), kg and kg m^2. drag, drag_quadratic: diagonals of (2.24).
    """

    mass_kg: float
    inertia_kg_m2: Vector6
    added: Vector6
    drag: Vector6
    drag_quadratic: Vector6
    weight_n: float
    buoyancy_n: float
    r_g_m: Vector3 = (0.0, 0.0, 0.0)
    r_b_m: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class YawAtSpeed:
    """Yaw of a small surface vessel at one thrust setting n^2 (command squared), thesis (3.6), Table 7.12."""

    n_squared: float
    yaw: DegreeOfFreedom


@dataclass(frozen=True)
class SmallVesselModel:
    """Practical model of small surface vessels, thesis (2.38): yaw depends on the square n^2 of the command.

    Between the settings of `yaw` (sorted by n^2) parameters are interpolated; outside they stay. `yaw_bias_nm` is the
    moment k_n2 n^2 per n^2, from a thrust off the centre line (2 Delta_d a in (2.37)).
    """

    surge: DegreeOfFreedom
    sway: DegreeOfFreedom
    yaw: tuple[YawAtSpeed, ...]
    design_n_squared: float
    """Setting at which the uncoupled model for estimator and controllers is taken."""
    yaw_bias_nm: float = 0.0


@dataclass(frozen=True)
class AsvModel:
    """2-DOF model of a fast vessel, asv (4): M(x) x' + sigma(x) = tau, x = [U r], tau = [throttle rudder].

    Coefficients of [1 U r U^2 Ur r^2 U^3 U^2r Ur^2 r^3 U^4 U^3r U^2r^2 Ur^3 r^4], asv (12), with U in m/s and r in
    rad/s; the inertias have one more for tanh(a (U - b)), asv (13), with [a b] in `tanh_*`. The model holds
    up to max_*.
    """

    damping_speed: tuple[float, ...]
    damping_yaw: tuple[float, ...]
    inertia_speed: tuple[float, ...]
    inertia_yaw: tuple[float, ...]
    tanh_speed: tuple[float, float]
    tanh_yaw: tuple[float, float]
    max_speed_m_s: float
    max_yaw_rad_s: float
    submerged_length_m: float
    design_speed_m_s: float
    """Where the uncoupled model for estimator and controllers is taken."""


Dynamics = HorizontalModel | CoupledModel | SixDofModel | SmallVesselModel | AsvModel


# Actuators: parameters of marine.actuators


@dataclass(frozen=True)
class QuadraticThrust:
    """tau = k_t |n| n, pladypos (1), thesis (2.7) with b = 0. k_t: N per squared command."""

    k_t: float


@dataclass(frozen=True)
class AffineThrust:
    """tau = a |n| n + b n, thesis (2.7)."""

    a: float
    b: float


@dataclass(frozen=True)
class AsymmetricThrust:
    """tau = a_f |n| n + b_f n forward, a_b, b_b backward, thesis (2.8)."""

    a_f: float
    b_f: float
    a_b: float
    b_b: float


@dataclass(frozen=True)
class QuadraticLinearThrust:
    """tau = k_t |n| n up to |n| = knee, from there straight with `slope` (N per command), continuously."""

    k_t: float
    knee: float
    slope: float


@dataclass(frozen=True)
class BilinearThrust:
    """tau = t_nn |n| n - t_nu |n| u_a, q = q_nn |n| n - q_nu |n| u_a, u_a = (1 - wake) U, thesis (2.4)-(2.6).

    spin: +1 or -1, the hand of the propeller (Fig. 2.4).
    """

    t_nn: float
    t_nu: float
    q_nn: float = 0.0
    q_nu: float = 0.0
    wake: float = 0.0
    spin: int = 1


Characteristic = QuadraticThrust | AffineThrust | AsymmetricThrust | QuadraticLinearThrust | BilinearThrust


@dataclass(frozen=True, kw_only=True)
class _Driven:
    """What all actuators share: how a command gets to the actuator.

    n_max: largest command; n_min: most negative one, None for -n_max; integer: commands are whole numbers; dead_zone:
    commands up to this size do nothing; lag_s: time constant with which the actuator follows; rate_per_s: largest
    change of the command in 1/s, None for no limit.
    """

    n_max: float
    n_min: float | None = None
    integer: bool = False
    dead_zone: float = 0.0
    lag_s: float = 0.0
    rate_per_s: float | None = None

    @property
    def lowest(self) -> float:
        """The most negative command."""
        return -self.n_max if self.n_min is None else self.n_min


@dataclass(frozen=True)
class Thruster(_Driven):
    """A fixed thruster at (x_m, y_m, z_m) in {B}.

    angle_rad: direction of positive thrust in the horizontal plane, from x towards y; elevation_rad: from there
    downwards (pi/2: a vertical thruster that pushes down).
    """

    name: str
    x_m: float
    y_m: float
    angle_rad: float
    characteristic: Characteristic
    z_m: float = 0.0
    elevation_rad: float = 0.0

    @property
    def k_t(self) -> float:
        """N per squared command of a purely quadratic thruster; raises TypeError for others."""
        if not isinstance(self.characteristic, QuadraticThrust):
            raise TypeError(f"{self.name}: {type(self.characteristic).__name__} is not purely quadratic")
        return self.characteristic.k_t

    @property
    def column(self) -> Vector6:
        """Wrench [X Y Z K M N] of 1 N of thrust: direction d and r x d, thesis 2.2 (corrected: see docs/errata.md)."""
        level = math.cos(self.elevation_rad)
        d = (level * math.cos(self.angle_rad), level * math.sin(self.angle_rad), math.sin(self.elevation_rad))
        return _push(self.x_m, self.y_m, self.z_m, d)


@dataclass(frozen=True)
class Rudder(_Driven):
    """A rudder at (x_m, y_m); the command is its angle delta in rad, positive turns to starboard, thesis (2.9)-(2.12).

    k_r1: N s^2/m^2 per rad, k_r2: N per squared command of the thruster in front and rad (2.12). stall_rad: delta_s of
    (2.9). behind: the thruster in front of it. n_max is the largest angle.
    """

    name: str
    x_m: float
    y_m: float
    k_r1: float
    k_r2: float
    behind: str
    stall_rad: float = math.pi / 4.0

    @property
    def column(self) -> Vector6:
        """Wrench of 1 N of rudder force at small angles: to port at the stern, thesis Table 2.2(f), (2.36)."""
        return _push(self.x_m, self.y_m, 0.0, (0.0, -1.0, 0.0))


@dataclass(frozen=True)
class Direct(_Driven):
    """A command that goes into the model as it is: throttle and rudder of asv (4). gain: N or Nm per unit command."""

    name: str
    axis: Axis
    gain: float = 1.0

    @property
    def column(self) -> Vector6:
        """Wrench of 1 N or 1 Nm along the axis."""
        X, Y, Z, K, M, N = (float(axis == self.axis) for axis in AXES)
        return X, Y, Z, K, M, N


Actuator = Thruster | Rudder | Direct


def _push(x: float, y: float, z: float, d: Vector3) -> Vector6:
    """Return force d at a place, and its moment r x d."""
    return *d, y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]


# Sensors and surroundings

SensorKind = Literal["camera", "compass", "depth", "position", "yaw_rate", "surge_speed", "speed", "laser"]
SENSOR_UNITS: dict[SensorKind, str] = {
    "camera": "m",
    "compass": "rad",
    "depth": "m",
    "position": "m",
    "yaw_rate": "rad/s",
    "surge_speed": "m/s",
    "speed": "m/s",
    "laser": "m",
}
INSTRUMENTS: frozenset[SensorKind] = frozenset(SENSOR_UNITS) - {"camera", "laser"}
"""What publishes numbers under sensor/; camera and laser dots are seen in pictures."""


@dataclass(frozen=True)
class Sensor:
    """A sensor: quantisation, noise (standard deviation) and bias in SENSOR_UNITS of its kind; times in s.

    dropout: share of samples that are lost; range_max: what lies further is not measured (None: no limit).
    """

    kind: SensorKind
    sample_time_s: float
    quantisation: float = 0.0
    noise: float = 0.0
    bias: float = 0.0
    delay_s: float = 0.0
    dropout: float = 0.0
    range_max: float | None = None


@dataclass(frozen=True)
class Pool:
    """Inner size of the tank, or of the patch of sea that is simulated, from the origin of {E}."""

    length_x_m: float
    length_y_m: float


@dataclass(frozen=True)
class Camera:
    """The overhead camera, looking straight down, and the marker on the vessel."""

    width_px: int
    height_px: int
    scale_px_per_m: float
    height_m: float
    rate_hz: float


@dataclass(frozen=True)
class Tether:
    """A cable to (anchor_x_m, anchor_y_m) in {E}, slack up to slack_m, then pulling with stiffness_n_m; tied at x_m."""

    anchor_x_m: float
    anchor_y_m: float
    slack_m: float
    stiffness_n_m: float
    x_m: float = 0.0


@dataclass(frozen=True)
class PaperUnits:
    """What one unit of a paper is in SI, to convert identified parameters back: length, force, moment, angle."""

    length_m: float = 1.0
    force_n: float = 1.0
    moment_nm: float = 1.0
    angle_rad: float = 1.0


@dataclass(frozen=True)
class Validity:
    """How long a prediction without measurements counts as a pose, per mode, in s."""

    hold_s: float = 0.25
    heading_s: float = 0.25
    depth_s: float = 0.25
    speed_s: float = 0.25
    line_s: float = 0.25
    path_s: float = 0.25
    distance_s: float = 6.0


@dataclass(frozen=True)
class Vessel:
    """Everything that is known of one vessel and of the place it floats in."""

    name: str
    title: str
    model: HorizontalModel
    """What estimator and controllers take: every degree of freedom on its own."""
    dynamics: Dynamics
    """What the simulator runs: the richest model that is known; `model` itself if there is none richer."""
    actuators: tuple[Actuator, ...]
    controlled: tuple[Axis, ...]
    """The components of the wrench that the actuators can set independently of each other."""
    sensors: tuple[Sensor, ...]
    radius_m: float
    pool: Pool
    camera: Camera
    validity: Validity
    hold_w0_rad_s: float
    """Characteristic frequency of the model function for dynamic positioning."""
    heading_w0_rad_s: float | None = None
    """The same for steering: heading on a line, path or at a speed; None: as the position's."""
    units: PaperUnits = PaperUnits()
    bias: Vector6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Constant disturbance tau_E in {B}, thesis (3.2)-(3.4): tether, asymmetries; N and Nm."""
    tether: Tether | None = None
    command_delay_s: float = 0.0
    """From the command at the surface to the actuator, COMM 1 of thesis Fig. 3.3."""
    sources: tuple[str, ...] = ()

    @property
    def steering_w0_rad_s(self) -> float:
        """Characteristic frequency of the heading where it is steered by."""
        return self.heading_w0_rad_s or self.hold_w0_rad_s

    @property
    def actuation_delay_s(self) -> float:
        """Known delay from a command to its force: on the way, and by the slowest thruster's lag where it reverses.

        A first-order lag T of the command delays a thrust k n |n| that goes over from -F to F by (1/2 + ln 2) T, in the
        mean: the integral of (1 - (1 - 2x)|1 - 2x|) / (2x) over x = exp(-t/T) from 0 to 1.
        """
        lag_s = max((a.lag_s for a in self.actuators if isinstance(a, Thruster)), default=0.0)
        return self.command_delay_s + (0.5 + math.log(2.0)) * lag_s

    def sensor(self, kind: SensorKind) -> Sensor | None:
        """Return the sensor of a kind, None where the vessel has none."""
        return next((s for s in self.sensors if s.kind == kind), None)

    @property
    def thrusters(self) -> tuple[Thruster, ...]:
        """The fixed thrusters among the actuators."""
        return tuple(a for a in self.actuators if isinstance(a, Thruster))
