"""Telemetron and asv (2)-(4), (12), (13), Table 1."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from marine.dynamics.asv import AsvDynamics, AsvState, froude_number, region, regressors, speed_at_froude
from marine.vessel import AsvModel
from services.vessels import load_vessel

VESSEL = load_vessel("telemetron")
assert isinstance(VESSEL.dynamics, AsvModel)
MODEL = VESSEL.dynamics
ASV = AsvDynamics(MODEL)
REST: AsvState = (0.0, 0.0, 0.0, 0.0, 0.0)


def run(seconds: float, throttle: float, rudder: float, state: AsvState = REST) -> AsvState:
    for _ in range(round(seconds / 0.05)):
        state = ASV.step(state, 0.05, throttle, rudder)
    return state


@pytest.mark.parametrize(
    ("length_m", "displacement", "planing"),
    [(4.0, "2.51", "6.26"), (8.0, "3.54", "8.86"), (50.0, "8.86", "22.1"), (100.0, "12.5", "31.3")],
)
def test_table_1(length_m: float, displacement: str, planing: str) -> None:
    for froude, printed in ((0.4, displacement), (1.0, planing)):
        speed = speed_at_froude(froude, length_m)
        assert f"{speed:.{len(printed.split('.')[1])}f}" == printed
        assert froude_number(speed, length_m) == pytest.approx(froude)


def test_regions_of_telemetron() -> None:
    # asv section 2: displacement up to 3.54 m/s, planing from 8.86 m/s for 8 m.
    length = MODEL.submerged_length_m
    assert [region(U, length) for U in (3.5, 3.6, 8.8, 8.9)] == [
        "displacement", "semi-displacement", "semi-displacement", "planing",
    ]  # fmt: skip


def test_damping_of_one_regressor_at_a_time_is_asv_12() -> None:
    U, r = 3.0, -0.2
    expected = [1, U, r, U**2, U * r, r**2, U**3, U**2 * r, U * r**2, r**3]
    expected += [U**4, U**3 * r, U**2 * r**2, U * r**3, r**4]
    assert regressors(U, r) == pytest.approx(expected)


def test_every_figure_of_the_text_is_respected() -> None:
    assert run(120.0, 1.0, 0.0)[3] == pytest.approx(18.0, abs=0.01)  # abstract: up to 18 m/s
    reached = [run(120.0, t, 0.0)[3] for t in np.arange(0.0, 1.01, 0.1)]
    gains = [b - a for a, b in itertools.pairwise(reached)]
    assert min(gains) > 0.0
    assert max(gains[6:]) < 0.75 * min(gains[3:6])  # 3.3: beyond throttle 0.6 the response is greatly reduced
    m_U = [ASV.inertia(U, 0.0)[0] for U in np.linspace(0.0, 18.0, 50)]
    assert min(m_U) < 0.12
    assert max(m_U) == pytest.approx(0.1711, abs=1e-4)  # Fig. 6
    for U in (2.0, 6.0, 12.0):  # 5.1: +-0.75 m/s^2 and +-0.1 rad/s^2 are feasible
        throttle = ASV.damping(U, 0.0)[0]
        assert (1.0 - throttle) / ASV.inertia(U, 0.0)[0] > 0.75
        assert throttle / ASV.inertia(U, 0.0)[0] > 0.75
        assert 1.0 / ASV.inertia(U, 0.0)[1] > 0.1


@given(st.floats(0.0, 18.0), st.floats(-0.45, 0.45))
def test_port_and_starboard_mirror_each_other_and_damping_brakes(U: float, r: float) -> None:
    (s_U, s_r), (m_U, m_r) = ASV.damping(U, r), ASV.damping(U, -r)
    assert (s_U, s_r) == pytest.approx((m_U, -m_r), abs=1e-12)
    assert s_U >= 0.0
    assert s_r * r >= 0.0
    assert min(ASV.inertia(U, r)) > 0.0


def test_a_step_agrees_with_an_exact_integration() -> None:
    exact = solve_ivp(
        lambda _t, s: np.array(ASV.derivative((s[0], s[1], s[2], s[3], s[4]), 0.5, 0.4)),
        (0.0, 20.0),
        list(REST),
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    )
    assert run(20.0, 0.5, 0.4) == pytest.approx(exact.y[:, -1], rel=1e-5)


def test_without_throttle_it_comes_to_rest_and_does_not_go_astern() -> None:
    x, _, _, U, r = run(300.0, 0.0, -1.0, (0.0, 0.0, 0.0, 12.0, 0.2))
    assert 0.0 <= U < 1e-3
    assert r == pytest.approx(-1.0 / 2.4, rel=1e-3)
    assert math.isfinite(x)


def test_the_design_model_is_the_tangent_at_the_design_speed() -> None:
    U0, h = MODEL.design_speed_m_s, 1e-4
    throttle = ASV.damping(U0, 0.0)[0]
    U_dot, r_dot = ASV.acceleration(U0 + h, h, throttle, 0.0)
    surge, yaw = VESSEL.model.surge, VESSEL.model.yaw
    assert U_dot == pytest.approx(-surge.drag(h) / surge.alpha, rel=1e-2)
    assert r_dot == pytest.approx(-yaw.drag(h) / yaw.alpha, rel=1e-2)
