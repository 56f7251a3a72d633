"""A vessel that only steers, tuned live: its heading loop from a self-oscillation under way (thesis 8.4, 7.5)."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import AxisModel, ExperimentPlan, HelmState, Tuning, TuningAnswer, TuningRequest, WayPoint
from marine.frames import wrap_angle
from marine.guidance.abilities import yaw_limit_at
from marine.vessel import SmallVesselModel
from services.experiment import ExperimentConfig, Experiments
from services.vessels import load_vessel
from tests.star import Star

CHARLIE = load_vessel("charlie")
SPEED_M_S = 0.67
HEAVIER = 3.0


def heavier() -> SmallVesselModel:
    """Charlie with more to turn than its file says."""
    assert isinstance(CHARLIE.dynamics, SmallVesselModel)
    yaw = tuple(replace(at, yaw=replace(at.yaw, alpha=HEAVIER * at.yaw.alpha)) for at in CHARLIE.dynamics.yaw)
    return replace(CHARLIE.dynamics, yaw=yaw)


def afloat(folder: Path, **sections: Any) -> Star:
    """Return a star whose Charlie is heavier than its file says, far from all walls ahead."""
    world = {"x_m": 10.0, "y_m": 60.0, "current_x_m_s": 0.0, "current_std_m_s": 0.0}
    deployment = Deployment(run_dir=folder, recordings_dir=folder)
    star = Star(vessel="charlie", deployment=deployment, unknown={"dynamics": heavier()}, simulator=world, **sections)
    star.bus.add(Experiments(ExperimentConfig(), star.vessel, deployment))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 20.0
    )
    return star


def helm(star: Star) -> HelmState:
    state = star.bus.last(topics.HELM_STATE)
    assert state is not None
    return state


def overshoot(star: Star, turn_rad: float) -> float:
    """Return by how much of a turn at speed the heading goes beyond it."""
    psi = helm(star).psi_rad if helm(star).mode == "speed" else star.truth[-1].psi_rad
    assert psi is not None
    answer = star.request("speed", speed_m_s=SPEED_M_S, psi_rad=wrap_angle(psi + turn_rad))
    assert answer.accepted, answer.reason
    begin = len(star.truth)
    star.bus.run_for(25.0)
    return max(wrap_angle(t.psi_rad - psi - turn_rad) / turn_rad for t in star.truth[begin:])


def engage(star: Star, tuning: Tuning) -> TuningAnswer:
    star.bus.publish(topics.OPERATOR_TUNING, TuningRequest(request_id="1", client="test", tuning=tuning))
    star.bus.run_until(lambda: star.bus.last(topics.CONTROL_ANSWER) is not None, 1.0)
    answer = star.bus.last(topics.CONTROL_ANSWER)
    assert answer is not None
    return answer


def test_an_unknown_boat_is_tuned_under_way_and_follows_a_line(tmp_path: Path) -> None:
    """Algorithm 8.4 with the rudder; the line's law (8.8) follows the new heading loop."""
    star = afloat(tmp_path, controller={"line": "indirect"})
    assert star.request("speed", speed_m_s=SPEED_M_S, psi_rad=0.0).accepted
    star.bus.run_for(15.0)
    before = overshoot(star, 0.5)
    answer = star.request(
        "experiment", experiment=ExperimentPlan(name="self-oscillation", axis="yaw", amplitude=0.7, oscillations=2)
    )
    assert answer.accepted, answer.reason
    assert helm(star).law == "speed"
    assert helm(star).speed_m_s == pytest.approx(SPEED_M_S, rel=0.01), "half of what it can"

    def ended() -> bool:
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

    star.bus.run_until(ended, 200.0)
    result = star.bus.last(topics.EXPERIMENT_RESULT)
    assert result is not None, star.bus.last(topics.EXPERIMENT_STATUS)
    found = {p.name: p.value for p in result.methods[0].parameters}
    speed_m_s = star.truth[-1].surge_m_s
    n_squared = CHARLIE.model.surge.drag(speed_m_s) / 2.0
    assert 14.0 < n_squared < 25.0
    true = HEAVIER * 11.09 * 2.0 * 1.2 * 0.46 * n_squared  # Table 7.12 for 16 V^2, as the two rudders' moment
    assert found["alpha"] == pytest.approx(true, rel=0.25)
    model = AxisModel(**{name: found.get(name, 0.0) for name in AxisModel.model_fields})
    assert engage(star, Tuning(law="heading", models={"yaw": model})).accepted
    assert star.request("speed", speed_m_s=SPEED_M_S, psi_rad=star.truth[-1].psi_rad).accepted
    star.bus.run_for(10.0)
    after = overshoot(star, -0.5)
    assert before > 0.1
    assert after < 0.5 * before
    x_m, y_m, psi = star.truth[-1].x_m, star.truth[-1].y_m, star.truth[-1].psi_rad
    ahead = WayPoint(x_m=x_m + 25.0 * math.cos(psi), y_m=y_m + 25.0 * math.sin(psi))
    line = star.request("line", points=(WayPoint(x_m=x_m, y_m=y_m), ahead), speed_m_s=SPEED_M_S)
    assert line.accepted, line.reason
    star.bus.run_for(25.0)
    status = star.bus.last(topics.CONTROL_STATUS)
    assert status is not None
    assert status.law == "indirect"
    assert status.cross_track_m == pytest.approx(0.0, abs=1.0), "its receiver has 0.5 m"


def test_what_is_refused(tmp_path: Path) -> None:
    star = afloat(tmp_path)
    plan = ExperimentPlan(name="self-oscillation", axis="yaw", speed_m_s=3.0)
    assert "more than charlie can do" in star.request("experiment", experiment=plan).reason
    sideways = ExperimentPlan(name="self-oscillation", axis="surge", speed_m_s=0.5)
    assert "not while surge is pushed" in star.request("experiment", experiment=sideways).reason
    assert "known: heading" in engage(star, Tuning(law="ipd")).reason


def test_what_is_left_to_turn_with_grows_with_the_thrust() -> None:
    limits = [yaw_limit_at(CHARLIE, u) for u in (0.0, 0.5, 1.0)]
    assert limits[0] < 0.05 * limits[2]
    assert limits[1] == pytest.approx(0.25 * limits[2], rel=0.05), "as the drag, the square of the speed"
    pladypos = load_vessel("pladypos")
    assert yaw_limit_at(pladypos, 0.0) == pytest.approx(1.08, rel=0.02)
