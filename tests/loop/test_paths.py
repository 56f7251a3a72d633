"""Modes line, path, speed and depth on the star: way-points of the helm become tracks of the true vessel."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from bus import topics
from bus.messages import ControlStatus, HelmState
from marine.frames import wrap_angle
from marine.guidance.abilities import course_of
from services.controller import Controller, ControllerConfig
from services.guidance import guidance_for
from services.helm_modes import MODES, Checks
from services.vessels import VESSELS_DIR, known_vessels, load_vessel
from tests.star import Star, build_star

CURRENT = {"current_x_m_s": 0.04, "current_y_m_s": 0.03, "current_std_m_s": 0.005}
SQUARE = [(1.5, 0.8), (3.5, 0.8), (3.5, 2.8), (1.5, 2.8), (1.5, 1.0)]


def follow(star: Star, points: list[tuple[float, float]], **fields: Any) -> None:
    mode = "path" if len(points) > 2 else "line"
    answer = star.request(mode, points=[{"x_m": x, "y_m": y} for x, y in points], **fields)  # type: ignore[arg-type]
    assert answer.accepted, answer.reason


def helm(star: Star) -> HelmState:
    state = star.bus.last(topics.HELM_STATE)
    assert state is not None
    return state


def status(star: Star) -> ControlStatus:
    told = star.bus.last(topics.CONTROL_STATUS)
    assert told is not None
    return told


def on_path(star: Star) -> bool:
    return (status(star).along_m or 0.0) > 0.0


def arrived(star: Star) -> bool:
    return helm(star).mode == "hold"


def true_distances(star: Star, since: int, points: list[tuple[float, float]], smooth: bool) -> list[float]:
    """Return how far the true vessel was from the path, at each truth since one."""
    places = course_of(points, smooth).places
    return [float(np.hypot(*(places - (t.x_m, t.y_m)).T).min()) for t in star.truth[since:]]


@pytest.mark.parametrize("smooth", [False, True])
def test_a_square_and_a_spline_in_a_current(smooth: bool) -> None:
    star = build_star(simulator=CURRENT)
    follow(star, SQUARE, smooth=smooth, speed_m_s=0.18)
    star.bus.run_until(lambda: on_path(star), 30.0)
    since = len(star.truth)
    star.bus.run_until(lambda: arrived(star), 120.0)
    distances = true_distances(star, since, SQUARE, smooth)
    rms = math.sqrt(float(np.mean(np.square(distances))))
    print(f"cross-track RMS {1e3 * rms:.1f} mm, largest {1e3 * max(distances):.0f} mm")
    assert rms < 0.05  # the task; about 20 mm
    track = [(t.x_m, t.y_m) for t in star.truth[since:]]
    way = sum(math.dist(a, b) for a, b in pairwise(track))
    assert way == pytest.approx(course_of(SQUARE, smooth).length_m, rel=0.05)
    assert helm(star).reason == "the end of the path is reached"
    star.bus.run_for(3.0)
    assert math.dist(track[-1], SQUARE[-1]) < 0.06
    if not smooth:  # the bow points along the way
        assert abs(wrap_angle(star.truth[-1].psi_rad + math.pi / 2.0)) < 0.1


def test_a_moment_without_the_controller_does_not_stop_the_vessel_on_its_way() -> None:
    star = build_star(simulator=CURRENT)
    follow(star, SQUARE, speed_m_s=0.18)
    star.bus.run_until(lambda: (status(star).along_m or 0.0) > 0.8, 40.0)
    star.bus.pause("controller")
    star.bus.run_until(lambda: helm(star).suspended, 1.0)
    star.bus.resume("controller")
    star.bus.run_for(0.5)
    along_m = status(star).along_m or 0.0
    since = len(star.truth)
    star.bus.run_for(3.0)
    assert (status(star).along_m or 0.0) > along_m + 0.3
    assert min(math.hypot(t.surge_m_s, t.sway_m_s) for t in star.truth[since:]) > 0.08
    assert max(true_distances(star, since, SQUARE, smooth=False)) < 0.08


def test_a_line_with_a_heading_of_its_own_and_a_helm_and_a_controller_that_die() -> None:
    star = build_star(simulator=CURRENT)
    follow(star, [(4.2, 3.0)], psi_rad=math.pi, speed_m_s=0.12)  # from here
    assert (helm(star).points[0].x_m, helm(star).points[0].y_m) == pytest.approx((2.5, 1.875), abs=0.01)
    star.bus.run_until(lambda: (status(star).along_m or 0.0) > 0.5, 30.0)
    assert abs(wrap_angle(star.truth[-1].psi_rad - math.pi)) < 0.5
    for name in ("helm", "controller"):
        along = status(star).along_m
        assert along is not None
        star.bus.kill(name)
        star.bus.run_for(0.5)
        star.start(name)
        star.bus.run_for(4.0)
        assert helm(star).mode == "line"
        assert not helm(star).suspended
        now = status(star).along_m
        assert now is not None
        assert now > along - 0.05, "it goes on where it was"
    star.bus.run_until(lambda: arrived(star), 60.0)
    assert abs(wrap_angle(star.truth[-1].psi_rad - math.pi)) < 0.1
    assert math.dist((star.truth[-1].x_m, star.truth[-1].y_m), (4.2, 3.0)) < 0.06


def test_another_path_on_the_way_goes_on_from_where_the_reference_is() -> None:
    star = build_star(simulator=CURRENT)
    follow(star, [(1.0, 1.0), (4.0, 1.0)], speed_m_s=0.2)
    star.bus.run_until(lambda: (status(star).along_m or 0.0) > 0.5, 60.0)
    told: list[Any] = []
    star.bus.tap(topics.CONTROL_STATUS, told.append)
    star.bus.run_for(1.0)
    follow(star, [(3.0, 3.0), (1.0, 3.0)], speed_m_s=0.2)
    star.bus.run_for(6.0)
    places = [(s.reference_x_m, s.reference_y_m) for s in told]
    jumps = [math.dist(a, b) for a, b in pairwise(places)]
    assert max(jumps) < 0.2 * 0.31, "0.2 s at the largest speed"
    star.bus.run_until(lambda: arrived(star), 90.0)
    assert math.dist((star.truth[-1].x_m, star.truth[-1].y_m), (1.0, 3.0)) < 0.06


def test_the_reference_waits_for_a_vessel_that_is_carried_off() -> None:
    star = build_star(simulator=CURRENT)
    follow(star, [(1.0, 1.0), (4.0, 1.0)], speed_m_s=0.15)
    star.bus.run_until(lambda: (status(star).along_m or 0.0) > 0.8, 60.0)
    star.fault("displace", y_m=0.5)
    star.bus.run_for(1.0)
    along = status(star).along_m
    star.bus.run_for(1.5)
    assert along is not None
    assert (status(star).along_m or 0.0) - along < 0.1, "it waits"
    star.bus.run_until(lambda: arrived(star), 90.0)
    assert abs(status(star).cross_track_m or 0.0) < 0.05


@pytest.mark.parametrize(("mode", "end"), [("line", "hold"), ("speed", "hold"), ("depth", "depth")])
def test_without_an_operator_it_holds_or_stays(mode: Any, end: str) -> None:
    star = build_star(vessel="falcon" if mode == "depth" else "pladypos", simulator=CURRENT)
    star.bus.run_for(2.0)
    points = [{"x_m": 4.0, "y_m": 2.0}] if mode == "line" else []
    speed = {} if mode == "depth" else {"speed_m_s": 0.05}
    answer = star.request(mode, points=points, lease_s=2.0, **speed)
    assert answer.accepted, answer.reason
    star.bus.run_for(2.5)
    assert (helm(star).mode, helm(star).holder) == (end, "")


def test_a_vessel_that_cannot_hold_stops_without_an_operator() -> None:
    star = Star(vessel="nonlinear_yaw", simulator={"current_x_m_s": 0.0, "current_std_m_s": 0.0})
    star.bus.run_for(3.0)
    follow(star, [(8.0, 3.0)], lease_s=2.0)
    star.bus.run_for(1.0)
    assert helm(star).mode == "line"
    star.bus.run_for(2.0)
    assert (helm(star).mode, helm(star).reason) == ("stop", "the operator's page is gone")


@pytest.mark.parametrize("name", known_vessels())
def test_what_the_helm_grants_a_vessel_the_controller_can_do(name: str) -> None:
    vessel = load_vessel(name)
    checks, tools = Checks(vessel), Controller(ControllerConfig(), vessel).tools
    guidance, _ = guidance_for(tools)
    granted = [mode for mode, rule in MODES.items() if not checks.abilities.lacking(rule.needs)]
    if vessel.sensor("laser") is None:
        granted.remove("distance")  # refused: nobody tells of a wall
    assert {MODES[mode].law for mode in granted} - {""} <= set(guidance)
    assert {"speed", "line", "path", "heading"} <= set(granted)


def test_a_boat_without_a_positioning_law_keeps_its_heading() -> None:
    star = Star(vessel="telemetron", simulator={"current_x_m_s": 0.0, "current_std_m_s": 0.0})
    star.bus.run_for(4.0)
    assert star.request("heading", psi_rad=1.0).accepted
    star.bus.run_for(25.0)
    assert helm(star).mode == "heading"
    assert abs(wrap_angle(star.truth[-1].psi_rad - 1.0)) < 0.1  # its link tells the rudder in steps of 1 %


def test_a_speed_with_the_heading_held() -> None:
    star = build_star(simulator=CURRENT | {"x_m": 1.0})
    assert star.request("speed", speed_m_s=0.15, psi_rad=0.0).reason == "0.15 m/s, psi 0.0 deg"
    star.bus.run_for(12.0)
    truth = star.truth[-1]
    assert truth.surge_m_s == pytest.approx(0.15, abs=0.01)
    assert abs(truth.sway_m_s) < 0.01
    assert abs(truth.psi_rad) < 0.02
    star.bus.run_for(30.0)
    assert star.truth[-1].x_m < 4.7, "the guard stops it before the wall"
    assert "x = 5 m" in helm(star).guard


def test_a_depth_is_held_while_the_stick_has_the_rest_and_goes_along_into_other_modes() -> None:
    star = Star(vessel="videoray", simulator={"current_x_m_s": 0.0, "current_std_m_s": 0.0})
    star.bus.run_for(6.0)
    assert star.request("depth", z_m=1.0).reason == "depth 1.00 m"
    assert helm(star).sources == {"surge": "manual", "sway": "manual", "yaw": "manual", "heave": "controller"}
    star.bus.run_for(25.0)
    assert star.truth[-1].z_m == pytest.approx(1.0, abs=0.02)
    assert star.request("speed", speed_m_s=0.05, psi_rad=0.0).accepted
    star.bus.run_for(12.0)
    truth = star.truth[-1]
    assert truth.z_m == pytest.approx(1.0, abs=0.03)
    assert truth.surge_m_s == pytest.approx(0.05, abs=0.01)


# Charlie on the whole star: its allocation takes 3 ms a step, so these are long

WIND = {"wind_drag_area_m2": 2.0, "wind_y_m_s": 4.0, "gust_std_m_s": 0.3, "current_x_m_s": 0.0, "current_std_m_s": 0.0}
WALKS = {"force_walk_n": 0.3, "moment_walk_nm": 0.3, "yaw_rate_walk_rad_s": 0.002}


def charlie(tmp_path: Any, law: str, position_m: float) -> Star:
    """Return Charlie in wind of 19 N across, with a receiver of so much noise."""
    text = (VESSELS_DIR / "charlie.toml").read_text(encoding="utf-8")
    file = tmp_path / "charlie.toml"
    file.write_text(
        text.replace("noise = 0.5                     # chosen\n\n[[sensor]]", f"noise = {position_m}\n\n[[sensor]]")
    )
    place = {"x_m": 10.0, "y_m": 55.0}
    star = Star(vessel=str(file), simulator=WIND | place, estimator=WALKS, controller={"line": law})
    star.bus.run_for(8.0)
    return star


@pytest.mark.soak
@pytest.mark.parametrize("law", ["line_of_sight", "direct", "indirect"])
def test_charlie_follows_a_line_and_turns_back(tmp_path: Any, law: str) -> None:
    star = charlie(tmp_path, law, 0.05)
    follow(star, [(10.0, 50.0), (190.0, 50.0)], speed_m_s=1.0)
    star.bus.run_until(lambda: helm(star).mode == "stop", 240.0)
    assert helm(star).reason == "the end of the path is reached"
    d = [t.y_m - 50.0 for t in star.truth if t.x_m > 110.0]
    print(f"{law}: mean {1e3 * float(np.mean(d)):.0f} mm, RMS {1e3 * math.sqrt(float(np.mean(np.square(d)))):.0f} mm")
    assert abs(float(np.mean(d))) < 0.1
    star = charlie(tmp_path, law, 0.05)
    follow(star, [(10.0, 50.0), (90.0, 50.0), (90.0, 80.0), (10.0, 80.0)], speed_m_s=1.0)
    star.bus.run_until(lambda: helm(star).mode == "stop", 300.0)
    back = [t.y_m - 80.0 for t in star.truth[len(star.truth) // 2 :] if t.x_m < 30.0]
    assert back
    assert max(map(abs, back)) < 1.0
