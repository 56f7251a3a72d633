"""Step responses: the printed numbers of pladypos and thesis 4.3, and the three ways to read a run."""

from __future__ import annotations

import math

import numpy as np
import pytest

from marine.identification import step
from marine.identification.result import Drag, IdentificationError, Identified, in_paper_units
from marine.vessel import PaperUnits

# PlaDyPos, surge, pladypos Table 2: pixels and normalised force
ALPHA, BETA = 8.252, 0.0378
X = 100.0
T = np.arange(0.0, 40.0, 1.0 / 30.0)


def test_response_reaches_76_percent_at_T_N() -> None:
    """Pladypos (10): u(T_N) = tanh 1 = 0.761 u_ss; u_ss = 51.4 px/s at X = 100."""
    T_N = step.time_constant(X, ALPHA, BETA, "linear")
    (u,) = step.velocity_response(np.array([T_N]), X, ALPHA, BETA, "linear")
    assert u / step.steady_state(X, BETA, "linear") == pytest.approx(0.761, abs=6e-4)
    assert step.steady_state(-X, BETA, "linear") == pytest.approx(-51.43, abs=0.01)


def test_response_reaches_63_percent_at_T_L() -> None:
    """Thesis (4.33)."""
    (nu,) = step.velocity_response(np.array([2.0 / 0.5]), 3.0, 2.0, 0.5, "constant")
    assert nu / (3.0 / 0.5) == pytest.approx(0.632, abs=1e-3)


def test_distance_to_steady_state_does_not_depend_on_the_force() -> None:
    """95 / 98 / 99 % of the speed take 1.59 / 2.20 / 2.67 m with 160 px/m, whatever the force (issue 6)."""
    for force in (10.0, 100.0):
        T_N = step.time_constant(force, ALPHA, BETA, "linear")
        at = T_N * np.arctanh([0.95, 0.98, 0.99])
        metres = step.position_response(at, force, ALPHA, BETA, "linear") / 160.0
        assert metres == pytest.approx([1.59, 2.20, 2.67], abs=0.006)


def test_position_is_the_integral_of_velocity_and_the_printed_logarithm() -> None:
    """Thesis (4.46), literally, against our form that does not overflow; (4.42) likewise."""
    a = math.sqrt(BETA * X) / ALPHA
    literal = 5.0 - ALPHA / BETA * (-math.log(2.0) + T * a + np.log(1.0 + np.exp(-2.0 * T * a)))
    assert step.position_response(T, -X, ALPHA, BETA, "linear", eta_0=5.0) == pytest.approx(literal)
    literal = 3.0 * 2.0 / 0.25 * (np.exp(-0.25 * T) - 1.0) + 3.0 / 0.5 * T
    assert step.position_response(T, 3.0, 2.0, 0.5, "constant") == pytest.approx(literal)
    assert np.isfinite(step.position_response(np.array([1e6]), X, ALPHA, BETA, "linear")).all()


@pytest.mark.parametrize("tau", [X, -X])
@pytest.mark.parametrize("drag", ["constant", "linear"])
def test_all_three_ways_find_the_model(drag: Drag, tau: float) -> None:
    beta = 4.0 if drag == "constant" else BETA
    name = "beta" if drag == "constant" else "beta_quadratic"
    nu = step.velocity_response(T, tau, ALPHA, beta, drag)
    eta = step.position_response(T, tau, ALPHA, beta, drag, eta_0=7.0)
    for found, within in (
        (step.type_0(T, nu, tau, drag=drag), 5e-3),
        (step.type_1(T, eta, tau, drag=drag, axis="linear"), 5e-3),
        (step.fit_response(T, tau, eta=eta, drag=drag), 1e-6),
        (step.fit_response(T, tau, nu=nu, drag=drag), 1e-6),
    ):
        assert found["alpha"] == pytest.approx(ALPHA, rel=within)
        assert found[name] == pytest.approx(beta, rel=within)
        assert not found.warnings
        assert found.residual_rms < 0.005 * abs(nu[-1])


def test_astatic_formulas_reproduce_a_row_of_table_7_10() -> None:
    """N = -5.15e-2 Nm: k_ss = -49.38 deg/s, |eps_v| = 27.93 deg give alpha 8.51e-4, beta_rr 21.11e-6."""
    alpha, beta = step.from_type_1(-5.15e-2, -49.38, 27.93, 0.0, "linear")
    assert (1e4 * alpha, 1e6 * beta) == pytest.approx((8.51, 21.11), rel=2e-3)
    _, beta = step.from_type_1(-5.15e-2, -49.38, 27.93, 0.0, "constant")
    assert 1e4 * beta == pytest.approx(10.42, rel=2e-3)


def test_runs_that_end_early_are_marked_and_the_whole_fit_still_finds_them() -> None:
    short = T[step.time_constant(X, ALPHA, BETA, "linear") * 1.5 > T]
    nu = step.velocity_response(short, X, ALPHA, BETA, "linear")
    by_formula = step.type_0(short, nu, X)
    assert "ends at 9" in by_formula.warnings[0]
    assert by_formula["beta_quadratic"] > 1.15 * BETA  # as the warning says
    fitted = step.fit_response(short, X, nu=nu)
    assert fitted.warnings
    assert fitted["beta_quadratic"] == pytest.approx(BETA, rel=1e-5)


def test_campaign_gives_mean_and_standard_deviation_with_ddof_1() -> None:
    """Noise as a camera's; six levels, five runs: fit within 1 %, spread below 3 % (issue 6's limits)."""
    rng = np.random.default_rng(1)
    runs = []
    for force in np.linspace(36.0, 180.0, 6):
        t = T[: int(30 * 2.5 * step.time_constant(force, ALPHA, BETA, "linear"))]
        eta = step.position_response(t, force, ALPHA, BETA, "linear")
        runs += [step.fit_response(t, force, eta=eta + 0.2 * rng.standard_normal(len(t))) for _ in range(5)]
    mean = step.together(runs)
    assert mean["alpha"] == pytest.approx(ALPHA, rel=0.01)
    assert mean["beta_quadratic"] == pytest.approx(BETA, rel=0.01)
    values = [r["alpha"] for r in runs]
    assert mean.parameter("alpha").std == pytest.approx(np.std(values, ddof=1))
    assert mean.parameter("alpha").std < 0.03 * ALPHA
    # a run's own standard deviation is what the runs scatter by
    assert np.median([r.parameter("alpha").std for r in runs]) == pytest.approx(np.std(values), rel=0.6)


def test_equal_and_unequal_axes_are_told_apart() -> None:
    rng = np.random.default_rng(2)
    t = T[:900]

    def campaign(alpha: float) -> Identified:
        eta = step.position_response(t, X, alpha, BETA, "linear")
        return step.together([step.fit_response(t, X, eta=eta + rng.standard_normal(len(t))) for _ in range(10)])

    surge, sway, other = campaign(ALPHA), campaign(ALPHA), campaign(1.02 * ALPHA)
    assert step.equal(surge, sway, "alpha")[1] < 3.0
    percent, deviations = step.equal(other, surge, "alpha")
    assert percent == pytest.approx(2.0, abs=0.3)
    assert deviations > 4.0


def test_refuses_what_is_no_step() -> None:
    nu = step.velocity_response(T, X, ALPHA, BETA, "linear")
    with pytest.raises(IdentificationError, match="sign of tau"):
        step.type_0(T, nu, -X)
    with pytest.raises(IdentificationError, match="record from rest"):
        step.type_0(T, nu[::-1], X)
    with pytest.raises(IdentificationError, match="zero"):
        step.type_0(T, nu, 0.0)
    with pytest.raises(IdentificationError, match="different methods"):
        step.together([step.type_0(T, nu, X), step.fit_response(T, X, nu=nu)])
    assert "saturated" in step.type_0(T, nu, X, tau_limit=X).warnings[0]


def test_si_goes_back_to_the_units_of_pladypos_table_2() -> None:
    """alpha_u 8.252 s^2/pix, beta_uu 0.0378 s^2/pix^2; alpha_r 87.68, beta_rr 48.83 in normalised moment and rad."""
    units = PaperUnits(length_m=0.00625, force_n=0.02, moment_nm=0.006)
    surge = (ALPHA * 0.02 / 0.00625, BETA * 0.02 / 0.00625**2)
    metres = step.position_response(T, 2.0, *surge, "linear")
    found = step.fit_response(T, 2.0, eta=metres)
    assert in_paper_units(found, units) == pytest.approx({"alpha": 8.252, "beta_quadratic": 0.0378})
    yaw = step.position_response(T, 0.3, 87.68 * 0.006, 48.83 * 0.006, "linear")
    found = step.fit_response(T, 0.3, eta=yaw, axis="angular")
    assert in_paper_units(found, units) == pytest.approx({"alpha": 87.68, "beta_quadratic": 48.83})
