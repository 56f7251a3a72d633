"""Every vessel file, driven by the joystick through the whole star: estimate, helm, allocator, link, firmware."""

from __future__ import annotations

import math

import pytest

from bus import topics
from bus.messages import NavigationState, OperatorJoystick, SensorPosition
from services.catalog import PROCESSES
from services.simulator.saved import Saved
from services.vessels import known_vessels, load_vessel
from tests.star import Star

CALM = {"current_x_m_s": 0.0, "current_std_m_s": 0.0}


def estimate(star: Star) -> NavigationState:
    state = star.bus.last(topics.NAVIGATION_STATE)
    assert state is not None
    return state


def drive(star: Star, seconds: float, **stick: float) -> None:
    for _ in range(round(10 * seconds)):
        star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", **stick))
        star.bus.run_for(0.1)


@pytest.mark.parametrize("name", known_vessels())
def test_it_can_be_driven_and_its_estimate_follows(name: str) -> None:
    star = Star(vessel=name, simulator=CALM)
    star.bus.run_for(8.0)
    assert star.request("manual").accepted
    before = star.truth[-1]
    drive(star, 15.0, surge=0.6, yaw=0.25)
    truth, state, vessel = star.truth[-1], estimate(star), star.vessel
    assert set(truth.commands) == {a.name for a in vessel.actuators}
    assert math.hypot(truth.x_m - before.x_m, truth.y_m - before.y_m) > 0.5 * vessel.radius_m
    assert truth.yaw_rad_s > 0.01
    receiver, compass = vessel.sensor("position"), vessel.sensor("compass")
    noise_m = receiver.noise if receiver and not vessel.sensor("camera") else 0.0
    age_s = receiver.sample_time_s if receiver else 0.1
    assert state.status in ("tracking", "predicting")
    error_m = math.hypot(state.x_m - truth.x_m, state.y_m - truth.y_m)
    assert error_m < 0.03 + 4.0 * noise_m + 0.3 * age_s * truth.surge_m_s
    error_rad = abs(math.remainder(state.psi_rad - truth.psi_rad, math.tau))
    assert error_rad < math.radians(6.0) + (4.0 * compass.noise if compass else 0.0)
    drive(star, 1.5)
    assert not any(star.truth[-1].commands.values())


def test_without_a_camera_there_is_no_tracker_and_without_instruments_no_sensors() -> None:
    def started(name: str) -> set[str]:
        return {p.name for p in PROCESSES if p.fits(load_vessel(name))}

    assert "sensors" not in started("pladypos")
    assert {"camera_tracker", "sensors"} <= started("videoray")
    assert "camera_tracker" not in started("charlie")


def test_a_silent_receiver_is_a_lost_position_and_comes_back() -> None:
    star = Star(vessel="charlie", simulator=CALM)
    star.bus.run_for(8.0)
    assert estimate(star).status in ("tracking", "predicting")
    star.fault("dropout", fraction=1.0)
    star.bus.run_for(4.0)
    assert estimate(star).status == "lost"
    star.fault("clear")
    star.bus.run_for(8.0)
    assert estimate(star).status in ("tracking", "predicting")


def test_positions_without_a_heading_are_no_pose() -> None:
    star = Star(vessel="charlie", simulator=CALM)
    star.bus.kill("sensors")
    for _ in range(20):
        star.bus.publish(topics.SENSOR_POSITION, SensorPosition(x_m=50.0, y_m=50.0))
        star.bus.run_for(0.1)
    assert star.bus.last(topics.NAVIGATION_STATE) is None


def test_depth_is_in_the_truth_and_in_the_saved_state() -> None:
    star = Star(vessel="falcon", simulator=CALM)  # heavy by 10 N
    star.bus.run_for(10.0)
    depth = star.truth[-1].z_m
    assert depth is not None
    assert depth > 0.3
    measured = star.bus.last(topics.SENSOR_DEPTH)
    assert measured is not None
    assert measured.z_m == pytest.approx(depth, abs=0.02)
    simulator = star.bus._steppers["simulator"].service
    saved = Saved.of(0, simulator._world, simulator._camera)  # type: ignore[attr-defined]
    simulator._world.upright = (0.0,) * 6  # type: ignore[attr-defined]
    Saved.model_validate_json(saved.model_dump_json()).restore(simulator._world)  # type: ignore[attr-defined]
    assert simulator._world.upright[0] == pytest.approx(depth, abs=0.01)  # type: ignore[attr-defined]


def test_a_dead_rudder_shows_at_run_time() -> None:
    star = Star(vessel="charlie", simulator=CALM)
    star.bus.run_for(3.0)
    assert star.request("manual").accepted
    drive(star, 5.0, surge=0.5, yaw=0.3)
    whole, delta = star.truth[-1].yaw_nm, star.truth[-1].commands["rudder_port"]
    star.fault("thruster_dead", thruster="rudder_port")
    drive(star, 0.2, surge=0.5, yaw=0.3)
    left = 0.5 * (1.0 + 0.6 / 1.2 * math.tan(delta))  # (2.35): the other one's drag turns, too
    assert star.truth[-1].yaw_nm == pytest.approx(left * whole, rel=0.01)


def test_runs_repeat_bit_by_bit_for_a_vessel_with_everything() -> None:
    def truths(json: bool) -> list[str]:
        around = {"wave_height_m": 0.02, "gust_std_m_s": 1.0, "wind_drag_area_m2": 0.01}
        star = Star(vessel="videoray", json=json, simulator=around)
        star.bus.run_for(2.0)
        star.request("manual")
        drive(star, 3.0, surge=0.6, yaw=0.25)
        return [t.model_dump_json() for t in star.truth]

    assert truths(False) == truths(False) == truths(True)
