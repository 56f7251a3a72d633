"""The control law of one degree of freedom, in any structure of thesis Table 8.1."""

from __future__ import annotations

from marine.control.structures import LoopDesign

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

    def follow(self, tau: float, nu: float) -> None:
        """Set the action so that the demand at velocity nu (m/s or rad/s) is tau (N or Nm)."""
        self._reference_rate = 0.0
        self.action = tau + self.design.gains.derivative * nu - self.design.compensation(nu)

    def advance(self, dt_s: float, error: float, moved: float, missing: float, stepped: float = 0.0) -> None:
        """Take in a step of time.

        error: eta_ref - eta (m or rad, an angle wrapped); moved, stepped: change of eta and of eta_ref since the step
        before; missing: what the actuators gave less what was demanded (N or Nm), zero within their limits.
        """
        gains, structure = self.design.gains, self.design.structure
        self._reference_rate = stepped / dt_s if dt_s > 0.0 else 0.0
        if not structure.integral:
            self.action = gains.proportional * error
            return
        on_error = stepped if structure.p_on_error else 0.0
        # Above dt = T_t back-calculation would overshoot what is missing.
        share = min(1.0, dt_s / self._tracking_time_s)
        self.action += gains.integral * error * dt_s + gains.proportional * (on_error - moved) + share * missing

    def demand(self, nu: float) -> float:
        """Return tau in N or Nm at velocity nu."""
        design = self.design
        tau = self.action - design.gains.derivative * nu + design.compensation(nu)
        if design.structure.d_on_error:
            tau += (design.gains.derivative - design.beta) * self._reference_rate
        return tau
