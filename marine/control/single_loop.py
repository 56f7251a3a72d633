"""The control law of one degree of freedom, in any structure of thesis Table 8.1."""

from __future__ import annotations

from marine.control.base import within
from marine.control.structures import LoopDesign
from marine.frames import wrap_angle

TRACKING_TIME = 0.5
"""Usual T_t of the anti-windup, in units of 1/w0."""


class SingleLoop:
    """tau = K_I int e dt + K_P (e or -eta) + K_D (e' or -nu), with the drag compensated, thesis (8.2), (8.5), Fig. 8.3.

    With an integral, the I and P parts are kept as one sum, `action`, which is moved on by what eta moves: the law may
    be engaged anywhere without a jump (`follow`), gains may be exchanged the same way, and an angle may pass pi.
    At rest it is the force that holds against the disturbance, in N or Nm. Anti-windup: back-calculation, (8.29)
    corrected by the gain 1/T_t (see docs/errata.md).
    """

    def __init__(self, design: LoopDesign, tracking_time_s: float) -> None:
        """Make a loop with action zero; tracking_time_s is T_t."""
        self.design = design
        self.action = 0.0
        self._tracking_time_s = tracking_time_s
        self._reference_rate = 0.0
        self._taken_over = False
        self._fading = 0.0

    def follow(self, tau: float, nu: float) -> None:
        """Set the action so that the demand at velocity nu (m/s or rad/s) is tau (N or Nm)."""
        self._reference_rate = 0.0
        self._taken_over = True
        self.action = tau + self.design.gains.derivative * nu - self.design.compensation(nu)

    def advance(self, dt_s: float, error: float, moved: float, missing: float, stepped: float = 0.0) -> None:
        """Take in a step of time.

        error: eta_ref - eta (m or rad, an angle wrapped); moved, stepped: change of eta and of eta_ref since the step
        before; missing: what the actuators gave less what was demanded (N or Nm), zero within their limits.
        """
        gains, structure = self.design.gains, self.design.structure
        self._reference_rate = stepped / dt_s if dt_s > 0.0 else 0.0
        if not structure.integral:
            wanted = gains.proportional * error
            # Nothing keeps what acted before: the difference to it fades.
            left = max(0.0, 1.0 - dt_s / self._tracking_time_s)
            self._fading = self.action - wanted if self._taken_over else self._fading * left
            self._taken_over = False
            self.action = wanted + self._fading
            return
        on_error = stepped if structure.p_on_error else 0.0
        # Above dt = T_t back-calculation would overshoot what is missing.
        share = dt_s / self._tracking_time_s if dt_s < self._tracking_time_s else 1.0
        self.action += gains.integral * error * dt_s + gains.proportional * (on_error - moved) + share * missing

    def demand(self, nu: float) -> float:
        """Return tau in N or Nm at velocity nu."""
        design = self.design
        tau = self.action - design.gains.derivative * nu + design.compensation(nu)
        if design.structure.d_on_error:
            tau += (design.gains.derivative - design.beta) * self._reference_rate
        return tau


class LimitedLoop:
    """A `SingleLoop` within |tau| <= limit (N or Nm), which starts from zero force where it is first stepped.

    What the limit takes goes to the anti-windup, with what the actuators take besides.
    """

    def __init__(self, design: LoopDesign, limit: float, tracking_time_s: float, *, angle: bool = False) -> None:
        """angle: eta is one in (-pi, pi]; tracking_time_s: T_t."""
        self.design, self.limit = design, limit
        self.error = 0.0
        self._loop = SingleLoop(design, tracking_time_s)
        self._angle = angle
        self._before: float | None = None
        self._cut = 0.0

    def follow(self, tau: float, eta: float, nu: float) -> None:
        """Make ready to take over: the next demand, without time passing, is tau."""
        self._loop.follow(tau, nu)
        self._before, self._cut = eta, 0.0

    def step(self, dt_s: float, reference: float, eta: float, nu: float, missing: float = 0.0) -> float:
        """Return tau; missing: what the actuators gave of the demand before less that demand, N or Nm."""
        if self._before is None:
            self.follow(0.0, eta, nu)
            dt_s, self._before = 0.0, eta
        self.error, moved = reference - eta, eta - self._before
        if self._angle:
            self.error, moved = wrap_angle(self.error), wrap_angle(moved)
        self._loop.advance(dt_s, self.error, moved, self._cut + missing)
        wanted = self._loop.demand(nu)
        tau = within(wanted, self.limit)
        self._before, self._cut = eta, tau - wanted
        return tau
