"""Identified models that are engaged reach guard, helm and experiments, and go again."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import AxisModel, ExperimentPlan, OperatorJoystick, TunedAxis, Tuning, TuningRequest
from services.experiment import ExperimentConfig, Experiments
from services.vessels import load_vessel
from tests.star import Star
from tests.system.heavy_simulator import heavier

FILE = load_vessel("pladypos").model
TRUE = heavier(FILE)
AXES: tuple[TunedAxis, ...] = ("surge", "sway", "yaw")
TRUE_MODELS = {axis: AxisModel(**dataclasses.asdict(getattr(TRUE, axis))) for axis in AXES}


@pytest.fixture
def star(tmp_path: Path) -> Star:
    star = Star(unknown={"model": TRUE, "dynamics": TRUE}, simulator={"current_x_m_s": 0.0, "current_std_m_s": 0.0})
    star.bus.add(Experiments(ExperimentConfig(), star.vessel, Deployment(tmp_path, recordings_dir=tmp_path)))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 5.0
    )
    return star


def engage(star: Star, tuning: Tuning | None) -> None:
    """Engage a tuning, None: go back to the file's."""
    request = TuningRequest(request_id=f"{star.bus.now_s}", client="test", tuning=tuning)
    star.bus.publish(topics.OPERATOR_TUNING, request)
    star.bus.run_for(0.5)
    answer = star.bus.last(topics.CONTROL_ANSWER)
    assert answer is not None
    assert answer.accepted, answer.reason


def nearest_m(star: Star) -> float:
    """Return how near the hull comes to the wall ahead at full stick from the other end of the pool."""
    star.fault("displace", x_m=0.6, y_m=1.875, psi_rad=0.0)
    star.bus.run_for(2.0)
    assert star.request("manual").accepted
    begin = len(star.truth)
    for _ in range(250):
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", surge=1.0, sway=0.0, yaw=0.0))
        star.bus.run_for(0.1)
    star.request("stop")
    far = max(t.x_m for t in star.truth[begin:])
    return star.vessel.pool.length_x_m - star.vessel.radius_m - far


def test_the_guard_brakes_as_the_heavy_vessel_must(star: Star) -> None:
    assert nearest_m(star) <= 0.0, "with the file's model, which is wrong by two, it touches"
    engage(star, Tuning(law="ipd", models=TRUE_MODELS))
    assert nearest_m(star) > 0.0
    engage(star, None)
    assert nearest_m(star) <= 0.0


def test_the_helm_grants_what_the_model_in_force_can_do(star: Star) -> None:
    fast = {"speed_m_s": 0.45, "psi_rad": 0.0}
    assert "more than pladypos can do" in star.request("speed", **fast).reason
    engage(star, Tuning(law="ipd", models=TRUE_MODELS))
    assert star.request("speed", **fast).accepted
    engage(star, None)
    assert "more than pladypos can do" in star.request("speed", **fast).reason


def test_an_experiment_is_planned_on_the_model_in_force(star: Star) -> None:
    def reason() -> str:
        plan = ExperimentPlan(name="self-oscillation", axis="surge", amplitude=0.3, hysteresis_m=0.6)
        answer = star.request("experiment", experiment=plan)
        assert answer.accepted, answer.reason
        star.bus.run_for(1.0)
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        assert status is not None
        assert status.run == answer.request_id
        star.request("stop")
        return status.reason

    before = reason()
    engage(star, Tuning(law="ipd", models=TRUE_MODELS))
    heavy = reason()
    assert "the vessel would swing by" in heavy
    assert heavy != before
    engage(star, None)
    assert reason() == before
