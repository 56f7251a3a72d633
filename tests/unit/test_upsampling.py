"""Kalman up-sampling of Charlie's compass, thesis 3.3: 0.5 s to 10 Hz."""

from __future__ import annotations

import math

import numpy as np
import pytest

from marine.estimation.upsampling import Upsampler, UpsamplingTuning
from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom
from services.vessels import load_vessel

YAW = load_vessel("charlie").model.yaw
NOISE = math.radians(0.5)
TUNING = UpsamplingTuning(measurement=NOISE, force=2.0, disturbance=0.2)
PERIOD_S, SLOW = 0.1, 5


def zigzag(dof: DegreeOfFreedom, delta_nm: float, seed: int, psi_0: float = 0.0) -> tuple[list[float], ...]:
    """Return true heading and rate, their estimates, and the held measurement, after 20 s for settling."""
    rng = np.random.default_rng(seed)
    psi, r, moment, held = psi_0, 0.0, 17.0, psi_0
    filter_ = Upsampler(dof, TUNING, PERIOD_S, psi_0)
    columns: tuple[list[float], ...] = ([], [], [], [], [], [])
    for k in range(1200):
        if k % 100 == 0:
            moment = -moment
        for _ in range(10):  # truth in small steps
            r += 0.01 / dof.alpha * (moment + delta_nm - dof.drag(r))
            psi += 0.01 * r
        measured = wrap_angle(psi + NOISE * rng.standard_normal()) if k % SLOW == SLOW - 1 else None
        held = held if measured is None else measured
        eta, nu = filter_.step(moment, measured)
        if k >= 200:
            for column, value in zip(columns, (psi, r, eta, nu, held, filter_.state[2]), strict=True):
                column.append(float(value))
    return columns


def rms_angle(a: list[float], b: list[float]) -> float:
    return math.sqrt(float(np.mean([wrap_angle(x - y) ** 2 for x, y in zip(a, b, strict=True)])))


@pytest.mark.parametrize(
    "dof", [YAW, DegreeOfFreedom(YAW.alpha, 0.0, 800.0)], ids=["constant drag of Table 7.12", "linear drag"]
)
@pytest.mark.parametrize("psi_0", [0.0, 3.1])  # across +-180 degrees
def test_the_estimate_at_10_hz_is_far_better_than_the_held_measurement(dof: DegreeOfFreedom, psi_0: float) -> None:
    psi, r, eta, nu, held, delta = zigzag(dof, 4.0, seed=1, psi_0=psi_0)
    assert rms_angle(eta, psi) < 0.6 * NOISE
    assert rms_angle(eta, psi) < 0.2 * rms_angle(held, psi)
    rate_error = np.array(nu) - np.array(r)
    assert np.sqrt(np.mean(rate_error**2)) < 0.05 * np.std(r)
    assert np.mean(delta) == pytest.approx(4.0, rel=0.15)  # tau_NE of (3.6)


def test_its_covariance_is_true() -> None:
    # Chi-square of the heading's error at the ends of 60 runs: mean 1 +- 3 sqrt(2 / 60).
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        filter_ = Upsampler(YAW, TUNING, PERIOD_S, NOISE * rng.standard_normal())
        psi, r, disturbance = 0.0, 0.0, 0.0
        for k in range(150):
            disturbance += TUNING.disturbance * math.sqrt(PERIOD_S) * rng.standard_normal()
            kick = TUNING.force / math.sqrt(PERIOD_S) * rng.standard_normal()
            for _ in range(4):
                r += PERIOD_S / 4 / YAW.alpha * (5.0 + disturbance + kick - YAW.drag(r))
                psi += PERIOD_S / 4 * r
            filter_.step(5.0, wrap_angle(psi + NOISE * rng.standard_normal()) if k % SLOW == SLOW - 1 else None)
        P = filter_.covariance
        assert np.linalg.eigvalsh(P).min() > 0.0
        errors.append(wrap_angle(float(filter_.state[0]) - psi) ** 2 / P[0, 0])
    assert 0.45 < np.mean(errors) < 1.55
