"""A thruster fails while the vessel holds: found from commands and motion, left out, told; issue 7's numbers."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

from bus import topics
from bus.messages import ActuatorFault, ActuatorHealth, OperatorActuator, OperatorJoystick
from tests.star import Star, build_star

PLACE = (2.5, 1.875, 0.5)
CURRENT = {"current_x_m_s": 0.04, "current_y_m_s": 0.03, "current_std_m_s": 0.0}  # 0.05 m/s
VARYING = {**CURRENT, "current_std_m_s": 0.02, "current_correlation_s": 10.0}
THRUSTERS = ("front_port", "rear_starboard")
DETECTED_WITHIN_S = 10.0
LIMIT_M = 1.5e-3
"""RMS of holding in a constant current of 0.05 m/s that issue 7 allows a sound vessel."""
SETTLED_S = 15.0
WATCH_S = 12.0


def holding(simulator: dict[str, Any] = CURRENT, **sections: Any) -> Star:
    """Return a star that holds, settled, in a constant current unless told otherwise."""
    star = build_star(simulator=simulator, **sections)
    star.hold(*PLACE)
    star.bus.run_for(SETTLED_S)
    return star


def error(star: Star) -> float:
    """Return the RMS distance from the place over the next WATCH_S, in m."""
    since_s = star.bus.now_s
    star.bus.run_for(WATCH_S)
    return star.rms_error(*PLACE, since_s)[0]


def health(star: Star) -> ActuatorHealth:
    found = star.bus.last(topics.ACTUATOR_HEALTH)
    assert found is not None
    return found


def fault(star: Star) -> ActuatorFault:
    found = star.bus.last(topics.ACTUATOR_FAULT)
    assert found is not None
    return found


@pytest.mark.parametrize("name", THRUSTERS)
def test_a_dead_thruster_is_found_within_10_s_and_left_out_holding_is_as_good_as_before(name: str) -> None:
    star = holding(allocator={"leave_out_detected": True})
    sound = error(star)
    star.fault("thruster_dead", thruster=name)
    star.bus.run_until(lambda: bool(fault(star).lost), DETECTED_WITHIN_S)
    assert fault(star).lost[name] > 0.8
    star.bus.run_for(0.1)
    assert health(star).failed == {name: "detected"}
    star.bus.run_for(SETTLED_S)
    assert star.truth[-1].commands[name] == 0.0
    assert error(star) <= 2.0 * sound


def test_by_default_a_detected_failure_is_told_and_an_operator_decides() -> None:
    star = holding()
    star.fault("thruster_dead", thruster="front_port")
    star.bus.run_until(lambda: bool(fault(star).lost), DETECTED_WITHIN_S)
    star.bus.run_for(2.0)
    assert not health(star).failed
    assert list(health(star).lost) == ["front_port"]
    assert health(star).reason.startswith("front_port has lost")
    star.bus.publish(topics.OPERATOR_ACTUATOR, OperatorActuator(client="test", actuator="front_port", works=False))
    star.bus.run_for(0.2)
    assert health(star).failed == {"front_port": "operator"}
    assert star.truth[-1].commands["front_port"] == 0.0


@pytest.mark.parametrize(("kind", "fraction"), [("thruster_weak", 0.8), ("thruster_stuck", 0.0)])
def test_a_weak_or_stuck_thruster_is_found_when_it_is_used(kind: str, fraction: float) -> None:
    star = holding()
    star.fault(kind, thruster="rear_port", fraction=fraction)
    star.hold(PLACE[0] - 0.4, PLACE[1] + 0.3, PLACE[2])
    star.bus.run_until(lambda: bool(fault(star).lost), DETECTED_WITHIN_S)
    assert fault(star).lost["rear_port"] > 0.5


def test_undetected_it_holds_within_five_times_the_limit_for_a_sound_vessel() -> None:
    star = holding(estimator={"fault_detection": False})
    star.fault("thruster_dead", thruster="front_port")
    star.bus.run_for(SETTLED_S)
    assert error(star) <= 5.0 * LIMIT_M
    assert health(star).failed == {}


def test_a_failure_known_before_costs_at_most_twice_the_error() -> None:
    sound = error(holding())
    star = holding(allocator={"failed": ("rear_starboard",)})
    assert health(star).failed == {"rear_starboard": "configuration"}
    assert error(star) <= 2.0 * sound


def test_what_an_operator_marks_is_left_out_even_after_a_restart_until_it_works_again() -> None:
    star = holding()
    word = OperatorActuator(client="test", actuator="front_port", works=False)
    star.bus.publish(topics.OPERATOR_ACTUATOR, word)
    star.bus.run_for(0.2)
    assert health(star).failed == {"front_port": "operator"}
    assert star.truth[-1].commands["front_port"] == 0.0
    star.bus.kill("allocator")
    star.start("allocator")
    star.bus.run_for(2.0)
    assert health(star).failed == {"front_port": "operator"}
    star.bus.publish(topics.OPERATOR_ACTUATOR, word.model_copy(update={"works": True}))
    star.bus.run_for(2.0)
    assert (health(star).failed, health(star).reason) == ({}, "")


def test_a_second_failure_is_reported_and_not_left_out() -> None:
    star = holding(allocator={"failed": ("rear_starboard",), "leave_out_detected": True})
    star.fault("thruster_dead", thruster="front_port")
    star.bus.run_until(lambda: bool(fault(star).lost), 20.0)
    star.bus.run_for(0.1)
    assert health(star).failed == {"rear_starboard": "configuration"}
    assert "front_port has lost" in health(star).reason


def test_an_operators_word_ends_a_detection() -> None:
    star = holding()
    star.fault("thruster_dead", thruster="front_port")
    star.bus.run_until(lambda: bool(fault(star).lost), DETECTED_WITHIN_S)
    star.fault("clear")
    star.bus.publish(topics.OPERATOR_ACTUATOR, OperatorActuator(client="test", actuator="front_port", works=True))
    star.bus.run_for(SETTLED_S)
    assert (fault(star).lost, health(star).failed) == ({}, {})
    assert error(star) < 1e-3


@pytest.mark.parametrize("minutes", [2, pytest.param(60, marks=[pytest.mark.soak, pytest.mark.timeout(900)])])
def test_no_false_alarm_while_holding_stepping_and_driving_by_hand(minutes: int) -> None:
    star = holding(simulator=VARYING)
    found: list[ActuatorFault] = []
    star.bus.tap(topics.ACTUATOR_FAULT, lambda message: found.append(message) if message.lost else None)
    chance, end_s = random.Random(3), star.bus.now_s + 60.0 * minutes
    while star.bus.now_s < end_s:
        star.hold(chance.uniform(1.0, 4.0), chance.uniform(1.0, 2.75), chance.uniform(-math.pi, math.pi))
        star.bus.run_for(20.0)
        assert star.request("manual").accepted
        stick = {axis: chance.uniform(-0.5, 0.5) for axis in ("surge", "sway", "yaw")}
        for _ in range(15):
            star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", **stick))
            star.bus.run_for(0.2)
        star.hold(*PLACE)
        star.bus.run_for(10.0 if minutes < 10 else 60.0)
    assert not found, found[0]
