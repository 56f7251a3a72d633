"""What every control law has in common: a file with one law is all that a new one needs (docs/how-to)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from marine.frames import to_body, wrap_angle
from marine.vessel import Vessel

Vector3 = tuple[float, float, float]
ZERO: Vector3 = (0.0, 0.0, 0.0)

FADE_S = 1.0
"""Time constant with which the difference to what the actuators gave before fades after engaging."""


@dataclass(slots=True)
class Reference:
    """Where the vessel shall be: pose, its rate and its acceleration in {E}; m, rad and s."""

    eta: Vector3
    rate: Vector3 = ZERO
    acceleration: Vector3 = ZERO


@dataclass(frozen=True)
class Parameters:
    """Base of the parameter models of laws: frozen dataclasses whose fields all have defaults.

    `__post_init__` refuses values by ValueError; a field's metadata["doc"] says what it is.
    """

    # Read by pydantic where a configuration file becomes parameters: marine itself does not know of it.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}


class ControlLaw(ABC):
    """A law for surge, sway and yaw: pure, without a clock.

    eta = [x y psi] in {E} in m and rad; nu = [u v r] in {B} in m/s and rad/s; tau = [X Y N] in {B} in N and Nm.

    A law says its demand (`demand`), and if it has an integral how to set it (`engage`). What all laws share is here:
    the demand stays within what the actuators can do on each axis alone, and what that takes is told to the anti-windup
    with what the allocator takes; engaging does not jump, whatever the law; a disturbance may be fed forward.
    """

    name: ClassVar[str]
    """What configuration files call it."""
    serves: ClassVar[str] = "positioning"
    """What helm/state calls it: the law of a mode."""
    integral: ClassVar[bool] = True
    """False: the estimator's disturbance is fed forward instead. One kind of integral action at a time."""
    Parameters: ClassVar[type[Parameters]] = Parameters

    def __init__(self, limits: Vector3) -> None:
        """limits: largest |X|, |Y|, |N| of a demand; see `marine.allocation.axis_limits`."""
        self.limits = limits
        self.error: Vector3 = ZERO
        self._cut = ZERO
        self._fading = ZERO
        self._taking_over: Vector3 | None = None
        self._fed_forward = ZERO

    @classmethod
    @abstractmethod
    def for_vessel(cls, parameters: Any, vessel: Vessel, limits: Vector3) -> ControlLaw:
        """Return the law designed for a vessel; raise ValueError when it cannot be."""

    @abstractmethod
    def demand(self, dt_s: float, reference: Reference, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau; arguments as those of `step`."""

    def engage(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:  # noqa: B027 - not every law has something to set
        """Set integrals so that the next demand, without time passing, is tau. Without them there is nothing to do."""

    @property
    def held(self) -> Vector3:
        """What the law's integrals hold in {E}, N and Nm."""
        return ZERO

    @property
    def action(self) -> Vector3:
        """What the law holds besides damping, in {E}, N and Nm: at rest the force against the disturbance."""
        (x, y, n), (d_x, d_y, d_n) = self.held, self._fed_forward
        return x - d_x, y - d_y, n - d_n

    def follow(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Make ready to take over: forget the past; the next demand is tau, as far as the limits allow it."""
        self._cut = self._fading = self._fed_forward = ZERO
        self._taking_over = tau
        self.engage(eta, nu, tau)

    def step(  # noqa: PLR0917 - the symbols of the loop
        self,
        dt_s: float,
        reference: Reference,
        eta: Vector3,
        nu: Vector3,
        missing: Vector3,
        disturbance: Vector3 = ZERO,
    ) -> Vector3:
        """Return the demanded tau.

        dt_s: time since the step before; missing: what the actuators gave of the demand before, less that demand, in
        {B}; zero within their limits. disturbance: in {E}, to be fed forward.
        """
        (x, y, psi), (x_ref, y_ref, psi_ref) = eta, reference.eta
        self.error = (x_ref - x, y_ref - y, wrap_angle(psi_ref - psi))
        (short_x, short_y, short_n), (cut_x, cut_y, cut_n) = missing, self._cut
        X, Y, N = self.demand(dt_s, reference, eta, nu, (short_x + cut_x, short_y + cut_y, short_n + cut_n))
        self._fed_forward = d_x, d_y, d_n = disturbance
        against_x, against_y = to_body(-d_x, -d_y, psi)
        X, Y, N = self._faded_in(dt_s, X + against_x, Y + against_y, N - d_n)
        limit_x, limit_y, limit_n = self.limits
        tau = within(X, limit_x), within(Y, limit_y), within(N, limit_n)
        self._cut = tau[0] - X, tau[1] - Y, tau[2] - N
        return tau

    def _faded_in(self, dt_s: float, X: float, Y: float, N: float) -> Vector3:
        """Return the demand and what is left of the difference to what acted before."""
        if self._taking_over is not None:
            before_x, before_y, before_n = self._taking_over
            x, y, n = before_x - X, before_y - Y, before_n - N
            self._taking_over = None
        else:
            left = math.exp(-dt_s / FADE_S)
            x, y, n = self._fading
            x, y, n = x * left, y * left, n * left
        self._fading = x, y, n
        return X + x, Y + y, N + n


def within(value: float, limit: float) -> float:
    """Return a value cut to +-limit."""
    return value if -limit <= value <= limit else math.copysign(limit, value)
