"""State machines of experiments without a bus: guards, monitoring, advice; and how a record is put on its grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from marine.identification.experiments import (
    Experiment,
    Motion,
    SelfOscillation,
    Setup,
    Step,
    braking_distance,
    design,
)
from marine.identification.monitor import OscillationMonitor
from marine.identification.record import on_grid
from marine.identification.response_fit import fit
from marine.identification.result import IdentificationError
from marine.identification.validation import simulate
from marine.vessel import DegreeOfFreedom
from services.vessels import load_vessel

SURGE = load_vessel("pladypos").model.surge
YAW = load_vessel("pladypos").model.yaw


def play(machine: Experiment, dof: DegreeOfFreedom, delta: float = 0.0, wall_m: float = math.inf) -> list[Motion]:
    """Let a vessel with the equation of (2.33) answer the machine, at 30 Hz; return what it did."""
    dt, nu, eta, t = 1.0 / 30.0, 0.0, 0.0, 100.0
    done: list[Motion] = []
    while True:
        m = Motion(t, eta, nu, wall_m - eta, wall_m + eta)
        done.append(m)
        force = machine.step(m)
        if force is None:
            return done
        after = float(simulate(dof, np.array([0.0, dt]), np.array([force, force]), nu_0=nu, delta=delta)[1])
        eta, nu, t = eta + 0.5 * dt * (nu + after), after, t + dt


def test_braking_distance_from_full_speed_is_the_issues_0_47_m() -> None:
    full_n = SURGE.beta_quadratic * 0.36**2
    assert braking_distance(SURGE, 0.36, full_n) == pytest.approx(0.47, abs=0.01)
    assert braking_distance(DegreeOfFreedom(2.0, 1.0, 0.0), 1.0, 4.0) == pytest.approx(0.25)


def test_a_step_brakes_before_the_wall() -> None:
    limit = SURGE.beta_quadratic * 0.36**2
    machine = Step(Setup(limit, 1, 0.1, 5, 60.0, limit, SURGE))
    motions = play(machine, SURGE, wall_m=3.0)
    assert max(m.eta for m in motions) < 3.0
    assert abs(motions[-1].nu) < 0.02
    assert "wall" in machine.note
    assert not machine.failure


def test_a_step_on_yaw_ends_when_it_has_settled() -> None:
    machine = Step(Setup(0.5, -1, 0.1, 5, 60.0, 1.0, YAW))
    motions = play(machine, YAW)
    assert machine.ended_s is not None
    end = next(m for m in motions if m.t_s >= machine.ended_s)
    assert abs(end.nu) == pytest.approx(math.sqrt(0.5 / YAW.beta_quadratic), rel=1e-3)
    assert not machine.note


def test_a_self_oscillation_ends_with_the_oscillations_that_agree() -> None:
    machine = SelfOscillation(Setup(0.5, 1, 0.35, 5, 120.0, 1.0, YAW))
    play(machine, YAW, delta=0.05)
    assert not machine.failure
    assert machine.monitor.consecutive == 5
    assert machine.monitor.spread is not None
    assert machine.monitor.spread < 0.1
    assert machine.monitor.swings[-1].x_0 > 0.0  # the disturbance biases it: (5.34)
    assert machine.ended_s is not None
    used_s = machine.ended_s - machine.used_from_s
    assert used_s == pytest.approx(5.25 * machine.monitor.swings[-1].period_s, rel=0.1)


def test_too_weak_a_relay_fails_with_advice() -> None:
    machine = SelfOscillation(Setup(0.02, 1, 0.35, 5, 60.0, 1.0, YAW))
    play(machine, YAW, delta=-0.03)  # the disturbance is stronger than the relay: it is never reversed
    assert "choose a larger amplitude" in machine.failure


def test_the_monitor_starts_again_when_an_oscillation_is_broken() -> None:
    monitor = OscillationMonitor(x_a=0.3, count=3)
    t = 0.0

    def swing(top: float, bottom: float) -> None:
        nonlocal t
        for side, extreme in ((1, top), (-1, bottom)):
            monitor.follow(0.3 * side)
            monitor.switched(t, side)
            monitor.follow(extreme)
            monitor.follow(0.3 * side)
            t += 2.0

    for _ in range(4):
        swing(0.5, -0.5)
    assert (monitor.whole, monitor.consecutive, monitor.advice) == (3, 2, "")
    assert monitor.halves[-1] == pytest.approx(2.0)
    swing(0.9, -0.5)
    swing(0.5, -0.5)
    assert monitor.consecutive == 1
    assert "spread by" in monitor.advice
    swing(0.6, -0.32)  # x_a + |x_0| = 0.44 < 0.46
    swing(0.6, -0.30)  # 0.45 is not below 0.45: (7.12)
    swing(0.6, -0.30)
    assert "x_a + |x_0|" in monitor.advice
    assert monitor.consecutive == 0


def test_the_amplitude_of_a_plan_is_a_part_of_the_limit() -> None:
    machine = design("prbs", 0.25, 1, YAW, 2.0, angular=True)
    assert machine.setup.C == 0.5
    forces = {machine.step(Motion(t, 0.0, 0.0)) for t in np.arange(0.0, 20.0, 0.1).tolist()}
    assert forces == {-0.5, 0.5}


def test_a_record_takes_means_of_a_force_that_changes_between_samples() -> None:
    t = np.arange(0.0, 2.0, 0.1)
    tau_s = t - 0.05
    record = on_grid(t, t**2, tau_s, np.where(tau_s > 0.94, 3.0, 1.0), axis="linear", begin_s=0.0, end_s=2.0)
    assert record.tau[8] == pytest.approx(1.0)
    assert record.tau[9] == pytest.approx(2.0)  # half the cell 1, half 3
    assert record.tau[10] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: t[::-1], "backward"),
        (lambda t: np.where(t > 1.0, t + 0.8, t), "gap of"),
        (lambda t: t + 100.0, "too few"),
    ],
)
def test_a_record_with_holes_is_refused(change: object, reason: str) -> None:
    t = np.arange(0.0, 3.0, 0.1)
    with pytest.raises(IdentificationError, match=reason):
        on_grid(change(t), t, t, t, axis="linear", begin_s=0.0, end_s=4.0)  # type: ignore[operator]


def test_a_response_fit_finds_a_run_that_ends_early() -> None:
    t = np.arange(0.0, 9.0, 1.0 / 30.0)  # two thirds of the final speed
    tau = np.full_like(t, 1.5) + 0.2 * np.sin(3.0 * t)
    nu = simulate(SURGE, t, tau)
    eta = np.concatenate([[0.0], np.cumsum(0.5 * (nu[1:] + nu[:-1]) / 30.0)])
    found = fit(t, eta + np.random.default_rng(1).normal(0.0, 3e-4, t.size), tau)
    assert found["alpha"] == pytest.approx(SURGE.alpha, rel=0.01)
    assert found["beta_quadratic"] == pytest.approx(SURGE.beta_quadratic, rel=0.02)
    assert abs(found["alpha"] - SURGE.alpha) < 4.0 * found.parameter("alpha").std


def test_a_long_record_is_fitted_in_pieces_that_no_drift_spoils() -> None:
    """Ten minutes at 50 Hz, a walk of the heading added that one piece of ten minutes could not follow."""
    rng = np.random.default_rng(3)
    t = np.arange(30_000, dtype=float) * 0.02
    tau = np.where(np.arange(t.size) % 300 < 150, 0.5, -0.5)
    nu = simulate(YAW, t, tau, delta=0.05)
    eta = np.concatenate([[0.0], np.cumsum(0.01 * (nu[1:] + nu[:-1]))]) + np.cumsum(rng.normal(0.0, 5e-4, t.size))
    found = fit(t, eta, tau, axis="angular", disturbance=True)
    assert found.data.pieces == 50
    assert found["alpha"] == pytest.approx(YAW.alpha, rel=0.01)
    assert found["beta_quadratic"] == pytest.approx(YAW.beta_quadratic, rel=0.01)
    assert found["delta"] == pytest.approx(0.05, rel=0.05)
    with pytest.raises(IdentificationError, match="no response fits"):
        fit(t, eta, -tau, axis="angular", disturbance=True)
