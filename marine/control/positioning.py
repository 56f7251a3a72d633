"""Dynamic positioning: x, y and heading held by an I-PD law each, thesis 8.1, with the integrals in {E}."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from marine.control.base import ControlLaw, Parameters, Reference, Vector3
from marine.control.model_function import Coefficients, model_function
from marine.control.single_loop import TRACKING_TIME, SingleLoop
from marine.control.stability import limited
from marine.control.structures import STRUCTURES, LoopDesign, design
from marine.frames import rotated, wrap_angle
from marine.vessel import DegreeOfFreedom, HorizontalModel, Vessel

_UNIT_MASS = DegreeOfFreedom(1.0, 0.0, 0.0)
_I_PD = STRUCTURES["I-PD"]


@dataclass(frozen=True)
class PositioningParameters(Parameters):
    """Design of the I-PD positioning."""

    model_function: str = field(default="bessel", metadata={"doc": "bessel, butterworth, or coefficients a1,a2,a3"})
    w0_rad_s: float | None = field(
        default=None, metadata={"doc": "characteristic frequency; None: the vessel file's [hold]"}
    )
    yaw_w0_rad_s: float | None = field(default=None, metadata={"doc": "the same for heading; None: as the position's"})

    def __post_init__(self) -> None:
        for w0 in (self.w0_rad_s, self.yaw_w0_rad_s):
            model_function(self.model_function, 3, 1.0 if w0 is None else w0)


class Positioning(ControlLaw):
    """I-PD for each of x, y and psi, designed by a model function, thesis 8.1.

    tau = diag(alpha) R^T(psi) a + beta(nu) nu with a = (1/a3) int e - (a1/a3) eta - (a2/a3) eta'. That is (8.2), (8.5)
    with x and y as accelerations in {E}: what their integrals hold against is a current, which stays where it is when
    the vessel turns. The drag is compensated in {B}, where it acts, up to the speed (8.27). A moving reference enters
    as G^-1(s) eta_ref, with its a3 s^3 integrated at once: alpha times its acceleration. A reference at rest acts
    through the integral only.
    """

    name = "ipd"
    Parameters = PositioningParameters

    def __init__(
        self, model: HorizontalModel, a: Coefficients, limits: Vector3, yaw: Coefficients | None = None
    ) -> None:
        """Design the law by the model function a = (a1, a2, a3) and that of the heading, if it has one of its own.

        Raise ValueError when (8.22) does not allow it.
        """
        super().__init__(limits)
        yaw = yaw or a
        self._functions = (a, yaw)
        tracking_time_s = TRACKING_TIME * a[2] ** (1.0 / 3.0)
        self._surge, self._sway = (limited(design(_I_PD, dof, a)) for dof in (model.surge, model.sway))
        unit = design(_I_PD, _UNIT_MASS, a)
        self._x = SingleLoop(unit, tracking_time_s)
        self._y = SingleLoop(unit, tracking_time_s)
        self._psi = SingleLoop(limited(design(_I_PD, model.yaw, yaw)), TRACKING_TIME * yaw[2] ** (1.0 / 3.0))
        self._inertia = model.surge.alpha, model.sway.alpha, model.yaw.alpha
        self._eta: Vector3 | None = None

    @classmethod
    def for_vessel(cls, parameters: PositioningParameters, vessel: Vessel, limits: Vector3) -> Positioning:
        """Return the law designed for a vessel; raise ValueError when (8.22) does not allow it."""
        w0 = vessel.hold_w0_rad_s if parameters.w0_rad_s is None else parameters.w0_rad_s
        yaw_w0 = w0 if parameters.yaw_w0_rad_s is None else parameters.yaw_w0_rad_s
        a, yaw = (model_function(parameters.model_function, 3, w) for w in (w0, yaw_w0))
        return cls(vessel.model, a, limits, yaw)

    @property
    def designs(self) -> tuple[LoopDesign, LoopDesign, LoopDesign]:
        """The designs of surge, sway and yaw."""
        return self._surge, self._sway, self._psi.design

    def engage(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Set the integrals so that the next demand, without time passing, is tau."""
        u, v, r = nu
        X, Y, N = tau
        c, s = math.cos(eta[2]), math.sin(eta[2])
        a_x, a_y = self._acceleration(X - self._surge.compensation(u), Y - self._sway.compensation(v), c, s)
        x_dot, y_dot = rotated(u, v, c, s)
        self._x.follow(a_x, x_dot)
        self._y.follow(a_y, y_dot)
        self._psi.follow(N, r)
        self._eta = eta

    def demand(self, dt_s: float, reference: Reference, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau; see `ControlLaw.step`."""
        (u, v, r), (x, y, psi) = nu, eta
        x_before, y_before, psi_before = self._eta or eta
        self._eta = eta
        c, s = math.cos(psi), math.sin(psi)
        e_x, e_y, e_psi = self._led_error(reference)
        short_x, short_y, short_n = missing
        missing_x, missing_y = self._acceleration(short_x, short_y, c, s)
        self._x.advance(dt_s, e_x, x - x_before, missing_x)
        self._y.advance(dt_s, e_y, y - y_before, missing_y)
        self._psi.advance(dt_s, e_psi, wrap_angle(psi - psi_before), short_n)
        x_dot, y_dot = rotated(u, v, c, s)
        led_x, led_y, led_psi = reference.acceleration
        X, Y = self._force(self._x.demand(x_dot) + led_x, self._y.demand(y_dot) + led_y, c, s)
        N = self._psi.demand(r) + self._inertia[2] * led_psi
        return X + self._surge.compensation(u), Y + self._sway.compensation(v), N

    @property
    def held(self) -> Vector3:
        """What integral and position part hold, in {E}, N and Nm: at rest the force against the disturbance."""
        psi = self._eta[2] if self._eta else 0.0
        c, s = math.cos(psi), math.sin(psi)
        return *rotated(*self._force(self._x.action, self._y.action, c, s), c, s), self._psi.action

    def _led_error(self, reference: Reference) -> Vector3:
        (e_x, e_y, e_psi), ((a1, a2, _), (yaw1, yaw2, _)) = self.error, self._functions
        (x_dot, y_dot, r), (x_dd, y_dd, r_dot) = reference.rate, reference.acceleration
        return (
            e_x + a1 * x_dot + a2 * x_dd,
            e_y + a1 * y_dot + a2 * y_dd,
            e_psi + yaw1 * r + yaw2 * r_dot,
        )

    def _acceleration(self, X: float, Y: float, c: float, s: float) -> tuple[float, float]:
        """Return the acceleration in {E} that a force in {B} gives, m/s^2, at the heading of cosine c and sine s."""
        alpha_u, alpha_v, _ = self._inertia
        return rotated(X / alpha_u, Y / alpha_v, c, s)

    def _force(self, a_x: float, a_y: float, c: float, s: float) -> tuple[float, float]:
        """Return the force in {B} that gives an acceleration in {E}: diag(alpha) R^T a."""
        surge, sway = rotated(a_x, a_y, c, -s)
        alpha_u, alpha_v, _ = self._inertia
        return alpha_u * surge, alpha_v * sway
