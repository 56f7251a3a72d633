"""[[actuator]] of a vessel file, kind by kind, and the conversion to SI (`marine.vessel`)."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from bus.config import Section
from marine import vessel as v

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, lt=1)]


class _Driven(Section):
    name: str = Field(min_length=1)
    n_max: Positive
    n_min: Annotated[float, Field(le=0)] | None = None
    integer: bool = False
    dead_zone: NotNegative = 0.0
    lag_s: NotNegative = 0.0
    rate_per_s: Positive | None = None

    def driven(self) -> dict[str, float | None]:
        """Return the fields that all actuators share."""
        return self.model_dump(include={"name", "n_max", "n_min", "integer", "dead_zone", "lag_s", "rate_per_s"})


class _Thruster(_Driven):
    x_m: float
    y_m: float
    z_m: float = 0.0
    angle_deg: float = 0.0
    elevation_deg: float = 0.0

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        raise NotImplementedError

    def in_si(self, force_n: float) -> v.Thruster:
        """Return the thruster in SI."""
        return v.Thruster(
            x_m=self.x_m,
            y_m=self.y_m,
            z_m=self.z_m,
            angle_rad=math.radians(self.angle_deg),
            elevation_rad=math.radians(self.elevation_deg),
            characteristic=self.characteristic(force_n),
            **self.driven(),  # type: ignore[arg-type]
        )


class Quadratic(_Thruster):
    """kind = "quadratic": tau = k_t |n| n, pladypos (1)."""

    kind: Literal["quadratic"]
    k_t: Positive

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        return v.QuadraticThrust(self.k_t * force_n)


class Affine(_Thruster):
    """kind = "affine": thesis (2.7)."""

    kind: Literal["affine"]
    a: Positive
    b: float

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        return v.AffineThrust(self.a * force_n, self.b * force_n)


class Asymmetric(_Thruster):
    """kind = "asymmetric": thesis (2.8)."""

    kind: Literal["asymmetric"]
    a_f: Positive
    b_f: float = 0.0
    a_b: Positive
    b_b: float = 0.0

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        return v.AsymmetricThrust(self.a_f * force_n, self.b_f * force_n, self.a_b * force_n, self.b_b * force_n)


class QuadraticLinear(_Thruster):
    """kind = "quadratic_linear": quadratic up to a knee, then straight."""

    kind: Literal["quadratic_linear"]
    k_t: Positive
    knee: Positive
    slope: Positive

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        return v.QuadraticLinearThrust(self.k_t * force_n, self.knee, self.slope * force_n)


class Bilinear(_Thruster):
    """kind = "bilinear": thesis (2.4)-(2.6)."""

    kind: Literal["bilinear"]
    t_nn: Positive
    t_nu: NotNegative
    q_nn: NotNegative = 0.0
    q_nu: NotNegative = 0.0
    wake: Share = 0.0
    spin: Literal[1, -1] = 1

    def characteristic(self, force_n: float) -> v.Characteristic:
        """Return tau(n) in N."""
        return v.BilinearThrust(self.t_nn * force_n, self.t_nu * force_n, self.q_nn, self.q_nu, self.wake, self.spin)


class RudderSection(_Driven):
    """kind = "rudder": thesis (2.9)-(2.12); commands are angles in rad."""

    kind: Literal["rudder"]
    x_m: float
    y_m: float
    k_r1: NotNegative
    k_r2: NotNegative
    behind: str
    stall_deg: Annotated[float, Field(gt=0, lt=90)] = 45.0

    def in_si(self, force_n: float) -> v.Rudder:
        """Return the rudder in SI."""
        return v.Rudder(
            x_m=self.x_m,
            y_m=self.y_m,
            k_r1=self.k_r1 * force_n,
            k_r2=self.k_r2 * force_n,
            behind=self.behind,
            stall_rad=math.radians(self.stall_deg),
            **self.driven(),  # type: ignore[arg-type]
        )


class DirectSection(_Driven):
    """kind = "direct": a command that is a component of the wrench, times `gain`."""

    kind: Literal["direct"]
    axis: v.Axis
    gain: Positive = 1.0

    def in_si(self, _force_n: float) -> v.Direct:
        """Return the actuator."""
        return v.Direct(axis=self.axis, gain=self.gain, **self.driven())  # type: ignore[arg-type]


Actuator = Annotated[
    Quadratic | Affine | Asymmetric | QuadraticLinear | Bilinear | RudderSection | DirectSection,
    Field(discriminator="kind"),
]
