"""A vessel as plain frozen values in SI: what `services.vessels` makes of a file and all mathematics takes.

Signs: {B} is x forward, y starboard, z down; psi from x towards y (SNAME). beta > 0 is drag (thesis (2.33)).
"""

from __future__ import annotations

from dataclasses import dataclass


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
    """Uncoupled model of surge, sway and yaw, thesis (2.29), (2.30), (2.32)."""

    surge: DegreeOfFreedom
    sway: DegreeOfFreedom
    yaw: DegreeOfFreedom


@dataclass(frozen=True)
class Thruster:
    """A fixed thruster with the purely quadratic characteristic tau = k_t |n| n, pladypos (1).

    x_m, y_m: position in {B}; angle_rad: direction of positive thrust from x towards y; k_t in N per squared command;
    n_max: largest command; integer: commands are whole numbers; dead_zone: commands up to this size do nothing.
    """

    name: str
    x_m: float
    y_m: float
    angle_rad: float
    k_t: float
    n_max: float
    integer: bool = False
    dead_zone: float = 0.0


@dataclass(frozen=True)
class Pool:
    """Inner size of the tank, from the origin of {E}."""

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
class PaperUnits:
    """What one unit of a paper is in SI, to convert identified parameters back: length, force, moment."""

    length_m: float = 1.0
    force_n: float = 1.0
    moment_nm: float = 1.0


@dataclass(frozen=True)
class Validity:
    """How long a prediction without measurements counts as a pose, per mode, in s."""

    hold_s: float


@dataclass(frozen=True)
class Vessel:
    """Everything that is known of one vessel and of the place it floats in."""

    name: str
    title: str
    model: HorizontalModel
    thrusters: tuple[Thruster, ...]
    radius_m: float
    pool: Pool
    camera: Camera
    validity: Validity
    hold_w0_rad_s: float
    """Characteristic frequency of the model function for dynamic positioning."""
    units: PaperUnits = PaperUnits()
