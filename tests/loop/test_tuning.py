"""Tuning on the running star: what is asked for is engaged without a jump or refused with a reason, and kept."""

from __future__ import annotations

import math
import random
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from bus import topics
from bus.config import Deployment
from bus.messages import (
    ActuatorFault,
    AxisModel,
    ControlGains,
    ExperimentPlan,
    ExperimentResult,
    OperatorJoystick,
    TunedAxis,
    Tuning,
    TuningAnswer,
    TuningRequest,
    WayPoint,
    Wrench,
)
from marine.frames import wrap_angle
from marine.vessel import HorizontalModel
from services.experiment import ExperimentConfig, Experiments
from services.tuning import STEPS, horizontal_limits, preview
from services.vessels import VESSELS_DIR, load_vessel
from tests.star import Star, build_star
from tests.system.heavy_simulator import heavier

PLADYPOS = load_vessel("pladypos")
HEAVIER = heavier(PLADYPOS.model)
CURRENT = {"current_x_m_s": 0.04, "current_y_m_s": 0.03, "current_std_m_s": 0.0}
FAST = Tuning(law="ipd", parameters={"w0_rad_s": 1.0})


def ask(star: Star, tuning: Tuning | None, **fields: Any) -> TuningAnswer:
    """Ask the controller for a tuning and return its answer."""
    number = f"{star.bus.now_s}"
    request = TuningRequest(request_id=number, client="test", tuning=tuning)
    star.bus.publish(topics.OPERATOR_TUNING, request.model_copy(update=fields))

    def answered() -> bool:
        answer = star.bus.last(topics.CONTROL_ANSWER)
        return answer is not None and answer.request_id == number

    star.bus.run_until(answered, 1.0)
    answer = star.bus.last(topics.CONTROL_ANSWER)
    assert answer is not None
    return answer


def gains(star: Star) -> ControlGains:
    star.bus.run_for(1.1)
    told = star.bus.last(topics.CONTROL_GAINS)
    assert told is not None
    return told


@pytest.mark.parametrize(
    "tuning",
    [FAST, Tuning(law="lqr"), Tuning(law="p_d"), Tuning(law="ipd", models={"yaw": AxisModel(alpha=0.6)})],
    ids=["w0", "lqr", "p_d", "model"],
)
def test_another_tuning_takes_over_without_a_jump(tuning: Tuning) -> None:
    star = build_star(simulator=CURRENT)
    star.hold(2.5, 1.875, 0.5)
    star.bus.run_for(20.0)
    wrenches = star.record(topics.HELM_WRENCH)
    star.bus.run_for(2.0)
    usual = steps(wrenches)
    wrenches.clear()
    since_s = star.bus.now_s
    assert ask(star, tuning).accepted
    star.bus.run_for(2.0)
    assert steps(wrenches) < 2.0 * usual + 0.02
    told = gains(star)
    assert (told.engaged, told.by, told.tuning.law) == (True, "test", tuning.law)
    assert abs(told.since_ns * 1e-9 - since_s) < 0.2
    star.bus.run_for(10.0)
    assert star.rms_error(2.5, 1.875, 0.5, since_s)[0] < 3e-3


def steps(wrenches: list[Any]) -> float:
    """Return the largest change of the surge force from one wrench to the next, N."""
    forces = [w.surge_n or 0.0 for w in wrenches if isinstance(w, Wrench)]
    return max(abs(b - a) for a, b in pairwise(forces))


@pytest.mark.parametrize(
    ("tuning", "reason"),
    [
        (Tuning(law="ipd", parameters={"model_function": "1,1,2"}), "the model function 1,1,2 is not stable"),
        (Tuning(law="ipd", models={"yaw": AxisModel(alpha=0.5, beta=10.0)}), r"\(8.22\)"),
        (Tuning(law="ipd", parameters={"w0_rad_s": 20.0}), "delay margin is 0.023 s"),
        (Tuning(law="ipd", parameters={"w0_rad_s": -1.0}), "w0 must be positive"),
        (Tuning(law="ipd", models={"yaw": AxisModel(alpha=-0.5)}), "inertia must be positive"),
        (Tuning(law="ipd", parameters={"w": 1.0}), "no such key"),
        (Tuning(law="pid"), "no law is called 'pid'; known: ipd, lqr, p_d"),
    ],
)
def test_what_is_not_allowed_is_refused_and_nothing_changes(tuning: Tuning, reason: str) -> None:
    star = build_star(simulator=CURRENT)
    before = gains(star)
    answer = ask(star, tuning)
    assert not answer.accepted
    assert re.search(reason, answer.reason)
    after = gains(star)
    assert (after.tuning, after.engaged, after.since_ns) == (before.tuning, False, before.since_ns)


def test_who_does_not_have_the_helm_and_who_is_late_is_refused() -> None:
    star = build_star()
    assert "old" in ask(star, FAST, stamp_ns=round((star.bus.now_s - 5.0) * 1e9)).reason
    star.request("hold", attended=True, lease_s=60.0)
    assert "test has the helm" in ask(star, FAST, client="other").reason
    assert ask(star, FAST).accepted


def test_a_path_goes_on_where_it_was() -> None:
    star = build_star(simulator=CURRENT)
    star.hold(1.5, 1.5, 0.0)
    star.bus.run_for(10.0)
    corners = tuple(WayPoint(x_m=x_m, y_m=y_m) for x_m, y_m in ((1.5, 1.5), (3.5, 1.5), (3.5, 2.5)))
    answer = star.request("path", points=corners, speed_m_s=0.12)
    assert answer.accepted, answer.reason
    star.bus.run_for(12.0)
    begin, since_s = star.truth[-1].x_m, star.bus.now_s
    assert begin > 2.0
    assert ask(star, Tuning(law="ipd", models={"surge": AxisModel(alpha=30.0, beta_quadratic=19.0)})).accepted
    star.bus.run_for(30.0)
    after = [t for t in star.truth if t.stamp_ns * 1e-9 > since_s]
    assert min(t.x_m for t in after) > begin - 0.05
    assert math.hypot(after[-1].x_m - 3.5, after[-1].y_m - 2.5) < 0.1


def test_back_to_the_file_and_to_what_was_before() -> None:
    star = build_star()
    ask(star, FAST)
    ask(star, Tuning(law="lqr"))
    told = gains(star)
    assert told.before is not None
    assert told.before.parameters["w0_rad_s"] == 1.0
    assert ask(star, None).accepted
    told = gains(star)
    assert (told.engaged, told.tuning) == (False, told.configured)
    assert told.before is not None
    assert told.before.law == "lqr"


@pytest.mark.parametrize(
    ("away_s", "configured", "engaged"), [(2.0, {}, True), (40.0, {}, False), (2.0, {"positioning": "lqr"}, False)]
)
def test_a_restarted_controller_goes_on_with_what_was_engaged(
    away_s: float, configured: dict[str, Any], engaged: bool
) -> None:
    star = build_star(simulator=CURRENT)
    ask(star, FAST)
    before = gains(star)
    star.bus.kill("controller")
    star.bus.run_for(away_s)
    star._sections["controller"] = configured
    star.start("controller")
    after = gains(star)
    assert after.engaged is engaged
    assert (after.tuning == before.tuning) is engaged
    assert (after.since_ns == before.since_ns) is engaged


def test_what_was_predicted_is_what_the_star_does() -> None:
    star = build_star(simulator=CURRENT | {"current_x_m_s": 0.0, "current_y_m_s": 0.0})
    ask(star, FAST)
    expected = preview(FAST, PLADYPOS, horizontal_limits(PLADYPOS), gains(star).shaping)
    star.hold(1.8, 1.875, 0.0)
    star.bus.run_for(20.0)
    since_s = star.bus.now_s
    star.hold(2.8, 1.875, math.pi / 2.0)
    star.bus.run_for(20.0)
    after = [t for t in star.truth if t.stamp_ns * 1e-9 >= since_s]
    way: dict[TunedAxis, list[float]] = {"surge": [t.x_m - 1.8 for t in after], "yaw": [t.psi_rad for t in after]}
    for axis, size in STEPS.items():
        if axis not in way:
            continue
        outside = [
            t.stamp_ns * 1e-9 - since_s for t, e in zip(after, way[axis], strict=True) if abs(e - size) > 0.05 * size
        ]
        assert outside[-1] == pytest.approx(expected[axis]["step"]["settling_s"], rel=0.15)
        assert max(way[axis]) / size - 1.0 < expected[axis]["step"]["overshoot_percent"] / 100.0 + 0.02


# --- an unknown vessel, in three clicks


def unknown_vessel(folder: Path, model: HorizontalModel = HEAVIER) -> Star:
    """Return a star whose simulated vessel is not what its file says."""
    deployment = Deployment(
        run_dir=Path("/nonexistent"), recordings_dir=folder, vessel_path=VESSELS_DIR / "pladypos.toml"
    )
    star = Star(simulator=CURRENT, unknown={"model": model, "dynamics": model})
    star.bus.add(Experiments(ExperimentConfig(delay_s=1.0 / 60.0), star.vessel, deployment))
    star.bus.run_until(
        lambda: (s := star.bus.last(topics.NAVIGATION_STATE)) is not None and s.status == "tracking", 5.0
    )
    return star


def tune(star: Star, axis: TunedAxis) -> AxisModel:
    """Run a self-oscillation and return the model that it gives: what the page's button does."""
    answer = star.request(
        "experiment", experiment=ExperimentPlan(name="self-oscillation", axis=axis, amplitude=0.7, oscillations=2)
    )
    assert answer.accepted, answer.reason

    def ended() -> bool:
        status = star.bus.last(topics.EXPERIMENT_STATUS)
        return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

    star.bus.run_until(ended, 200.0)
    result: ExperimentResult | None = star.bus.last(topics.EXPERIMENT_RESULT)
    assert result is not None, star.bus.last(topics.EXPERIMENT_STATUS)
    assert result.run == answer.request_id, star.bus.last(topics.EXPERIMENT_STATUS)
    found = {p.name: p.value for p in result.methods[0].parameters}
    return AxisModel(**{name: found.get(name, 0.0) for name in ("alpha", "beta", "beta_quadratic")})


def moved(star: Star, place_m: float) -> tuple[float, float, float]:
    """Return, of a way of 1 m with a turn by 90 degrees, seconds until within `place_m` and 5 % of the turn for good.

    And the overshoot of the turn in rad, and RMS distance in m at rest.
    """
    star.hold(1.9, 1.875, 0.0)
    star.bus.run_for(30.0)
    since_s = star.bus.now_s
    star.hold(2.9, 1.875, math.pi / 2.0)
    star.bus.run_for(40.0)
    after = [t for t in star.truth if t.stamp_ns * 1e-9 > since_s]
    off = [
        t.stamp_ns * 1e-9 - since_s
        for t in after
        if math.hypot(t.x_m - 2.9, t.y_m - 1.875) > place_m
        or abs(wrap_angle(t.psi_rad - math.pi / 2)) > 0.05 * math.pi / 2
    ]
    return (
        off[-1],
        max(t.psi_rad for t in after) - math.pi / 2.0,
        star.rms_error(2.9, 1.875, math.pi / 2.0, since_s + 30.0)[0],
    )


@pytest.mark.parametrize(
    ("axes", "place_m"),
    [(("yaw",), math.inf), pytest.param(("yaw", "surge", "sway"), 0.05, marks=pytest.mark.soak)],
    ids=["yaw", "all"],
)
def test_an_unknown_vessel_is_tuned_and_holds_within_the_goals(
    tmp_path: Path, axes: tuple[TunedAxis, ...], place_m: float
) -> None:
    """Algorithm 8.4 on the running system."""
    star = unknown_vessel(tmp_path)
    untuned_s, overshoot_rad, _ = moved(star, place_m)
    assert overshoot_rad > 0.05 * math.pi / 2.0  # without tuning it misses the goals of issue 7
    models = {axis: tune(star, axis) for axis in axes}
    for axis, model in models.items():
        assert model.alpha == pytest.approx(getattr(HEAVIER, axis).alpha, rel=0.05)
    assert ask(star, Tuning(law="ipd", models=models)).accepted
    settled_s, overshoot_rad, distance_m = moved(star, place_m)
    assert settled_s <= min(15.0, 0.95 * untuned_s)
    assert overshoot_rad < 0.01 * math.pi / 2.0  # the estimator has the model, too: without it 2 %
    assert distance_m <= 1.5e-3 or "surge" not in axes
    health = star.bus.last(topics.ACTUATOR_HEALTH)
    assert health is not None
    assert health.lost == {}
    saved = load_vessel(str(next((tmp_path / "identified").glob("pladypos-engaged-*.toml"))))
    assert saved.model.yaw.alpha == pytest.approx(models["yaw"].alpha, rel=1e-6)
    assert saved.model.surge.alpha == pytest.approx(models.get("surge", PLADYPOS.model.surge).alpha, rel=1e-6)


@pytest.mark.parametrize("model", [HEAVIER, heavier(PLADYPOS.model, 0.5)], ids=["heavier", "lighter"])
def test_no_thruster_of_an_unknown_vessel_is_left_out_until_one_fails(tmp_path: Path, model: HorizontalModel) -> None:
    star = unknown_vessel(tmp_path, model)
    blamed: list[ActuatorFault] = []
    star.bus.tap(topics.ACTUATOR_FAULT, lambda fault: blamed.append(fault) if fault.lost else None)
    moved(star, 0.05)
    models: dict[TunedAxis, AxisModel] = {}
    for axis in ("yaw", "surge"):
        models[axis] = tune(star, axis)
        star.hold(2.5, 1.875)  # a hard way back
        star.bus.run_for(8.0)
    drive_by_hand(star, 12.0)
    star.hold(2.5, 1.875)
    star.bus.run_for(15.0)
    assert not blamed, blamed[0]
    models["sway"] = models["surge"]
    assert ask(star, Tuning(law="ipd", models=models)).accepted
    star.fault("thruster_dead", thruster="front_port")
    star.hold(2.0, 1.875)
    star.bus.run_until(lambda: bool(blamed), 10.0)
    assert list(blamed[0].lost) == ["front_port"]


def drive_by_hand(star: Star, seconds: float) -> None:
    chance = random.Random(1)
    assert star.request("manual").accepted
    for k in range(round(seconds / 0.2)):
        if k % 15 == 0:
            stick = {axis: chance.uniform(-1.0, 1.0) for axis in ("surge", "sway", "yaw")}
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", **stick))
        star.bus.run_for(0.2)
