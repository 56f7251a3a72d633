"""Closed forms of thesis 4.3 against integration, and against what chapter 7 prints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marine.dynamics.step_response import steady_speed, time_constant, velocity_error
from marine.identification.result import Drag
from marine.identification.step import position_response, velocity_response
from marine.vessel import DegreeOfFreedom

LINEAR = DegreeOfFreedom(80.0, 300.0, 0.0)  # Table 7.1 without its small quadratic part
QUADRATIC = DegreeOfFreedom(1.018, 0.0, 1.257)  # Table 7.5

# Table 7.10: N (1e-2 Nm), k_ss (deg/s), eps_v (deg), beta_r (1e-4), beta_rr (1e-6), alpha_r (1e-4)
TABLE_7_10 = [
    (5.15, 49.38, 27.93, 10.42, 21.11, 8.51),
    (4.71, 44.93, 18.46, 10.48, 23.33, 6.21),
    (4.27, 40.73, 18.12, 10.49, 25.75, 6.73),
    (3.83, 39.71, 23.06, 9.66, 24.32, 8.09),
    (3.40, 39.26, 23.28, 8.65, 22.04, 7.40),
    (2.96, 35.72, 19.63, 8.29, 23.19, 6.57),
    (2.52, 32.53, 20.85, 7.75, 23.83, 7.17),
    (2.08, 28.29, 15.68, 7.37, 26.05, 5.89),
    (1.65, 28.13, 22.87, 5.86, 20.82, 6.87),
    (1.21, 27.49, 36.94, 4.40, 16.01, 8.53),
    (0.77, 18.62, 29.38, 4.15, 22.26, 9.44),
    (0.34, 10.96, 18.86, 3.05, 27.87, 7.58),
    (4.27, 41.84, 17.23, 10.21, 24.41, 6.07),
    (5.15, 50.54, 20.88, 10.18, 20.15, 6.07),
]


def form(dof: DegreeOfFreedom) -> tuple[float, float, Drag]:
    """Return alpha, the one drag coefficient and its form, as `marine.identification.step` takes them."""
    return (dof.alpha, dof.beta, "constant") if dof.beta else (dof.alpha, dof.beta_quadratic, "linear")


@pytest.mark.parametrize("dof", [LINEAR, QUADRATIC])
@pytest.mark.parametrize("tau", [0.6, -300.0])
def test_closed_forms_solve_the_differential_equation(dof: DegreeOfFreedom, tau: float) -> None:
    # (4.30), (4.42) and (4.35), (4.46)
    T = time_constant(dof, tau)
    times = np.linspace(0.0, 6.0 * T, 25)
    exact = solve_ivp(
        lambda _t, s: [s[1], (tau - dof.drag(s[1])) / dof.alpha],
        (0.0, times[-1]), [0.4, 0.0], method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    model = form(dof)
    assert position_response(times, tau, *model, eta_0=0.4) == pytest.approx(exact.y[0], rel=1e-8)
    assert velocity_response(times, tau, *model) == pytest.approx(exact.y[1], rel=1e-8, abs=1e-12)
    late = 40.0 * T
    rest = float(position_response(np.array([late]), tau, *model, eta_0=0.4)[0]) - steady_speed(dof, tau) * late
    assert rest == pytest.approx(velocity_error(dof, tau, 0.4), rel=1e-9)


def test_time_constants_are_the_63_and_76_per_cent_of_the_papers() -> None:
    assert time_constant(LINEAR, 1.0) == pytest.approx(80.0 / 300.0)  # (4.32)
    reached = velocity_response(np.array([80.0 / 300.0]), 5.0, *form(LINEAR)) / steady_speed(LINEAR, 5.0)
    assert reached == pytest.approx(0.632, abs=5e-4)  # (4.33)
    T = time_constant(QUADRATIC, 0.8)
    assert pytest.approx(1.018 / math.sqrt(1.257 * 0.8)) == T  # (4.37), pladypos (10)
    reached = velocity_response(np.array([T]), 0.8, *form(QUADRATIC)) / steady_speed(QUADRATIC, 0.8)
    assert round(float(reached[0]), 3) == 0.762
    assert math.tanh(1.0) == pytest.approx(0.761, abs=1e-3)  # the papers cut, we round


@pytest.mark.parametrize("row", TABLE_7_10)
def test_table_7_10_follows_from_the_formulas_of_table_4_1(row: tuple[float, ...]) -> None:
    # Tolerances are what the printed digits leave open, no more.
    N, k_ss, eps, beta_r, beta_rr, alpha = row
    rounded = 0.005 / (N - 0.005)
    nonlinear = DegreeOfFreedom(alpha * 1e-4, 0.0, beta_rr * 1e-6)
    linear = DegreeOfFreedom(1.0, beta_r * 1e-4, 0.0)
    assert steady_speed(nonlinear, N * 1e-2) == pytest.approx(
        k_ss, rel=0.5 * (rounded + 0.005 / beta_rr) + 0.005 / k_ss
    )
    assert steady_speed(linear, N * 1e-2) == pytest.approx(k_ss, rel=rounded + 0.006 / beta_r + 0.005 / k_ss)
    assert -velocity_error(nonlinear, N * 1e-2) == pytest.approx(eps, rel=0.005 / alpha + 0.005 / beta_rr + 0.005 / eps)


def test_with_drag_of_both_kinds_there_is_a_steady_speed_but_no_closed_response() -> None:
    falcon = DegreeOfFreedom(130.0, 200.0, 20.0)  # Table 7.3
    w = steady_speed(falcon, -200.0)
    assert falcon.drag(w) == pytest.approx(-200.0)
    assert w < 0.0
    with pytest.raises(ValueError, match="one kind"):
        time_constant(falcon, 200.0)
    with pytest.raises(ValueError, match="without drag"):
        steady_speed(DegreeOfFreedom(1.0, 0.0, 0.0), 1.0)
