from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from marine.dynamics.uncoupled import UncoupledModel
from marine.estimation.ekf import EkfTuning, PoseEkf, Verdict
from marine.frames import wrap_angle
from services.vessels import load_vessel

MODEL = load_vessel("pladypos").model
DT_S = 1 / 30


def settled(x_m: float = 2.0, y_m: float = 1.5, psi_rad: float = 0.0) -> PoseEkf:
    ekf = PoseEkf(MODEL, EkfTuning(), x_m, y_m, psi_rad)
    for _ in range(300):
        ekf.predict(DT_S, (0.0, 0.0, 0.0))
        assert ekf.update(x_m, y_m, psi_rad) is Verdict.USED
    return ekf


def test_transition_is_the_derivative_of_the_model() -> None:
    ekf = PoseEkf(MODEL, EkfTuning(), 2.0, 1.5, 0.0)
    ekf.disturbance = (0.3, -0.2, 0.02)
    state = np.array([2.0, 1.5, 0.8, 0.2, -0.1, 0.5, *ekf.disturbance])
    dynamics = UncoupledModel(MODEL)

    def rate(s: np.ndarray) -> np.ndarray:
        derivative = dynamics.derivative(tuple(s[:6]), (1.0, 0.5, 0.1), disturbance=tuple(s[6:]))
        return np.array([*derivative, 0.0, 0.0, 0.0])

    numeric = np.empty((9, 9))
    for i in range(9):
        h = np.zeros(9)
        h[i] = 1e-6
        numeric[:, i] = (rate(state + h) - rate(state - h)) / 2e-6
    ekf.disturbance = (0.3, -0.2, 0.02)
    psi, u, v, r = state[2:6].tolist()
    transition = ekf._transition(psi, u, v, r, DT_S)
    np.testing.assert_allclose((transition - np.eye(9)) / DT_S, numeric, atol=1e-7)


def test_the_same_update_as_the_textbook() -> None:
    ekf = settled()
    ekf.predict(DT_S, (1.0, 0.5, 0.1))
    before = copy.copy(ekf)
    assert ekf.update(2.0008, 1.4995, 0.001) is Verdict.USED
    H, P = np.eye(3, 9), before.covariance
    t = before.tuning
    R = np.diag([t.position_m**2, t.position_m**2, t.heading_rad**2])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    mean = np.array([*before.state, *before.disturbance])
    mean = mean + K @ (np.array([2.0008, 1.4995, 0.001]) - mean[:3])
    np.testing.assert_allclose([*ekf.state, *ekf.disturbance], mean, rtol=1e-9, atol=1e-15)
    joseph = (np.eye(9) - K @ H) @ P @ (np.eye(9) - K @ H).T + K @ R @ K.T
    np.testing.assert_allclose(ekf.covariance, joseph, rtol=1e-9, atol=1e-16)


def test_a_copy_goes_its_own_way() -> None:
    ekf = settled()
    state, covariance = ekf.state, ekf.covariance.copy()
    ahead = copy.copy(ekf)
    ahead.predict(0.1, (2.0, 0.0, 0.0))
    assert ahead.state != state
    assert ekf.state == state
    np.testing.assert_array_equal(ekf.covariance, covariance)


def test_an_unknown_force_is_found() -> None:
    # The truth is pushed by (0.2, -0.1) N and 0.01 Nm, turning slowly; the filter is told nothing of it.
    dynamics, push = UncoupledModel(MODEL), (0.2, -0.1, 0.01)
    truth = (2.0, 1.5, 3.0, 0.0, 0.0, 0.0)
    ekf = PoseEkf(MODEL, EkfTuning(), *truth[:3])
    rng = np.random.default_rng(1)
    for _ in range(450):
        truth = dynamics.step(truth, DT_S, (0.1, 0.0, 0.0), disturbance=push)
        ekf.predict(DT_S, (0.1, 0.0, 0.0))
        noise = rng.normal(size=3) * [0.0006, 0.0006, 0.002]
        ekf.update(truth[0] + noise[0], truth[1] + noise[1], wrap_angle(truth[2] + noise[2]))
    assert ekf.disturbance == pytest.approx(push, abs=0.06)
    assert ekf.disturbance[2] == pytest.approx(0.01, abs=0.004)
    assert ekf.state[:2] == pytest.approx(truth[:2], abs=1.5e-3)
    assert ekf.state[3:5] == pytest.approx(truth[3:5], abs=5e-3)


def test_heading_passes_through_pi() -> None:
    ekf = settled(psi_rad=math.pi - 1e-4)
    ekf.predict(DT_S, (0.0, 0.0, 0.0))
    assert ekf.update(2.0, 1.5, -math.pi + 1e-4) is Verdict.USED
    assert abs(wrap_angle(ekf.state[2] - math.pi)) < 2e-4
    assert -math.pi < ekf.state[2] <= math.pi


@pytest.mark.parametrize("pose", [(2.05, 1.5, 0.0), (2.0, 1.5, 0.1), (1e300, 1.5, 0.0), (math.nan, 1.5, 0.0)])
def test_a_single_outlier_is_refused_and_changes_nothing(pose: tuple[float, float, float]) -> None:
    ekf = settled()
    ekf.predict(DT_S, (0.0, 0.0, 0.0))
    state = ekf.state
    assert ekf.update(*pose) is Verdict.REFUSED
    assert ekf.state == state
    assert ekf.update(2.0, 1.5, 0.0) is Verdict.USED


def feed(ekf: PoseEkf, poses: list[tuple[float, float, float]]) -> list[Verdict]:
    verdicts = []
    for pose in poses:
        ekf.predict(DT_S, (0.0, 0.0, 0.0))
        verdicts.append(ekf.update(*pose))
    return verdicts


def test_a_jump_that_lasts_is_believed_after_five() -> None:
    ekf = settled()
    verdicts = feed(ekf, [(2.3, 1.4, 0.5)] * 6)
    assert verdicts == [Verdict.REFUSED] * 4 + [Verdict.JUMPED, Verdict.USED]
    assert ekf.state[:3] == pytest.approx((2.3, 1.4, 0.5), abs=1e-3)


def test_outliers_that_jump_about_are_never_believed() -> None:
    ekf = settled()
    rng = np.random.default_rng(3)
    poses = [(float(x), float(y), 0.0) for x, y in rng.uniform(0.3, 3.4, (30, 2))]
    assert set(feed(ekf, poses)) == {Verdict.REFUSED}


def test_a_sudden_stop_at_the_wall_is_followed() -> None:
    # 0.3 m/s along x, then at once zero: innovations grow by 10 mm a frame, the filter must not run on.
    ekf = PoseEkf(MODEL, EkfTuning(), 1.0, 1.5, 0.0)
    drag = MODEL.surge.drag(0.3)
    for k in range(1, 90):
        ekf.predict(DT_S, (drag, 0.0, 0.0))
        ekf.update(1.0 + 0.3 * k * DT_S, 1.5, 0.0)
    wall = 1.0 + 0.3 * 89 * DT_S
    for _ in range(30):
        ekf.predict(DT_S, (0.0, 0.0, 0.0))
        ekf.update(wall, 1.5, 0.0)
    assert ekf.state[0] == pytest.approx(wall, abs=2e-3)
    assert ekf.state[3] == pytest.approx(0.0, abs=0.02)


def test_uncertainty_grows_without_measurements_and_shrinks_with() -> None:
    ekf = settled()
    before = ekf.covariance.diagonal().copy()
    for _ in range(15):
        ekf.predict(DT_S, (0.0, 0.0, 0.0))
    grown = ekf.covariance.diagonal().copy()
    assert (grown > before).all()
    ekf.update(2.0, 1.5, 0.0)
    assert (ekf.covariance.diagonal() < grown).all()


def test_noisier_measurements_weigh_less() -> None:
    sharp, blunt = (PoseEkf(MODEL, replace(EkfTuning(), position_m=noise), 2.0, 1.5, 0.0) for noise in (0.0005, 0.005))
    for ekf in (sharp, blunt):
        ekf.covariance = settled().covariance
        ekf.update(2.001, 1.5, 0.0)
    assert sharp.state[0] > blunt.state[0] > 2.0
