"""Mode heading on the star: the controller has yaw, the stick the place."""

from __future__ import annotations

import math

from bus import topics
from bus.messages import HelmState, OperatorJoystick
from marine.frames import wrap_angle
from tests.star import Star, build_star

CURRENT = {"current_x_m_s": 0.04, "current_y_m_s": 0.0, "current_std_m_s": 0.0}


def state(star: Star) -> HelmState:
    told = star.bus.last(topics.HELM_STATE)
    assert told is not None
    return told


def pull(star: Star, seconds: float, **sticks: float) -> None:
    for _ in range(round(seconds * 10)):
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", **sticks))
        star.bus.run_for(0.1)


def test_turns_to_the_heading_and_keeps_it_while_the_stick_drives() -> None:
    star = build_star(simulator={"current_x_m_s": 0.0, "current_y_m_s": 0.0, "current_std_m_s": 0.0})
    answer = star.request("heading", psi_rad=math.radians(170.0), x_m=99.0)
    assert (answer.accepted, answer.reason) == (True, "psi 170.0 deg")
    star.bus.run_for(15.0)
    assert state(star).sources == {"surge": "manual", "sway": "manual", "yaw": "controller"}
    before = star.truth[-1]
    assert abs(wrap_angle(before.psi_rad - math.radians(170.0))) < math.radians(1.0)
    pull(star, 4.0, surge=0.4, yaw=1.0)  # the stick's yaw does not count
    driving = star.truth[-1]
    moved = (driving.x_m - before.x_m, driving.y_m - before.y_m)
    assert math.hypot(*moved) > 0.2
    assert abs(wrap_angle(math.atan2(moved[1], moved[0]) - math.radians(170.0))) < math.radians(10.0)
    assert abs(wrap_angle(driving.psi_rad - math.radians(170.0))) < math.radians(3.0)


def test_without_a_stick_it_drifts_with_the_current_but_keeps_the_heading() -> None:
    star = build_star(simulator=CURRENT)
    assert star.request("heading", psi_rad=-2.0).accepted
    star.bus.run_for(20.0)
    start = star.truth[-1]
    star.bus.run_for(10.0)
    end = star.truth[-1]
    assert end.x_m - start.x_m > 0.1
    assert abs(wrap_angle(end.psi_rad + 2.0)) < math.radians(1.0)


def test_another_clients_stick_does_not_count() -> None:
    star = build_star(simulator={"current_x_m_s": 0.0, "current_y_m_s": 0.0, "current_std_m_s": 0.0})
    assert star.request("heading", psi_rad=0.0).accepted
    star.bus.run_for(10.0)
    start = star.truth[-1]
    for _ in range(30):
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="somebody", surge=1.0))
        star.bus.run_for(0.1)
    assert math.hypot(star.truth[-1].x_m - start.x_m, star.truth[-1].y_m - start.y_m) < 0.02


def test_when_the_operator_goes_it_holds_where_it_is_and_a_lost_pose_suspends() -> None:
    star = build_star(simulator=CURRENT)
    assert star.request("heading", psi_rad=1.0, lease_s=5.0).accepted
    star.bus.run_for(2.0)
    star.fault("camera_black")
    star.bus.run_for(1.0)
    assert state(star).suspended
    star.fault("camera_black", active=False)
    star.bus.run_for(1.0)
    assert (state(star).mode, state(star).suspended) == ("heading", False)
    star.bus.run_for(20.0)
    told = state(star)
    assert told.mode == "hold"
    assert set(told.sources.values()) == {"controller"}
    assert told.x_m is not None
    assert told.y_m is not None
    assert math.hypot(star.truth[-1].x_m - told.x_m, star.truth[-1].y_m - told.y_m) < 0.01


def test_from_hold_to_heading_and_back_without_a_jump() -> None:
    """Only sway and surge let go at once: they are the stick's."""
    star = build_star(simulator=CURRENT)
    star.hold(2.5, 1.8, 0.3)
    star.bus.run_for(15.0)
    assert star.request("heading").accepted
    star.bus.run_for(3.0)
    assert abs(wrap_angle(star.truth[-1].psi_rad - 0.3)) < math.radians(1.0)
    star.hold(2.5, 1.8, 0.3)
    star.bus.run_for(20.0)
    assert star.rms_error(2.5, 1.8, 0.3, star.bus.now_s - 5.0)[0] < 5e-3
