"""What every control law has in common: a file with one law is all that a new one needs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

Vector3 = tuple[float, float, float]
ZERO: Vector3 = (0.0, 0.0, 0.0)


class ControlLaw(ABC):
    """A law for surge, sway and yaw: pure, without a clock.

    eta = [x y psi] in {E} in m and rad; nu = [u v r] in {B} in m/s and rad/s; tau = [X Y N] in {B} in N and Nm.
    """

    name: ClassVar[str]
    """What helm/state calls it."""

    error: Vector3 = ZERO
    """Reference less eta at the last step, m and rad, the angle in (-pi, pi]."""

    @property
    @abstractmethod
    def action(self) -> Vector3:
        """What the law holds besides damping, in {E}, N and Nm: at rest the force against the disturbance."""

    @abstractmethod
    def follow(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Make ready to take over: the next demand, without time passing, is tau."""

    @abstractmethod
    def step(self, dt_s: float, reference: Vector3, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau.

        dt_s: time since the step before; reference: wanted eta; missing: what the actuators gave of the demand
        before, less that demand, in {B}; zero within their limits.
        """
