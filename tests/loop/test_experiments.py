"""Experiments through the whole loop on MemoryBus: the axis pushed, the others held, the model that comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.campaigns.star import MemoryPilot
from bus import topics
from bus.config import Deployment
from bus.messages import ExperimentPlan, ExperimentResult, ExperimentStatus
from marine.allocation import axis_limits
from services.campaign import CampaignFile, Place, Results, drive, summary
from services.experiment import ExperimentConfig, Experiments
from services.vessels import VESSELS_DIR, load_vessel
from tests import star as harness

MODEL = load_vessel("pladypos").model
POLL_S = 1.0 / 60.0
"""loop:// wakes nobody: the simulated platform sees a command at the simulator's next step."""
CALM = {"current_x_m_s": 0.0, "current_std_m_s": 0.0}


def experiments(star: harness.Star, folder: Path, delay_s: float = POLL_S) -> Experiments:
    deployment = Deployment(
        run_dir=Path("/nonexistent"), recordings_dir=folder, vessel_path=VESSELS_DIR / "pladypos.toml"
    )
    return Experiments(ExperimentConfig(delay_s=delay_s), star.vessel, deployment)


def star_with_experiments(
    folder: Path, seed: int = 1, moment: float = 0.0, delay_s: float = POLL_S, simulator: dict[str, Any] | None = None
) -> harness.Star:
    """Return a star on calm water that tracks, with a constant yaw moment as a part of the largest."""
    star = harness.Star(
        simulator={"seed": seed, **CALM, **(simulator or {})},
        camera_tracker={"seed": seed},
        unknown={"bias": (0.0, 0.0, 0.0, 0.0, 0.0, moment * axis_limits(load_vessel("pladypos"))[5])},
    )
    star.bus.add(experiments(star, folder, delay_s))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 5.0
    )
    return star


def run(star: harness.Star, **plan: Any) -> tuple[ExperimentStatus, ExperimentResult | None]:
    """Run an experiment to its end; return its last status and its result."""
    return MemoryPilot(star).run(ExperimentPlan(**plan))


def error(result: ExperimentResult, axis: str, method: int = 0) -> tuple[float, float]:
    """Return the relative errors of inertia and quadratic drag of one of the methods."""
    found = {p.name: p.value for p in result.methods[method].parameters}
    dof = getattr(MODEL, axis)
    return found["alpha"] / dof.alpha - 1.0, found["beta_quadratic"] / dof.beta_quadratic - 1.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_self_oscillation_of_yaw_against_a_constant_moment(tmp_path: Path, seed: int) -> None:
    star = star_with_experiments(tmp_path, seed, moment=0.05)  # 10 % of C
    status, result = run(star, name="self-oscillation", axis="yaw", amplitude=0.5)
    assert status.state == "done", status
    assert result is not None
    alpha, beta = error(result, "yaw")
    assert abs(alpha) < 0.04
    assert abs(beta) < 0.05
    assert status.elapsed_s <= 90.0


def test_without_the_known_delay_drag_is_off_and_the_thesis_formulas_are_worse(tmp_path: Path) -> None:
    """What makes the numbers above good is no echo of the model: take it away and they miss."""
    star = star_with_experiments(tmp_path, moment=0.05, delay_s=0.0)
    _, result = run(star, name="self-oscillation", axis="yaw", amplitude=0.5)
    assert result is not None
    assert -0.06 < error(result, "yaw")[1] < -0.02
    assert error(result, "yaw", 1)[1] > 0.05  # Table 6.3 replaces the wave by a sine


@pytest.mark.parametrize("direction", [1, -1])
def test_surge_step_from_wall_to_wall_with_the_other_axes_held(tmp_path: Path, direction: int) -> None:
    star = star_with_experiments(tmp_path, simulator={"x_m": 0.5 if direction > 0 else 4.5})
    status, result = run(star, name="step", axis="surge", amplitude=0.6, direction=direction)
    assert status.state == "done", status
    assert result is not None
    alpha, beta = error(result, "surge")
    assert abs(alpha) < 0.02
    assert abs(beta) < 0.01
    assert "before the wall" in result.methods[0].warnings[-1]
    assert max(abs(t.y_m - star.truth[0].y_m) for t in star.truth) < 0.03
    assert max(abs(t.psi_rad) for t in star.truth) < 0.05
    star.bus.run_for(15.0)  # hold: it has braked before the wall, and stays
    assert all(0.3 < t.x_m < 4.7 for t in star.truth)
    helm = star.bus.last(topics.HELM_STATE)
    assert helm is not None
    assert helm.mode == "hold"
    assert abs(star.truth[-1].surge_m_s) < 0.01


def test_the_model_is_saved_as_a_vessel_file_that_loads(tmp_path: Path) -> None:
    star = star_with_experiments(tmp_path)
    _, result = run(star, name="self-oscillation", axis="yaw", amplitude=0.6, oscillations=2)
    assert result is not None
    saved = load_vessel(result.vessel_file)
    found = {p.name: p.value for p in result.methods[0].parameters}
    assert saved.model.yaw.alpha == pytest.approx(found["alpha"], rel=1e-6)
    assert saved.model.yaw.beta_quadratic == pytest.approx(found["beta_quadratic"], rel=1e-6)
    assert saved.model.surge == MODEL.surge
    assert Path(result.vessel_file).parent == tmp_path / "identified"


@pytest.mark.parametrize(("name", "amplitude"), [("zigzag", 0.5), ("pull-out", 0.5), ("prbs", 0.4)])
def test_other_experiments_on_yaw(tmp_path: Path, name: str, amplitude: float) -> None:
    star = star_with_experiments(tmp_path)
    status, result = run(star, name=name, axis="yaw", amplitude=amplitude, oscillations=3, duration_s=100.0)
    assert status.state == "done", status
    assert result is not None
    alpha, beta = error(result, "yaw")
    assert abs(alpha) < 0.04
    assert abs(beta) < 0.05


def begin(star: harness.Star, **plan: Any) -> str:
    answer = star.request("experiment", experiment=ExperimentPlan(**plan))
    assert answer.accepted, answer.reason
    star.bus.run_for(4.0)
    status = star.bus.last(topics.EXPERIMENT_STATUS)
    assert status is not None
    assert status.state == "running"
    return answer.request_id


def ending(star: harness.Star) -> str:
    status = star.bus.last(topics.EXPERIMENT_STATUS)
    assert status is not None
    assert status.state == "failed"
    assert star.bus.last(topics.EXPERIMENT_RESULT) is None
    return status.reason


def test_stop_ends_it_at_once(tmp_path: Path) -> None:
    star = star_with_experiments(tmp_path)
    begin(star, name="self-oscillation", axis="yaw")
    star.request("stop")
    star.bus.run_for(0.3)
    assert "stopped by test" in ending(star)
    assert set(star.truth[-1].commands.values()) == {0.0}


def test_a_lost_pose_ends_it(tmp_path: Path) -> None:
    star = star_with_experiments(tmp_path)
    begin(star, name="self-oscillation", axis="yaw")
    star.fault("camera_black")
    star.bus.run_for(3.0)
    assert "lost" in ending(star)
    assert set(star.truth[-1].commands.values()) == {0.0}


def test_a_silent_experiment_suspends_and_one_that_starts_again_gives_up(tmp_path: Path) -> None:
    star = star_with_experiments(tmp_path)
    begin(star, name="self-oscillation", axis="yaw")
    star.bus.kill("experiment")
    star.bus.run_for(1.0)
    helm = star.bus.last(topics.HELM_STATE)
    assert helm is not None
    assert (helm.suspended, helm.reason) == (True, "no wrench from the experiment")
    assert set(star.truth[-1].commands.values()) == {0.0}
    star.bus.add(experiments(star, tmp_path))
    star.bus.run_for(1.0)
    assert "started again" in ending(star)
    helm = star.bus.last(topics.HELM_STATE)
    assert helm is not None
    assert helm.mode == "hold"


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        ({"name": "step", "axis": "sway"}, "free way"),
        (
            {"name": "self-oscillation", "axis": "surge", "amplitude": 1.0, "hysteresis_m": 1.7, "duration_s": 900.0},
            "wall",
        ),
        ({"name": "self-oscillation", "axis": "yaw", "amplitude": 0.05, "duration_s": 30.0}, "oscillations would take"),
    ],
)
def test_what_cannot_work_is_refused_with_advice_before_anything_moves(
    tmp_path: Path, plan: dict[str, Any], reason: str
) -> None:
    star = star_with_experiments(tmp_path, simulator={"y_m": 2.8})
    star.request("experiment", experiment=ExperimentPlan(**plan))
    star.bus.run_for(0.5)
    assert reason in ending(star)


def test_heave_is_refused_by_a_vessel_that_does_not_dive(tmp_path: Path) -> None:
    star = star_with_experiments(tmp_path)
    answer = star.request("experiment", experiment=ExperimentPlan(name="prbs", axis="heave"))
    assert not answer.accepted
    assert "no actuators for heave" in answer.reason


def test_the_axis_is_given_back_without_a_jump(tmp_path: Path) -> None:
    """A current pushes: what the controller held on the other axes stays, and it holds again afterwards."""
    star = star_with_experiments(tmp_path, simulator={"current_x_m_s": 0.05})
    star.hold(2.5, 1.9)
    star.bus.run_for(20.0)
    since_s = star.bus.now_s
    status, _ = run(star, name="self-oscillation", axis="yaw", amplitude=0.4, oscillations=2)
    assert status.state == "done", status
    away = [((t.x_m - 2.5) ** 2 + (t.y_m - 1.9) ** 2) ** 0.5 for t in star.truth if t.stamp_ns * 1e-9 > since_s]
    assert max(away) < 0.08
    star.bus.run_for(20.0)
    helm = star.bus.last(topics.HELM_STATE)
    assert helm is not None
    assert helm.x_m is not None
    assert helm.y_m is not None
    assert helm.psi_rad is not None
    distance_m, angle_rad = star.rms_error(helm.x_m, helm.y_m, helm.psi_rad, star.bus.now_s - 5.0)
    assert distance_m < 0.01
    assert angle_rad < 0.02


def test_a_campaign_goes_on_after_a_break_and_tells_mean_and_deviation(tmp_path: Path) -> None:
    campaign = CampaignFile(
        name="step",
        axis="surge",
        amplitudes=(0.3, 0.8),
        repeats=1,
        start=Place(x_m=0.5, y_m=1.9),
        start_back=Place(x_m=4.5, y_m=1.9),
    )
    results = Results(tmp_path / "surge.results.jsonl")
    pilot = MemoryPilot(star_with_experiments(tmp_path))
    told: list[str] = []
    assert drive(campaign.model_copy(update={"amplitudes": (0.3,)}), results, pilot, told.append) == 0
    with results.path.open("a") as file:
        file.write('{"run": "0.8 +1 1", "result": {"half')  # killed while it wrote
    assert drive(campaign, results, pilot, told.append) == 0
    assert pilot.runs == 4
    assert told[2:4] == ["1 of 4, 0.3 +1 1: made before", "2 of 4, 0.3 -1 1: made before"]
    another = campaign.model_copy(update={"axis": "sway"})
    assert not results.of(another), "runs by another plan are not its own"
    rows = {(r["method"], r["parameter"]): r for r in summary(results.of(campaign)) if r["amplitude"] == 0.0}
    for parameter, true in (("alpha", MODEL.surge.alpha), ("beta_quadratic", MODEL.surge.beta_quadratic)):
        row = rows["response fit", parameter]
        assert row["runs"] == 4
        assert float(row["mean"]) == pytest.approx(true, rel=0.01)
        assert float(row["std"]) < 0.03 * true


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_self_oscillation_over_fifty_seeds(tmp_path: Path) -> None:
    """Inertia within 4 %, drag within 5 % at the 95th percentile, in 90 s at most."""
    errors, longest_s = [], 0.0
    for seed in range(50):
        star = star_with_experiments(tmp_path, seed, moment=0.05)
        status, result = run(star, name="self-oscillation", axis="yaw", amplitude=0.5)
        assert result is not None, status
        errors.append([abs(e) for e in error(result, "yaw")])
        longest_s = max(longest_s, status.elapsed_s)
    alpha, beta = np.quantile(errors, 0.95, axis=0)
    print(f"95th percentile: inertia {100 * alpha:.2f} %, drag {100 * beta:.2f} %, longest {longest_s:.0f} s")
    assert alpha < 0.04
    assert beta < 0.05
    assert longest_s <= 90.0
