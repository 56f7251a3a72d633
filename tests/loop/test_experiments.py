"""Experiments through the whole loop on MemoryBus: the axis pushed, the others held, the model that comes out."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import ExperimentPlan, ExperimentResult, ExperimentStatus
from services.experiment import ExperimentConfig, Experiments
from services.vessels import VESSELS_DIR, load_vessel
from tests import star as harness

MODEL = load_vessel("pladypos").model
POLL_S = 1.0 / 60.0
"""loop:// wakes nobody: the simulated platform sees a command at the simulator's next step."""
CALM = {"current_x_m_s": 0.0, "current_std_m_s": 0.0}


def star_with_experiments(folder: Path, seed: int = 1, moment: float = 0.0, **simulator: Any) -> harness.Star:
    """Return a star on calm water that tracks, with a constant yaw moment as a part of the largest."""
    star = harness.Star(simulator={"seed": seed, **CALM, **simulator}, camera_tracker={"seed": seed})
    if moment:
        limit = harness_limits()[5]
        star.vessel = dataclasses.replace(star.vessel, bias=(0.0, 0.0, 0.0, 0.0, 0.0, moment * limit))
        star.start("simulator")
        star.start("platform_link")
        star.vessel = load_vessel("pladypos")
    deployment = Deployment(
        run_dir=Path("/nonexistent"), recordings_dir=folder, vessel_path=VESSELS_DIR / "pladypos.toml"
    )
    star.bus.add(Experiments(ExperimentConfig(delay_s=POLL_S), star.vessel, deployment))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 5.0
    )
    return star


def harness_limits() -> tuple[float, ...]:
    from marine.allocation import axis_limits

    return axis_limits(load_vessel("pladypos"))


def run(star: harness.Star, timeout_s: float = 200.0, **plan: Any) -> tuple[ExperimentStatus, ExperimentResult | None]:
    """Run an experiment to its end; return its last status and its result."""
    answer = star.request("experiment", experiment=ExperimentPlan(**plan))
    assert answer.accepted, answer.reason
    before = star.bus.last(topics.EXPERIMENT_RESULT)

    def ended() -> bool:
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

    star.bus.run_until(ended, timeout_s)
    status = star.bus.last(topics.EXPERIMENT_STATUS)
    result = star.bus.last(topics.EXPERIMENT_RESULT)
    assert status is not None
    return status, result if result is not before else None


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
    print(
        status,
        [(m.method, [(p.name, p.value, p.std) for p in m.parameters], m.warnings, m.failure) for m in result.methods],
    )
    alpha, beta = error(result, "yaw")
    assert abs(alpha) < 0.04
    assert abs(beta) < 0.05
    assert status.elapsed_s <= 90.0
