"""The nonlinear passive observer beside the EKF."""

import math
import random

import pytest

from marine.dynamics.uncoupled import UncoupledModel
from marine.estimation.ekf import EkfTuning, PoseEkf
from marine.estimation.observer import PassiveObserver
from marine.frames import wrap_angle
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
DT = 1.0 / 30.0
PUSHED = (0.15, -0.1, 0.01)


def errors(observer: PassiveObserver | PoseEkf, noise_m: float, noise_rad: float) -> list[tuple[float, ...]]:
    """Return errors of [x y psi u v r] over 40 s of a vessel that circles and passes pi, measured at 30 Hz."""
    water, rng = UncoupledModel(PLADYPOS.model), random.Random(3)
    state, out = (2.0, 1.5, 2.0, 0.0, 0.0, 0.0), []
    for k in range(1200):
        tau = (0.8, 0.2 * math.sin(0.02 * k), 0.08)
        x, y, psi, u, v, r = water.step(state, DT, tau, disturbance=PUSHED)
        state = (x, y, wrap_angle(psi), u, v, r)
        observer.predict(DT, tau)
        noisy = (rng.gauss(x, noise_m), rng.gauss(y, noise_m), wrap_angle(rng.gauss(psi, noise_rad)))
        observer.update(*noisy)
        got = observer.state
        out.append(
            (
                got[0] - x,
                got[1] - y,
                wrap_angle(got[2] - psi),
                *(a - b for a, b in zip(got[3:], state[3:], strict=True)),
            )
        )
    return out


@pytest.mark.parametrize("w0", [1.0, 3.0])
def test_converges_with_the_disturbance_whatever_the_heading(w0: float) -> None:
    observer = PassiveObserver(PLADYPOS.model, w0, 2.1, 1.4, 2.1)
    track = errors(observer, 0.0, 0.0)
    assert max(map(abs, track[0])) > 0.05
    assert max(max(map(abs, e)) for e in track[600:]) < 2e-3
    assert observer.disturbance == pytest.approx(PUSHED, abs=5e-3)


def test_noise_costs_little_beside_the_ekf() -> None:
    t = EkfTuning()
    passive = PassiveObserver(PLADYPOS.model, 2.0, 2.0, 1.5, 2.0)
    ekf = PoseEkf(PLADYPOS.model, t, 2.0, 1.5, 2.0)
    rms = [
        [math.sqrt(sum(e[i] ** 2 for e in track[300:]) / len(track[300:])) for i in range(6)]
        for track in (errors(o, t.position_m, t.heading_rad) for o in (passive, ekf))
    ]
    assert all(p < 3.0 * k for p, k in zip(*rms, strict=True))
    assert rms[0][0] < t.position_m


def test_the_error_decays_as_the_model_function_says() -> None:
    """With a vessel that hardly moves the error of x follows s^3 + (a2 s^2 + a1 s + 1)/a3, w0 setting the time."""
    halves = []
    for w0 in (0.5, 1.0):
        observer = PassiveObserver(PLADYPOS.model, w0, 1.0, 1.0, 0.4)
        times = []
        for k in range(600):
            observer.predict(DT, (0.0, 0.0, 0.0))
            observer.update(1.01, 1.0, 0.4)
            if abs(observer.state[0] - 1.01) > 0.005:
                times.append(k)
        halves.append(times[-1] + 1)
    assert halves[0] == pytest.approx(2 * halves[1], rel=0.1)


def test_a_long_gap_does_not_upset_it() -> None:
    observer = PassiveObserver(PLADYPOS.model, 3.0, 1.0, 1.0, 0.0)
    for _ in range(60):
        observer.predict(DT, (0.5, 0.0, 0.0))
    x = observer.state[0]
    observer.update(x + 0.1, 1.0, 0.0)
    assert x < observer.state[0] <= x + 0.1
    assert abs(observer.state[3]) < 1.0
