"""The controller structures of thesis Table 8.1, designed by a model function (8.5), for one degree of freedom.

The minus in a name separates what acts on the error from what acts on the measured value: in I-PD only the integral
sees the reference. Written for a vessel alpha eta'' + beta(nu) eta' = tau; Nomoto's K, T of (8.30) (corrected: see
docs/errata.md) are 1/beta and alpha/beta. In this form a vessel without constant drag is designed for, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from marine.control.model_function import Coefficients, is_stable
from marine.vessel import DegreeOfFreedom


@dataclass(frozen=True)
class Structure:
    """One row of Table 8.1: which channels there are, and whether P and D act on the error or on eta."""

    name: str
    integral: bool
    derivative: bool
    p_on_error: bool
    d_on_error: bool = False

    @property
    def order(self) -> int:
        """Number of poles of the closed loop."""
        return 3 if self.integral else 2


STRUCTURES = {
    s.name: s
    for s in (
        Structure("P", integral=False, derivative=False, p_on_error=True),
        Structure("PD", integral=False, derivative=True, p_on_error=True, d_on_error=True),
        Structure("P-D", integral=False, derivative=True, p_on_error=True),
        Structure("PI", integral=True, derivative=False, p_on_error=True),
        Structure("I-P", integral=True, derivative=False, p_on_error=False),
        Structure("PID", integral=True, derivative=True, p_on_error=True, d_on_error=True),
        Structure("PI-D", integral=True, derivative=True, p_on_error=True),
        Structure("I-PD", integral=True, derivative=True, p_on_error=False),
    )
}
"""Thesis Table 8.1, P and PD corrected: see docs/errata.md."""


@dataclass(frozen=True)
class Gains:
    """K_I in N/(m s), K_P in N/m, K_D* in N s/m; for angles Nm and rad.

    K_D* is Fig. 8.3's: K_D of Table 8.1 is K_D* - beta, because the drag is compensated apart.
    """

    integral: float
    proportional: float
    derivative: float


@dataclass(frozen=True)
class TransferFunction:
    """eta/eta_ref; coefficients with the highest power first, as scipy.signal takes them."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class LoopDesign:
    """A structure with its gains, the model they were made for, and how far its drag is compensated.

    beta, beta_quadratic: compensated part of the drag. A structure with a D channel compensates all of it (8.5);
    without one the constant drag is the only damping there is and stays. speed_limit: |nu| in m/s or rad/s beyond
    which the compensation grows no further: the limiter of Fig. 8.3.
    """

    structure: Structure
    gains: Gains
    model: DegreeOfFreedom
    speed_limit: float = float("inf")

    beta: float = field(init=False)
    """Constant drag that is compensated, N s/m or Nm s/rad."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "beta", self.model.beta if self.structure.derivative else 0.0)

    @property
    def damping(self) -> float:
        """Damping of the closed loop on the model, N s/m or Nm s/rad."""
        return self.gains.derivative + self.model.beta - self.beta

    def compensation(self, nu: float) -> float:
        """Return the force that makes the compensated drag good, N or Nm."""
        speed, limit = abs(nu), self.speed_limit
        return (self.beta + self.model.beta_quadratic * (speed if speed < limit else limit)) * nu

    def transfer_function(self) -> TransferFunction:
        """Return eta/eta_ref, Table 8.1."""
        g, s = self.gains, self.structure
        numerator = [
            g.derivative - self.beta if s.d_on_error else 0.0,
            g.proportional if s.p_on_error else 0.0,
        ]
        denominator = [self.model.alpha, self.damping, g.proportional]
        if s.integral:
            numerator.append(g.integral)
            denominator.append(g.integral)
        while numerator[0] == 0.0:
            del numerator[0]
        return TransferFunction(tuple(numerator), tuple(denominator))


def ipd_gains(alpha: float, a: Coefficients) -> Gains:
    """Return the gains that give inertia alpha (kg or kg m^2) the closed loop (8.4), thesis (8.5); a: (a1, a2, a3)."""
    a1, a2, a3 = a
    return Gains(integral=alpha / a3, proportional=a1 / a3 * alpha, derivative=a2 / a3 * alpha)


def speed_gains(alpha: float, a: Coefficients) -> Gains:
    """Return the gains of I-P on a speed: alpha nu' = tau with compensated drag gets G(s) = 1/(a2 s^2 + a1 s + 1).

    nu stands in the place of eta in (8.2); K_P - beta is what (8.5) would call K_P.
    """
    a1, a2 = a
    return Gains(integral=alpha / a2, proportional=a1 / a2 * alpha, derivative=0.0)


def design(structure: Structure, model: DegreeOfFreedom, a: Coefficients) -> LoopDesign:
    """Return the loop whose denominator is the model function a: (a1, a2), or (a1, a2, a3) with an integral.

    Structures without D have a gain less than the model function has coefficients: they keep its highest one (the
    bandwidth) and, with an integral, a1; their damping is the vessel's. Raise ValueError for another order, and
    when that damping is not enough.
    """
    if len(a) != structure.order:
        raise ValueError(f"{structure.name} takes a model function of order {structure.order}, not {len(a)}")
    if structure.integral:
        gains = ipd_gains(model.alpha, a)
        if not structure.derivative:
            gains = Gains(gains.integral, gains.proportional, 0.0)
    else:
        a1, a2 = a
        gains = Gains(0.0, model.alpha / a2, a1 / a2 * model.alpha if structure.derivative else 0.0)
    made = LoopDesign(structure, gains, model)
    if not is_stable(made.transfer_function().denominator):
        raise ValueError(
            f"{structure.name} is not stable with this model function: "
            f"the damping {made.damping:.4g} is the vessel's, and {_least_damping(made):.4g} is needed"
        )
    return made


def _least_damping(made: LoopDesign) -> float:
    """Return the damping at which the loop would be at its limit, by Routh-Hurwitz."""
    g = made.gains
    return made.model.alpha * g.integral / g.proportional
