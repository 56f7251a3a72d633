"""Least squares, zig-zag integrals and validation: recovered models, standard deviations, real ship, speed."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import radians
from pathlib import Path

import numpy as np
import pytest

from marine.identification import harmonic, least_squares, response_fit, self_oscillation, step, validation, zigzag
from marine.identification.paper_tables import TABLE_7_12
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import Drag, FloatArray, IdentificationError, Identified
from marine.identification.running import RunningEstimate
from marine.vessel import DegreeOfFreedom

SHIP = Path(__file__).parents[3] / "shared/data/ship/esso-osaka/zigzag"
CHARLIE = DegreeOfFreedom(TABLE_7_12[3].alpha_linear, TABLE_7_12[3].beta, 0.0)
"""Yaw at n^2 = 49, day 1: alpha 7.89, beta 2.67; N is the rudder angle in rad."""
VIDEORAY = DegreeOfFreedom(5.26e-4 / radians(1.0), 0.0, 25.95e-6 / radians(1.0) ** 2)
"""Yaw of Table 7.8: alpha 5.26e-4 Nms^2/deg, beta_rr 25.95e-6 Nms^2/deg^2."""


def excited(
    dof: DegreeOfFreedom, C: float, *, dt_s: float = 0.01, duration_s: float = 120.0, delta: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return (t, eta, nu, tau): random levels held for random times, integrated finely."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, duration_s, dt_s)
    changes = np.cumsum(rng.uniform(1.0, 4.0, int(duration_s)))
    levels = rng.choice([-1.0, -0.6, 0.5, 1.0], len(changes) + 1) * C
    tau = levels[np.searchsorted(changes, t)]
    nu = validation.simulate(dof, t, tau, delta=delta)
    return t, np.concatenate([[0.0], np.cumsum(0.5 * dt_s * (nu[1:] + nu[:-1]))]), nu, tau


@pytest.mark.parametrize(("dof", "drag", "C"), [(CHARLIE, "constant", 0.4), (VIDEORAY, "linear", 0.08)])
def test_least_squares_recovers_model_and_disturbance(dof: DegreeOfFreedom, drag: Drag, C: float) -> None:
    t, eta, nu, tau = excited(dof, C, delta=0.1 * C)
    beta, name = (dof.beta, "beta") if drag == "constant" else (dof.beta_quadratic, "beta_quadratic")
    for found, within in (
        (least_squares.uncoupled(t, tau, nu=nu, drag=drag), 0.02),
        (least_squares.uncoupled(t, tau, nu=nu, drag=drag, window_s=1.0), 0.002),
        (least_squares.uncoupled(t, tau, eta=eta, drag=drag, window_s=1.0), 0.004),
        (least_squares.uncoupled(t, tau, eta=eta, drag=drag), 0.02),
    ):
        assert found["alpha"] == pytest.approx(dof.alpha, rel=within)
        assert found[name] == pytest.approx(beta, rel=within)
        assert found["delta"] == pytest.approx(0.1 * C, rel=5 * within)


def test_integrals_stand_the_quantised_compass_that_differences_do_not() -> None:
    """Thesis 7.2, 7.3.1: 2 degrees at 0.1 s are 20 deg/s after differentiation."""
    t, eta, _, tau = excited(VIDEORAY, 0.08, dt_s=0.1, duration_s=300.0)
    coarse = np.round(eta / radians(2.0)) * radians(2.0)
    differences = least_squares.uncoupled(t, tau, eta=coarse)
    integrals = least_squares.uncoupled(t, tau, eta=coarse, window_s=0.8)
    assert differences["alpha"] < 0.7 * VIDEORAY.alpha
    assert integrals["alpha"] == pytest.approx(VIDEORAY.alpha, rel=0.03)
    assert integrals["beta_quadratic"] == pytest.approx(VIDEORAY.beta_quadratic, rel=0.02)


def test_standard_deviations_are_what_repetitions_scatter_by() -> None:
    t, _, nu, tau = excited(CHARLIE, 0.4, dt_s=0.05, duration_s=200.0)
    rng = np.random.default_rng(7)
    runs = [
        least_squares.uncoupled(t, tau, nu=nu + 0.002 * rng.standard_normal(len(t)), drag="constant", window_s=1.0)
        for _ in range(40)
    ]
    for name in ("alpha", "beta", "delta"):
        scatter = np.std([r[name] for r in runs], ddof=1)
        stated = np.median([r.parameter(name).std for r in runs])
        assert 0.7 * scatter < stated < 3.5 * scatter  # never much too small; windows overlap, so rather too large


def test_both_drags_together() -> None:
    dof = DegreeOfFreedom(2.0, 0.5, 1.5)
    t, _, nu, tau = excited(dof, 2.0)
    found = least_squares.uncoupled(t, tau, nu=nu, drag="both", window_s=0.5)
    assert [found[n] for n in ("alpha", "beta", "beta_quadratic")] == pytest.approx([2.0, 0.5, 1.5], rel=0.01)


def test_recursive_ends_where_least_squares_ends_and_forgets_on_request() -> None:
    t, _, nu, tau = excited(VIDEORAY, 0.08, dt_s=0.1)
    batch = least_squares.uncoupled(t, tau, nu=nu)
    recursive = least_squares.RecursiveLeastSquares(0.1)
    with pytest.raises(IdentificationError, match="too few"):
        recursive.result()
    for v, force in zip(nu, tau, strict=True):
        recursive.update(float(v), float(force))
    for name in ("alpha", "beta_quadratic", "delta"):
        assert recursive.result()[name] == pytest.approx(batch[name], rel=1e-5, abs=1e-7)
    heavier = DegreeOfFreedom(1.5 * VIDEORAY.alpha, 0.0, VIDEORAY.beta_quadratic)
    t, _, nu, tau = excited(heavier, 0.08, dt_s=0.1)
    forgetting = least_squares.RecursiveLeastSquares(0.1, forgetting=0.99)
    for v, force in zip(np.concatenate([excited(VIDEORAY, 0.08, dt_s=0.1)[2], nu]), np.tile(tau, 2), strict=True):
        forgetting.update(float(v), float(force))
    assert forgetting.result()["alpha"] == pytest.approx(least_squares.uncoupled(t, tau, nu=nu)["alpha"], rel=0.05)


def test_coupled_model_of_4_17() -> None:
    """m - X_udot = 12, m - Y_vdot = 18 kg, I_z - N_rdot = 0.9: theta_2 of surge 1.5, of sway -2/3, of yaw 6/0.9."""
    dt_s, n = 0.02, 6000
    nu, tau = np.zeros((n, 3)), np.zeros((n, 3))
    rng = np.random.default_rng(3)
    tau[:, 0] = np.repeat(rng.uniform(2.0, 9.0, n // 100), 100)
    tau[:, 2] = np.repeat(rng.uniform(-1.0, 1.0, n // 60), 60)
    for k in range(n - 1):
        u, v, r = nu[k]
        rate = (
            (-5.0 * u + 18.0 * v * r + tau[k, 0]) / 12.0,
            (-9.0 * v - 12.0 * u * r) / 18.0,
            (-0.7 * r + (12.0 - 18.0) * -1.0 * u * v * 0.1 + tau[k, 2]) / 0.9,
        )
        nu[k + 1] = nu[k] + dt_s * np.array(rate)
    found = least_squares.coupled(np.arange(n, dtype=float) * dt_s, nu, tau)
    assert found["surge"]["theta_2"] == pytest.approx(1.5, rel=1e-3)
    assert found["sway"]["theta_2"] == pytest.approx(-2.0 / 3.0, rel=1e-3)
    assert 1.0 / found["surge"]["theta_3"] == pytest.approx(12.0, rel=1e-3)
    assert found["yaw"]["theta_2"] == pytest.approx(0.6 / 0.9, rel=1e-3)
    assert found["yaw"]["theta_1"] == pytest.approx(-0.7 / 0.9, rel=1e-3)
    assert not found["sway"].warnings
    with pytest.raises(KeyError, match="theta_3"):
        found["sway"]["theta_3"]


def zig_zag(delta: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (t, eta, tau) of a zig-zag of Charlie at 10 degrees of heading, 25 of rudder."""
    loop = RelayLoop(CHARLIE, radians(25.0), radians(10.0), delta=delta, sample_time_s=0.05)
    t, eta, tau = loop.run(90.0)
    return t, eta[:, 0], tau[:, 0]


@pytest.mark.parametrize("delta", [0.0, 0.06])
def test_zig_zag_integrals(delta: float) -> None:
    """(4.52), (4.53); with a disturbance the plain integrals miss and the ones with Delta do not."""
    t, eta, tau = zig_zag(delta)
    found = zigzag.integrals(t, eta, tau, disturbance=True)
    assert found["alpha"] == pytest.approx(7.89, rel=0.01)
    assert found["beta"] == pytest.approx(2.67, rel=0.01)
    assert found["delta"] == pytest.approx(delta, abs=1e-3)
    plain = zigzag.integrals(t, eta, tau)
    if delta == 0.0:
        assert (plain["alpha"], plain["beta"]) == pytest.approx((7.89, 2.67), rel=0.01)
    else:
        assert plain.parameter("beta").std > 10.0 * found.parameter("beta").std


def test_validation_formulas() -> None:
    """AutoMarine, Tables 7.10 and 7.11 (first and last row), in deg: worst cases of Fig. 7.14 and 7.15."""
    reference = (7.11e-4, 22.55e-6)
    far = validation.steady_state_difference(17.51e-6, reference[1], 6.46e-2)
    assert far == pytest.approx(7.22, abs=0.01)
    assert far < 8.0  # "less than 8 deg/s"
    slowest = validation.time_constant_difference((9.39e-4, 22.37e-6), reference, 3.4e-2)
    assert slowest == pytest.approx(0.265, abs=2e-3)
    assert slowest < 0.35  # "never above 0.35 s"
    assert validation.steady_state_difference_linear(2.67, 2.39, 0.4) == pytest.approx(0.4 * (1 / 2.39 - 1 / 2.67))
    assert validation.time_constant_difference_linear((7.89, 2.67), (7.51, 2.39)) == pytest.approx(0.187, abs=1e-3)
    assert validation.drag_difference_percent(2.67, 2.39) == pytest.approx(11.7, abs=0.05)
    assert validation.relative(12.0, 10.0) == pytest.approx(0.2)


def test_simulated_step_is_the_printed_response() -> None:
    t = np.arange(0.0, 5.0, 0.02)
    nu = validation.simulate(VIDEORAY, t, np.full(len(t), 0.08))
    exact = step.velocity_response(t, 0.08, VIDEORAY.alpha, VIDEORAY.beta_quadratic, "linear")
    assert np.max(np.abs(nu - exact)) < 1e-3 * exact[-1]
    assert validation.on_other_data(VIDEORAY, t[1:], exact[1:], np.linspace(0.08, 0.0800001, len(t) - 1)) < 1e-3


@pytest.fixture
def ship() -> dict[str, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Return (t, psi, r, delta) of the zig-zags of the Esso Osaka model by time of day."""
    if not SHIP.is_dir():
        pytest.skip(f"no ship data in {SHIP}")
    runs = {}
    for path in sorted(SHIP.glob("*.csv")):
        table = np.genfromtxt(path, delimiter=",", skip_header=1)
        runs[path.stem[-8:]] = (table[:, 0], np.unwrap(table[:, 5]), table[:, 6], table[:, 8])
    return runs


def test_real_ship_zig_zag_integrals_agree_with_least_squares(
    ship: dict[str, tuple[FloatArray, FloatArray, FloatArray, FloatArray]],
) -> None:
    for name in ("13_14_21", "13_42_53"):
        t, psi, r, delta = ship[name]
        squares = least_squares.uncoupled(t, delta, nu=r, drag="constant")
        turned = zigzag.integrals(t, psi, delta, nu=r, disturbance=True)
        assert turned["beta"] == pytest.approx(squares["beta"], rel=0.10)


def test_one_hour_at_100_hz_takes_a_second_each() -> None:
    period, n = 628, 360_000
    t = np.arange(n, dtype=float) * 0.01
    tau = np.where(np.arange(n) % period < period // 2, 0.08, -0.08)
    nu = validation.simulate(VIDEORAY, t[: 4 * period], tau[: 4 * period])[-period:]
    nu = np.tile(nu - np.mean(nu), n // period + 1)[:n]
    eta = np.cumsum(nu) * 0.01
    eta -= 0.5 * (eta.max() + eta.min())
    rising = step.position_response(t, 0.08, VIDEORAY.alpha, VIDEORAY.beta_quadratic, "linear")
    speed = step.velocity_response(t, 0.08, VIDEORAY.alpha, VIDEORAY.beta_quadratic, "linear")
    methods: dict[str, Callable[[], Identified | dict[str, Identified]]] = {
        "least squares": lambda: least_squares.uncoupled(t, tau, nu=nu),
        "least squares on integrals": lambda: least_squares.uncoupled(t, tau, eta=eta, window_s=1.0),
        "coupled": lambda: least_squares.coupled(
            t, np.column_stack([1.0 + nu, nu, np.roll(nu, 99)]), np.c_[tau, tau, tau]
        ),
        "zig-zag": lambda: zigzag.integrals(t, eta, tau, disturbance=True),
        "describing function": lambda: self_oscillation.from_record(t, eta, tau),
        "projection": lambda: harmonic.project(t, eta, tau),
        "response fit": lambda: response_fit.fit(t, eta, tau, axis="angular", disturbance=True),
        "step, velocity": lambda: step.type_0(t, speed, 0.08, axis="angular"),
        "step, slope": lambda: step.type_1(t, rising, 0.08),
        "step, whole fit": lambda: step.fit_response(t, 0.08, eta=rising, axis="angular"),
    }
    for name, method in methods.items():
        began = time.process_time()
        method()
        assert time.process_time() - began < 1.0, name


def test_a_running_estimate_of_a_coarse_compass_is_as_good_as_the_record_s_and_knows_how_good() -> None:
    """Samples one by one, 2 degrees at 0.1 s, 0.2 s late, a constant moment: deviations cover the errors."""
    loop = RelayLoop(
        VIDEORAY, 0.083, radians(20.0), 0.0083, delay_s=0.2, sample_time_s=0.1, quantisation=radians(2.0), noise=0.005
    )
    t, eta, tau = loop.run(60.0, runs=12, seed=1)
    off, known = [], []
    for k in range(12):
        running = RunningEstimate(0.8, delay_s=0.2)
        with pytest.raises(IdentificationError, match="too few"):
            running.result()
        for at_s, position, force in zip(t.tolist(), eta[:, k].tolist(), tau[:, k].tolist(), strict=True):
            running.force(at_s, force)
            running.position(at_s, position)
        found = running.result()
        for name, true in (("alpha", VIDEORAY.alpha), ("beta_quadratic", VIDEORAY.beta_quadratic)):
            off.append(found[name] / true - 1.0)
            known.append(found.parameter(name).std / true)
    assert np.max(np.abs(off)) < 0.03
    assert np.quantile(np.abs(off), 0.8) < 2.0 * np.mean(known) < 0.1


def test_a_running_estimate_takes_measurements_at_any_times_and_begins_anew_after_a_gap() -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.02, 0.05, 3000))
    t[1500:] += 30.0  # the sensor was silent, the vessel went on
    tau = 0.08 * np.sign(np.sin(0.8 * t))
    fine = np.arange(0.0, t[-1] + 0.01, 0.01)
    acting = 0.08 * np.sign(np.sin(0.8 * fine))
    nu = validation.simulate(VIDEORAY, fine, acting)
    eta = np.interp(t, fine, np.concatenate([[0.0], np.cumsum(0.005 * (nu[1:] + nu[:-1]))]))
    running = RunningEstimate(0.8)
    for at_s, position, force in zip(t.tolist(), eta.tolist(), tau.tolist(), strict=True):
        running.force(at_s, force)
        running.position(at_s, position)
    assert running.result()["alpha"] == pytest.approx(VIDEORAY.alpha, rel=0.05)
    assert running.result()["beta_quadratic"] == pytest.approx(VIDEORAY.beta_quadratic, rel=0.05)
