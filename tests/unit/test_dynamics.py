"""The uncoupled model against closed forms of the papers."""

from __future__ import annotations

import math

import pytest

from marine.dynamics.integrate import State, rk4
from marine.dynamics.uncoupled import Tau, UncoupledModel
from marine.frames import to_body
from marine.vessel import DegreeOfFreedom, HorizontalModel
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
MODEL = UncoupledModel(VESSEL.model)
AT_REST: State = (2.0, 1.5, 0.0, 0.0, 0.0, 0.0)


def run(
    model: UncoupledModel,
    state: State,
    seconds: float,
    *,
    dt_s: float = 0.02,
    tau: Tau = (0.0, 0.0, 0.0),
    current_m_s: tuple[float, float] = (0.0, 0.0),
) -> State:
    for _ in range(round(seconds / dt_s)):
        state = model.step(state, dt_s, tau, current_m_s)
    return state


@pytest.mark.parametrize("force_units", [20.0, 127.28, -60.0])
def test_surge_step_response_is_the_papers_hyperbolic_tangent(force_units: float) -> None:
    # pladypos (8) with Table 2, worked out in the paper's own units: pixels and normalised force.
    alpha, beta = 8.252, 0.0378
    T_n = alpha / math.sqrt(beta * abs(force_units))  # (10)
    u_ss = math.copysign(math.sqrt(abs(force_units) / beta), force_units)  # (9)
    state = AT_REST
    for n in range(1, 401):
        state = MODEL.step(state, T_n / 100, (force_units * VESSEL.units.force_n, 0.0, 0.0))
        if n in (50, 100, 400):
            u_px_s = state[3] / VESSEL.units.length_m
            assert u_px_s == pytest.approx(u_ss * math.tanh(n / 100), rel=1e-7)
        if n == 100:
            assert u_px_s / u_ss == pytest.approx(0.761, abs=1e-3)  # the paper's 76 %
    assert state[4:] == (0.0, 0.0)


def test_full_command_gives_the_speeds_of_the_vessel_file() -> None:
    # Four thrusters at 15: 2.546 N and 1.08 Nm; issue 2 says 0.36 m/s and 110 deg/s.
    forward = run(MODEL, AT_REST, 60.0, tau=(4 * 0.2 * 0.02 * 225 * math.sqrt(0.5), 0.0, 0.0))
    turning = run(MODEL, AT_REST, 60.0, tau=(0.0, 0.0, 4 * 0.2 * 0.02 * 225 * 0.3))
    assert forward[3] == pytest.approx(0.3627, abs=1e-4)
    assert math.degrees(turning[5]) == pytest.approx(110.0, abs=0.1)


def test_constant_drag_step_response_is_exponential() -> None:
    # pladypos (5), (7): time constant alpha / beta.
    dof = DegreeOfFreedom(alpha=3.0, beta=1.5, beta_quadratic=0.0)
    model = UncoupledModel(HorizontalModel(dof, dof, dof))
    state = run(model, AT_REST, 2.0, tau=(0.0, 0.6, 0.0))
    assert state[4] == pytest.approx(0.6 / 1.5 * (1.0 - math.exp(-1.0)), rel=1e-7)


@pytest.mark.parametrize("psi", [0.0, 0.7, -2.5])
def test_a_free_vessel_ends_up_drifting_with_the_current(psi: float) -> None:
    state = run(MODEL, (2.0, 1.5, psi, 0.0, 0.0, 0.0), 3000.0, dt_s=0.2, current_m_s=(0.05, -0.02))
    assert state[3:5] == pytest.approx(to_body(0.05, -0.02, psi), abs=1e-3)
    assert state[5] == 0.0


def test_a_disturbance_in_the_tank_acts_like_the_same_wrench_turned_into_the_body() -> None:
    state: State = (2.0, 1.5, 1.1, 0.1, -0.05, 0.3)
    turned = (*to_body(0.3, -0.2, 1.1), 0.01)
    disturbed = MODEL.derivative(state, (0.0, 0.0, 0.0), disturbance=(0.3, -0.2, 0.01))
    assert disturbed == pytest.approx(MODEL.derivative(state, turned))


def test_runge_kutta_is_of_fourth_order() -> None:
    start: State = (2.0, 1.5, 0.3, 0.2, -0.1, 0.8)
    tau = (2.0, -1.0, 0.5)
    exact = run(MODEL, start, 1.0, dt_s=1e-3, tau=tau)
    errors = [math.dist(run(MODEL, start, 1.0, dt_s=dt, tau=tau), exact) for dt in (0.25, 0.125)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.4)


def test_one_runge_kutta_step_of_exponential_decay() -> None:
    # x' = -x: 1 - h + h^2/2 - h^3/6 + h^4/24.
    stepped = rk4(lambda s: tuple(-v for v in s), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 0.1)
    factor = 1 - 0.1 + 0.1**2 / 2 - 0.1**3 / 6 + 0.1**4 / 24
    assert stepped == pytest.approx([k * factor for k in range(1, 7)], rel=1e-14)


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.05, -0.02)])
@pytest.mark.parametrize("disturbance", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.01)])
def test_the_quick_step_is_the_runge_kutta_step(current: tuple[float, float], disturbance: Tau) -> None:
    state, tau = (1.0, 2.0, 0.7, 0.2, -0.1, 0.5), (1.0, -0.4, 0.05)
    assert MODEL.step(state, 0.1, tau, current, disturbance) == rk4(
        MODEL.derivative, state, 0.1, tau, current, disturbance
    )
