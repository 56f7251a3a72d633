from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from marine.estimation.smoothing import CausalVelocities, body_velocities, polynomial_weights, savgol, savgol_weights
from marine.frames import wrap_angle


@pytest.mark.parametrize(("window", "order"), [(5, 2), (9, 2), (15, 3), (31, 4)])
@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("causal", [True, False])
def test_weights_are_those_of_scipy(window: int, order: int, derivative: int, causal: bool) -> None:
    at = window - 1 if causal else window // 2
    ours = savgol_weights(window, order, derivative, 0.1, None if causal else at)
    theirs = signal.savgol_coeffs(window, order, deriv=derivative, delta=0.1, pos=at, use="dot")
    np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9 * np.abs(theirs).max())


def test_whole_filter_is_that_of_scipy_ends_included() -> None:
    samples = np.random.default_rng(1).normal(size=60).cumsum()
    for derivative in (0, 1):
        theirs = signal.savgol_filter(samples, 11, 3, deriv=derivative, delta=0.1, mode="interp")
        np.testing.assert_allclose(savgol(samples, 11, 3, derivative, 0.1), theirs, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(("window", "order", "derivative"), [(3, 3, 0), (5, 2, 3), (5, -1, 0)])
def test_impossible_fits_are_refused(window: int, order: int, derivative: int) -> None:
    with pytest.raises(ValueError, match="do not fit"):
        savgol_weights(window, order, derivative, 0.1)


def test_samples_at_one_time_are_refused() -> None:
    with pytest.raises(ValueError, match="no distance"):
        polynomial_weights(np.zeros(5), 2)


@pytest.mark.parametrize("window", [4, 61])
def test_even_and_too_long_windows_are_refused(window: int) -> None:
    with pytest.raises(ValueError, match="odd and not longer"):
        savgol(np.zeros(60), window, 2, 0, 0.1)


def test_body_velocities_of_a_vessel_on_a_circle() -> None:
    # Radius 1 m, 0.2 rad/s clockwise, bow along the path, several turns through +-pi: u = 0.2, v = 0, r = 0.2.
    t = np.arange(0.0, 80.0, 0.1)
    psi = np.array([wrap_angle(a) for a in 0.2 * t + 1.0])
    poses = np.stack([2.0 + np.sin(psi), 2.0 - np.cos(psi), psi])
    u, v, r = body_velocities(poses, window=11, order=4, step_s=0.1)
    np.testing.assert_allclose(u, 0.2, atol=1e-5)
    np.testing.assert_allclose(v, 0.0, atol=1e-5)
    np.testing.assert_allclose(r, 0.2, atol=1e-9)


def test_causal_velocities_are_exact_for_parabolas_at_uneven_times() -> None:
    rng = np.random.default_rng(2)
    times = 1.7e9 + np.cumsum(rng.uniform(0.02, 0.05, 40))
    filter_ = CausalVelocities(window=9, order=2)
    for t in times:
        s = t - times[0]
        u, v, r = filter_.add(t, 1.0 + 0.1 * s + 0.2 * s * s, 2.0 - 0.3 * s, wrap_angle(3.0 + 0.5 * s))
    psi = 3.0 + 0.5 * s
    x_rate, y_rate = 0.1 + 0.4 * s, -0.3
    assert u == pytest.approx(math.cos(psi) * x_rate + math.sin(psi) * y_rate, abs=1e-5)
    assert v == pytest.approx(-math.sin(psi) * x_rate + math.cos(psi) * y_rate, abs=1e-5)
    assert r == pytest.approx(0.5, abs=1e-5)


def test_causal_velocities_wait_for_enough_poses_and_refuse_the_past() -> None:
    filter_ = CausalVelocities(window=5, order=2)
    assert filter_.add(1.0, 1.0, 1.0, 0.0) == (0.0, 0.0, 0.0)
    assert filter_.add(1.1, 2.0, 1.0, 0.0) == (0.0, 0.0, 0.0)
    assert filter_.add(1.2, 3.0, 1.0, 0.0)[0] == pytest.approx(10.0)
    with pytest.raises(ValueError, match="not later"):
        filter_.add(1.2, 3.0, 1.0, 0.0)
    filter_.clear()
    assert filter_.add(0.5, 1.0, 1.0, 0.0) == (0.0, 0.0, 0.0)
