"""Actuators of the simulator: limits, dead zone, delay, lag, rate, rudder, direct commands, failure."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from marine.allocation import vessel_allocation
from services.simulator.actuators import DEAD, Actuators
from services.vessels import known_vessels, load_vessel

VIDEORAY, CHARLIE, TELEMETRON = load_vessel("videoray"), load_vessel("charlie"), load_vessel("telemetron")
MS = 1_000_000


def settled(actuators: Actuators, commands: dict[str, float], U: float = 0.0) -> tuple[float, ...]:
    actuators.command(commands, 0)
    for k in range(500):
        actuators.advance(20 * MS * (k + 1), 0.02, U)
    return actuators.wrench


@pytest.mark.parametrize("name", known_vessels())
def test_when_settled_the_wrench_is_what_the_allocator_calls_delivered(name: str) -> None:
    vessel = load_vessel(name)
    commands = {a.name: (0.3 + 0.1 * i) * a.n_max for i, a in enumerate(vessel.actuators)}
    wrench = settled(Actuators(vessel), commands, U=0.7)
    expected = vessel_allocation(vessel).delivered(list(commands.values()), 0.7)
    assert wrench == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_commands_arrive_after_the_delay_and_then_lag() -> None:
    actuators = Actuators(VIDEORAY)
    actuators.command({"port": 40.0, "starboard": 40.0, "vertical": 0.0}, 0)
    assert actuators.next_ns() == 100 * MS  # COMM 1 of thesis 3.1
    actuators.advance(99 * MS, 0.02, 0.0)
    assert actuators.values["port"] == 0.0
    actuators.advance(100 * MS, 0.05, 0.0)  # lag of 0.05 s: 63 % after as much
    assert actuators.values["port"] == pytest.approx(40.0 * (1.0 - math.exp(-1.0)))


def test_commands_under_way_keep_their_order_and_distance() -> None:
    actuators = Actuators(replace(VIDEORAY, actuators=tuple(replace(a, lag_s=0.0) for a in VIDEORAY.actuators)))
    for k in range(4):
        actuators.command({"port": 10.0 * k}, 30 * MS * k)
    seen = []
    for k in range(10):
        actuators.advance(30 * MS * k, 0.03, 0.0)
        seen.append(actuators.values["port"])
    assert seen == [0.0, 0.0, 0.0, 0.0, 0.0, 10.0, 20.0, 30.0, 30.0, 30.0]  # 100 ms later, seen every 30 ms


def test_limits_and_dead_zone() -> None:
    actuators = Actuators(VIDEORAY)
    full = settled(actuators, {"port": 1000.0, "starboard": 1000.0})
    assert full == pytest.approx(settled(Actuators(VIDEORAY), {"port": 48.0, "starboard": 48.0}))
    assert settled(Actuators(VIDEORAY), {"port": 3.0, "starboard": -3.0}) == (0.0,) * 6
    assert settled(Actuators(CHARLIE), {"port": -5.0, "starboard": -5.0})[0] == 0.0  # forward only


def test_a_rudder_turns_at_its_rate_and_does_nothing_without_wash() -> None:
    actuators = Actuators(CHARLIE)
    actuators.command({"rudder_port": 0.5, "rudder_starboard": 0.5, "port": 0.0, "starboard": 0.0}, 0)
    for k in range(20):
        actuators.advance(20 * MS * k, 0.02, 0.0)
    assert actuators.values["rudder_port"] == pytest.approx(0.5 * 0.4)  # rad/s for 0.4 s
    assert actuators.wrench == (0.0,) * 6
    turning = settled(actuators, {"rudder_port": 0.2, "rudder_starboard": 0.2, "port": 6.0, "starboard": 6.0})
    assert turning[5] == pytest.approx(2 * 1.2 * 0.46 * 36.0 * 0.2 * math.cos(0.2), rel=1e-6)  # (2.35), (2.37)
    assert actuators.n_squared == pytest.approx(36.0)


def test_direct_commands_are_the_wrench_at_their_rate() -> None:
    actuators = Actuators(TELEMETRON)
    actuators.command({"throttle": 0.8, "rudder": -0.5}, 0)
    actuators.advance(0, 0.1, 0.0)
    assert actuators.wrench[0] == pytest.approx(0.1)  # 1/s
    assert actuators.wrench[5] == pytest.approx(-0.05)
    assert settled(actuators, {"throttle": 0.8, "rudder": -0.5})[0] == pytest.approx(0.8)


def test_what_is_dead_gives_nothing_and_a_rudder_behind_it_has_no_wash() -> None:
    commands = {"rudder_port": 0.2, "rudder_starboard": 0.2, "port": 6.0, "starboard": 6.0}
    actuators = Actuators(CHARLIE)
    whole = settled(actuators, commands)
    actuators.fail({"rudder_port": DEAD})
    assert actuators.wrench[1] == pytest.approx(0.5 * whole[1])
    actuators.fail({"port": DEAD})
    assert actuators.wrench[1] == pytest.approx(0.5 * whole[1])
    assert actuators.n_squared == pytest.approx(18.0)
    actuators.fail({})
    assert actuators.wrench == whole
