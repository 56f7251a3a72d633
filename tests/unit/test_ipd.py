import numpy as np
import pytest
from scipy import signal

from marine.control.ipd import Ipd, gains
from marine.control.model_function import bessel
from marine.vessel import DegreeOfFreedom


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_bessel_is_scipys_with_phase_normalisation(order: int) -> None:
    b, a = signal.bessel(order, 1.7, analog=True, norm="phase")
    assert [1.0, *bessel(order, 1.7)] == pytest.approx(list(a[::-1] / b[-1]), rel=1e-9)


def test_bessel_has_the_thesis_numbers() -> None:
    assert bessel(3, 1.0) == pytest.approx((2.466, 2.433, 1.0), abs=5e-4)
    assert bessel(3, 0.45) == pytest.approx((5.48, 12.01, 10.97), abs=6e-3)  # thesis 8.1.5, Charlie


def test_gains_follow_8_5() -> None:
    g = gains(26.4, (5.0, 10.0, 8.0))
    assert (g.integral, g.proportional, g.derivative) == pytest.approx((3.3, 16.5, 33.0))


def closed_loop(model: DegreeOfFreedom, law: Ipd, reference: float, limit: float = np.inf) -> tuple[list[float], float]:
    """Return eta every 10 ms for 40 s after a step of the reference, and the largest action."""
    dt, eta, nu, missing, etas, largest = 0.01, 0.0, 0.0, 0.0, [], 0.0
    law.follow(0.0, nu)
    before = eta
    for _ in range(4000):
        law.advance(dt, reference - eta, eta - before, missing)
        before = eta
        demand = law.demand(nu)
        tau = max(-limit, min(limit, demand))
        missing = tau - demand
        nu += dt * (tau - model.drag(nu)) / model.alpha
        eta += dt * nu
        etas.append(eta)
        largest = max(largest, abs(law.action))
    return etas, largest


@pytest.mark.parametrize("model", [DegreeOfFreedom(26.4, 12.0, 0.0), DegreeOfFreedom(26.4, 0.0, 19.35)])
def test_closed_loop_is_the_model_function(model: DegreeOfFreedom) -> None:
    a = bessel(3, 0.5)
    etas, _ = closed_loop(model, Ipd(model, a, 1.0), reference=0.5)
    t = np.arange(1, 4001) * 0.01
    _, expected = signal.step(([0.5], [a[2], a[1], a[0], 1.0]), T=t)
    assert np.max(np.abs(np.array(etas) - expected)) < 0.005


def test_anti_windup_bounds_the_action_and_the_overshoot() -> None:
    model, a = DegreeOfFreedom(26.4, 0.0, 19.35), bessel(3, 0.5)
    etas, action = closed_loop(model, Ipd(model, a, 1.0), reference=4.0, limit=1.0)
    wound_up, wound_action = closed_loop(model, Ipd(model, a, 1e12), reference=4.0, limit=1.0)
    assert max(etas) < 4.0 * 1.05 < max(wound_up)
    assert action < 0.5 * wound_action
