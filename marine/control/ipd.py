"""The I-PD law for one degree of freedom, designed by a model function, thesis 8.1.

The reference acts through the integral only, so that no step of it reaches the actuators.
"""

from __future__ import annotations

from dataclasses import dataclass

from marine.vessel import DegreeOfFreedom


@dataclass(frozen=True)
class Gains:
    """K_I in N/(m s), K_P in N/m, K_D in N s/m without its drag term (for angles Nm and rad), thesis (8.5)."""

    integral: float
    proportional: float
    derivative: float


def gains(alpha: float, model_function: tuple[float, ...]) -> Gains:
    """Return the gains that give inertia alpha (kg or kg m^2) the closed loop (8.4), thesis (8.5).

    model_function: (a1, a2, a3) of `marine.control.model_function`. K_D is without -beta(nu): the drag is
    compensated in `Ipd.demand`, with the speed of the moment.
    """
    a1, a2, a3 = model_function
    return Gains(integral=alpha / a3, proportional=a1 / a3 * alpha, derivative=a2 / a3 * alpha)


class Ipd:
    """tau = K_I int(eta_ref - eta) dt - K_P eta - (K_D - beta(nu)) nu, thesis (8.2), (8.5).

    K_I int e - K_P eta is kept as one sum, `action`, which is moved on by what eta moves: so the law may be engaged
    anywhere without a jump (`follow`), and an angle may pass pi. At rest it is the force that holds against the
    disturbance, in N or Nm. Anti-windup: back-calculation, (8.29) corrected by the gain 1/T_t (see docs/errata.md).
    """

    def __init__(self, model: DegreeOfFreedom, model_function: tuple[float, ...], tracking_time_s: float) -> None:
        """Design the law for a model; tracking_time_s is T_t."""
        self.gains = gains(model.alpha, model_function)
        self.action = 0.0
        self._model = model
        self._tracking_time_s = tracking_time_s

    def follow(self, tau: float, nu: float) -> None:
        """Set the action so that the demand at velocity nu (m/s or rad/s) is tau (N or Nm)."""
        self.action = tau + self.gains.derivative * nu - self._model.drag(nu)

    def advance(self, dt_s: float, error: float, moved: float, missing: float) -> None:
        """Integrate over a step.

        error: eta_ref - eta (m or rad, an angle wrapped); moved: change of eta since the step before; missing: what
        the actuators gave less what was demanded (N or Nm), zero within their limits.
        """
        # Above dt = T_t back-calculation would overshoot what is missing.
        share = min(1.0, dt_s / self._tracking_time_s)
        self.action += self.gains.integral * error * dt_s - self.gains.proportional * moved + share * missing

    def demand(self, nu: float) -> float:
        """Return tau in N or Nm at velocity nu."""
        return self.action - self.gains.derivative * nu + self._model.drag(nu)
