"""Experiments recorded from a vessel's own sensors: compass and depth of VideoRay; estimates while they run."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from bus import topics
from bus.config import Deployment
from bus.messages import ExperimentEstimate, ExperimentPlan, ExperimentResult, ExperimentStatus
from logs.recorder import Recorder, RecorderConfig
from marine.vessel import DegreeOfFreedom
from services.cli.identify import app as identify
from services.experiment import ExperimentConfig, Experiments
from services.experiment_run import sensor_of
from services.vessels import load_vessel, vessel_path
from tests.star import Star

CALM = {"current_x_m_s": 0.0, "current_std_m_s": 0.0}
NO_RADIO_S = 0.0
"""loop:// hands a command to the simulator at once: only the vessel file's delays are left."""


def star_of(vessel: str, folder: Path, seed: int = 1, **config: Any) -> Star:
    star = Star(vessel=vessel, simulator={"seed": seed, **CALM}, sensors={"seed": seed})
    deployment = Deployment(run_dir=Path("/nonexistent"), recordings_dir=folder, vessel_path=None)
    star.bus.add(Experiments(ExperimentConfig(save=False, **config), star.vessel, deployment))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 10.0
    )
    return star


def run(star: Star, timeout_s: float = 300.0, **plan: Any) -> tuple[ExperimentStatus, ExperimentResult]:
    answer = star.request("experiment", experiment=ExperimentPlan(**plan))
    assert answer.accepted, answer.reason

    def ended() -> bool:
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

    star.bus.run_until(ended, timeout_s)
    status, result = star.bus.last(topics.EXPERIMENT_STATUS), star.bus.last(topics.EXPERIMENT_RESULT)
    assert status is not None
    assert result is not None, status.reason
    return status, result


def off(parameters: Any, dof: DegreeOfFreedom) -> tuple[float, float]:
    found = {p.name: p.value for p in parameters}
    return found["alpha"] / dof.alpha - 1.0, found["beta_quadratic"] / dof.beta_quadratic - 1.0


def test_yaw_of_videoray_by_its_compass_of_two_degrees_and_live_estimates(tmp_path: Path) -> None:
    star = star_of("videoray", tmp_path, instruments=True, delay_s=NO_RADIO_S)
    estimates = star.record(topics.EXPERIMENT_ESTIMATE)
    status, result = run(
        star, name="self-oscillation", axis="yaw", amplitude=0.4, hysteresis_rad=math.radians(20.0), duration_s=120.0
    )
    assert status.state == "done", status
    assert status.elapsed_s <= 90.0
    yaw = star.vessel.model.yaw
    alpha, beta = off(result.methods[0].parameters, yaw)
    assert abs(alpha) < 0.04
    assert abs(beta) < 0.05
    steps = {round(b - a, 3) for a, b in zip(result.t_s[:-1], result.t_s[1:], strict=True)}
    assert steps == {0.1}  # the compass' samples, not the camera's
    last = estimates[-1]
    assert isinstance(last, ExperimentEstimate)
    assert len(estimates) > 5
    assert all(p.std is not None and p.std > 0.0 for p in last.parameters)
    alpha, beta = off(last.parameters, yaw)
    assert abs(alpha) < 0.06
    assert abs(beta) < 0.08


@pytest.mark.parametrize("name", ["self-oscillation", "step"])
def test_heave_of_videoray_by_its_depth_sensor(tmp_path: Path, name: str) -> None:
    star = star_of("videoray", tmp_path, delay_s=NO_RADIO_S)
    answer = star.request("depth", z_m=4.0)
    assert answer.accepted, answer.reason
    star.bus.run_until(lambda: abs(star.truth[-1].z_m or 0.0) > 3.9, 120.0)
    star.bus.run_for(10.0)
    recorded = Deployment(vessel_path=vessel_path("videoray"), recordings_dir=tmp_path / "recordings")
    star.bus.add(Recorder(RecorderConfig(min_free_mib=0), star.vessel, recorded))
    status, result = run(star, name=name, axis="heave", amplitude=0.6, hysteresis_m=0.2, oscillations=3)
    star.bus.stop("recorder")
    assert status.state == "done", status
    heave = star.vessel.model.heave
    assert heave is not None
    assert result.methods[0].parameters, result.methods[0].failure
    alpha, beta = off(result.methods[0].parameters, heave)
    if name == "step":  # its weight in water is a force that one step cannot tell from drag
        assert abs(beta) < 0.5
    else:
        assert abs(alpha) < 0.06
        assert abs(beta) < 0.08
        (log,) = recorded.recordings_dir.glob("*.mcap")
        delay_s = ("--delay-s", str(star.vessel.actuation_delay_s))
        again = CliRunner().invoke(identify, ["projection", str(log), *delay_s, "--json"])
        assert again.exit_code == 0, again.output
        found = {p["name"]: p["value"] for p in json.loads(again.stdout)["parameters"]}
        assert found["alpha"] == pytest.approx(heave.alpha * (1.0 + alpha), rel=0.01), "the same data"


def test_heave_near_the_surface_is_refused(tmp_path: Path) -> None:
    star = star_of("videoray", tmp_path)
    answer = star.request("experiment", experiment=ExperimentPlan(name="self-oscillation", axis="heave"))
    assert answer.accepted, answer.reason
    star.bus.run_for(0.5)
    status = star.bus.last(topics.EXPERIMENT_STATUS)
    assert status is not None
    assert status.state == "failed"
    assert "m to the wall" in status.reason


def test_yaw_is_estimated_from_an_ordinary_drive_when_asked(tmp_path: Path) -> None:
    from bus.messages import OperatorJoystick

    star = star_of("pladypos", tmp_path, always_yaw=True, delay_s=1.0 / 60.0)
    assert star.request("manual").accepted
    for k in range(300):
        stick = 0.6 if (k // 25) % 2 else -0.6
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", yaw=stick))
        star.bus.run_for(0.1)
    last = star.bus.last(topics.EXPERIMENT_ESTIMATE)
    assert last is not None
    assert last.run == ""
    alpha, beta = off(last.parameters, star.vessel.model.yaw)
    assert abs(alpha) < 0.05
    assert abs(beta) < 0.08


@pytest.mark.parametrize(
    ("vessel", "axis", "instruments", "port"),
    [
        ("pladypos", "yaw", None, "pose"),
        ("pladypos", "yaw", True, "pose"),
        ("videoray", "yaw", None, "pose"),
        ("videoray", "yaw", True, "compass"),
        ("videoray", "heave", None, "depth"),
        ("charlie", "yaw", None, "compass"),
        ("charlie", "surge", None, "position"),
    ],
)
def test_which_sensor_an_axis_is_recorded_from(vessel: str, axis: Any, instruments: bool | None, port: str) -> None:
    assert sensor_of(load_vessel(vessel), axis, instruments) == port
