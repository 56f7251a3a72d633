"""Dynamic positioning: x, y and heading held by an I-PD law each, thesis 8.1, with the integrals in {E}."""

from __future__ import annotations

from marine.control.base import ControlLaw, Vector3
from marine.control.ipd import Ipd
from marine.control.model_function import bessel
from marine.frames import to_body, to_tank, wrap_angle
from marine.vessel import DegreeOfFreedom, HorizontalModel

TRACKING_TIME = 0.5
"""T_t of the anti-windup, in units of 1/w0."""

_UNIT_MASS = DegreeOfFreedom(1.0, 0.0, 0.0)


class Positioning(ControlLaw):
    """tau = diag(alpha) R^T(psi) a + beta(nu) nu with a = (1/a3) int e - (a1/a3) eta - (a2/a3) eta'.

    That is thesis (8.2), (8.5) per degree of freedom, for x and y as accelerations in {E}: what their integrals hold
    against is a current, which stays where it is when the vessel turns. The drag is compensated in {B}, where it acts.
    """

    name = "positioning"

    def __init__(self, model: HorizontalModel, w0_rad_s: float) -> None:
        """Design the law: the gains follow from the model and from Bessel's model function at w0."""
        self._surge, self._sway = model.surge, model.sway
        a, tracking_time_s = bessel(3, w0_rad_s), TRACKING_TIME / w0_rad_s
        self._x = Ipd(_UNIT_MASS, a, tracking_time_s)
        self._y = Ipd(_UNIT_MASS, a, tracking_time_s)
        self._psi = Ipd(model.yaw, a, tracking_time_s)
        self._eta: Vector3 | None = None

    def follow(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Make ready to take over: the next demand, without time passing, is tau."""
        u, v, r = nu
        X, Y, N = tau
        psi = eta[2]
        a_x, a_y = self._acceleration(X - self._surge.drag(u), Y - self._sway.drag(v), psi)
        x_dot, y_dot = to_tank(u, v, psi)
        self._x.follow(a_x, x_dot)
        self._y.follow(a_y, y_dot)
        self._psi.follow(N, r)
        self._eta = eta

    def step(self, dt_s: float, reference: Vector3, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau; see `ControlLaw.step`."""
        u, v, r = nu
        x, y, psi = eta
        x_before, y_before, psi_before = self._eta or eta
        self._eta = eta
        e_x, e_y, e_psi = self.error = reference[0] - x, reference[1] - y, wrap_angle(reference[2] - psi)
        missing_x, missing_y = self._acceleration(missing[0], missing[1], psi)
        self._x.advance(dt_s, e_x, x - x_before, missing_x)
        self._y.advance(dt_s, e_y, y - y_before, missing_y)
        self._psi.advance(dt_s, e_psi, wrap_angle(psi - psi_before), missing[2])
        x_dot, y_dot = to_tank(u, v, psi)
        X, Y = self._force(self._x.demand(x_dot), self._y.demand(y_dot), psi)
        return X + self._surge.drag(u), Y + self._sway.drag(v), self._psi.demand(r)

    @property
    def action(self) -> Vector3:
        """What integral and position part hold, in {E}, N and Nm: at rest the force against the disturbance."""
        psi = self._eta[2] if self._eta else 0.0
        return *to_tank(*self._force(self._x.action, self._y.action, psi), psi), self._psi.action

    def _acceleration(self, X: float, Y: float, psi: float) -> tuple[float, float]:
        """Return the acceleration in {E} that a force in {B} gives, m/s^2."""
        return to_tank(X / self._surge.alpha, Y / self._sway.alpha, psi)

    def _force(self, a_x: float, a_y: float, psi: float) -> tuple[float, float]:
        """Return the force in {B} that gives an acceleration in {E}: diag(alpha) R^T a."""
        surge, sway = to_body(a_x, a_y, psi)
        return self._surge.alpha * surge, self._sway.alpha * sway
