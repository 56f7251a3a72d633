"""Algorithm 8.5 on the star: surge identified by the laser's distance, the vessel facing the wall meanwhile."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import ExperimentPlan, ExperimentResult
from services.experiment import ExperimentConfig, Experiments
from services.identified_vessel import write_models
from services.vessels import load_vessel, vessel_path
from tests.loop.test_distance_mode import LaserStar, true_m


def star_of(folder: Path, **plans: Any) -> LaserStar:
    star = LaserStar(folder, distance_m=0.5, psi_rad=math.pi, **plans)
    deployment = Deployment(run_dir=folder, recordings_dir=folder, vessel_path=None)
    config = ExperimentConfig(save=False, instruments=True, delay_s=0.0)  # loop:// has no radio
    star.bus.add(Experiments(config, star.vessel, deployment))
    star.until(lambda wall: wall.status == "tracking")
    return star


def run(star: LaserStar, **plan: Any) -> ExperimentResult:
    answer = star.request("experiment", experiment=ExperimentPlan(duration_s=300.0, **plan))
    assert answer.accepted, answer.reason

    def ended() -> bool:
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

    star.bus.run_until(ended, 310.0)
    status, result = star.bus.last(topics.EXPERIMENT_STATUS), star.bus.last(topics.EXPERIMENT_RESULT)
    assert status is not None
    assert status.state == "done", status.reason
    assert result is not None
    return result


def by_laser(star: LaserStar, turns: int) -> ExperimentResult:
    return run(star, name="zigzag", axis="surge", sensor="laser", amplitude=0.09, hysteresis_m=0.05, oscillations=turns)


def test_surge_is_identified_by_the_distance_while_the_vessel_faces_the_wall(tmp_path: Path) -> None:
    star = star_of(tmp_path)
    began_s = star.bus.now_s
    result = by_laser(star, 5)
    faced = [t for t in star.truth if began_s + 5.0 < t.stamp_ns * 1e-9 < result.ended_ns * 1e-9]
    assert max(abs(math.remainder(t.psi_rad - math.pi, math.tau)) for t in faced) < math.radians(12.0)
    assert max(map(true_m, faced)) < 1.0
    steps = np.diff(result.t_s)
    assert steps == pytest.approx(0.5, abs=0.11), "the laser's samples"
    found = {p.name: p.value for p in result.methods[0].parameters}
    surge = star.vessel.model.surge
    assert found["alpha"] == pytest.approx(surge.alpha, rel=0.2)
    assert found["beta_quadratic"] == pytest.approx(surge.beta_quadratic, rel=0.35)


def test_what_a_laser_cannot_measure_is_refused(tmp_path: Path) -> None:
    star = star_of(tmp_path)
    plan = ExperimentPlan(name="zigzag", axis="yaw", sensor="laser")
    assert star.request("experiment", experiment=plan).reason == "a laser module measures surge, not yaw"


@pytest.mark.soak
def test_algorithm_8_5_on_the_star(tmp_path: Path) -> None:
    """I: yaw by the compass. II, III: surge by the laser. IV, V: filter and controllers for these models keep 0.5 m."""
    # The detector of failed actuators diverges where poses are 0.5 s apart and VideoRay turns fast
    undisturbed = star_of(tmp_path, estimator={"fault_detection": False})
    yaw = run(undisturbed, name="self-oscillation", axis="yaw", amplitude=0.4, hysteresis_rad=math.radians(20.0))
    surge = by_laser(star_of(tmp_path), 12)
    models: dict[str, dict[str, tuple[float, float]]] = {
        result.plan.axis: {
            p.name: (p.value, 0.0) for p in result.methods[0].parameters if p.name in ("alpha", "beta_quadratic")
        }
        for result in (yaw, surge)
    }
    true = load_vessel("videoray")
    for axis, dof in (("yaw", true.model.yaw), ("surge", true.model.surge)):
        assert models[axis]["alpha"][0] == pytest.approx(dof.alpha, rel=0.15)
        assert models[axis]["beta_quadratic"][0] == pytest.approx(dof.beta_quadratic, rel=0.2)
    file = tmp_path / "videoray.toml"
    write_models(vessel_path("videoray"), file, models, "Algorithm 8.5")
    star = star_of(tmp_path, vessel=str(file), unknown={"model": true.model, "dynamics": true.dynamics})
    assert star.vessel.model.surge.alpha == pytest.approx(models["surge"]["alpha"][0])
    assert star.request("distance", distance_m=0.5).accepted
    star.bus.run_for(40.0)
    star.fault("laser_lost")
    star.bus.run_for(5.0)
    star.fault("laser_lost", active=False)
    star.bus.run_for(5.0)
    off = [abs(true_m(t) - 0.5) for t in star.truth if t.stamp_ns * 1e-9 > star.bus.now_s - 20.0]
    assert max(off) < 0.075, "one absence in twelve costs more than 5 cm: docs/distance-keeping.md"
