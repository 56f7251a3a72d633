"""The filter's covariance is one, and it tells the truth about the errors."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from marine.dynamics.uncoupled import UncoupledModel
from marine.estimation.ekf import EkfTuning, PoseEkf, Verdict
from marine.frames import wrap_angle
from services.vessels import load_vessel

MODEL = load_vessel("pladypos").model
force = st.floats(-5.0, 5.0)


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(1e-4, 0.1), force, force, st.floats(-2.0, 2.0), st.booleans()), min_size=1, max_size=60
    ),
    st.floats(1e-5, 0.05),
    st.floats(1e-5, 0.2),
)
def test_covariance_stays_symmetric_and_positive(
    steps: list[tuple[float, float, float, float, bool]], position_m: float, heading_rad: float
) -> None:
    ekf = PoseEkf(MODEL, EkfTuning(position_m=position_m, heading_rad=heading_rad), 2.0, 1.5, 0.0)
    for dt_s, X, Y, N, measured in steps:
        ekf.predict(dt_s, (X, Y, N))
        if measured:
            ekf.update(*ekf.state[:3])
        P = ekf.covariance
        np.testing.assert_allclose(P, P.T, rtol=1e-12, atol=1e-18)
        scale = 1.0 / np.sqrt(P.diagonal())
        assert np.linalg.eigvalsh(P * np.outer(scale, scale)).min() > 0.0
        assert np.isfinite([*ekf.state, *ekf.disturbance]).all()
        assert -np.pi < ekf.state[2] <= np.pi


def nees_after(seconds: float, seed: int, dt_s: float = 1 / 30) -> float:
    """Return the squared Mahalanobis distance of the error where the truth obeys the filter's own assumptions."""
    tuning, rng, dynamics = EkfTuning(gate=100.0), np.random.default_rng(seed), UncoupledModel(MODEL)
    noise = np.array([tuning.position_m, tuning.position_m, tuning.heading_rad])
    pose = np.array([2.0, 1.5, rng.uniform(-3.1, 3.1)])
    ekf = PoseEkf(MODEL, tuning, *(pose + noise * rng.normal(size=3)).tolist())
    start = np.sqrt(ekf.covariance.diagonal())
    nu, push = rng.normal(size=3) * start[3:6], rng.normal(size=3) * start[6:]
    walk = np.array([tuning.velocity_walk_m_s] * 2 + [tuning.yaw_rate_walk_rad_s]) * np.sqrt(dt_s)
    push_walk = np.array([tuning.force_walk_n] * 2 + [tuning.moment_walk_nm]) * np.sqrt(dt_s)
    for k in range(round(seconds / dt_s)):
        tau = (np.sin(0.05 * k), np.cos(0.03 * k), 0.2 * np.sin(0.02 * k))
        *pose_, u, v, r = dynamics.step((*pose, *nu), dt_s, tau, disturbance=tuple(push))
        pose, nu = np.array(pose_), np.array([u, v, r]) + walk * rng.normal(size=3)
        push = push + push_walk * rng.normal(size=3)
        ekf.predict(dt_s, tau)
        assert ekf.update(*(pose + noise * rng.normal(size=3)).tolist()) is Verdict.USED
    error = np.array([*pose, *nu, *push]) - np.array([*ekf.state, *ekf.disturbance])
    error[2] = wrap_angle(error[2])
    return float(error @ np.linalg.solve(ekf.covariance, error))


def test_errors_are_as_large_as_the_filter_says() -> None:
    # 60 independent runs: their sum is chi-square with 9 x 60 degrees of freedom, were the model linear.
    runs = 60
    mean = sum(nees_after(2.0, seed) for seed in range(runs)) / runs
    low, high = (float(stats.chi2.ppf(p, 9 * runs)) / runs for p in (0.0005, 0.9995))
    assert 0.95 * low < mean < 1.05 * high, mean
