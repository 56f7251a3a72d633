from __future__ import annotations

import math
import statistics

import pytest

from marine.dynamics.integrate import State
from marine.frames import to_tank
from services.simulator.actuators import DEAD
from services.simulator.world import LONGEST_GAP_NS, Current, Surroundings, World
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
NAMES = [t.name for t in VESSEL.thrusters]
START_NS = 1_000_000_000_000
MIDDLE: State = (2.5, 1.875, 0.0, 0.0, 0.0, 0.0)
ALL_AHEAD = dict.fromkeys(NAMES, 15.0)


def world(state: State = MIDDLE, current: Current | None = None, seed: int = 1) -> World:
    return World(VESSEL, Surroundings(current or Current()), seed, state, START_NS)


def run(w: World, seconds: float, since_s: float = 0.0, step_ns: int = 16_666_667) -> None:
    now_ns, end_ns = START_NS + round(since_s * 1e9), START_NS + round((since_s + seconds) * 1e9)
    while now_ns < end_ns:
        now_ns = min(now_ns + step_ns, end_ns)
        w.advance(now_ns)


def test_thrusters_push_as_the_geometry_says() -> None:
    w = world()
    thrust = 0.2 * 0.02 * 15**2  # K_T n^2, pladypos (1)
    w.command(ALL_AHEAD)
    assert w.tau == pytest.approx((4 * thrust * math.sqrt(0.5), 0.0, 0.0))
    w.command({**ALL_AHEAD, "front_port": -15.0, "rear_port": -15.0})  # starboard ahead, port astern: turns to port
    assert w.tau[2] == pytest.approx(-4 * thrust * 0.3)
    w.command({"front_port": 15.0})
    assert w.tau == pytest.approx((thrust * math.sqrt(0.5), thrust * math.sqrt(0.5), thrust * 0.3))


def test_a_dead_thruster_gives_nothing_until_it_is_mended() -> None:
    w = world()
    w.command(ALL_AHEAD)
    whole = w.tau
    w.actuators.fail({"front_port": DEAD})
    assert w.tau[0] == pytest.approx(0.75 * whole[0])
    w.command(dict.fromkeys(NAMES, 10.0))
    assert w.tau[0] == pytest.approx(0.75 * whole[0] * 100 / 225)
    w.actuators.fail({})
    w.command(ALL_AHEAD)
    assert w.tau == whole


@pytest.mark.parametrize("psi", [0.0, 0.5, -2.0])
def test_walls_stop_the_hull_and_let_it_slide(psi: float) -> None:
    w = world((4.6, 1.875, psi, 0.0, 0.0, 0.0), Current(x_m_s=0.2, y_m_s=0.05))
    run(w, 12.0)
    x, y, _, u, v, _ = w.state
    assert x == 5.0 - VESSEL.radius_m
    assert 1.9 < y < 3.0  # it slides along
    x_rate, y_rate = to_tank(u, v, psi)
    assert x_rate == pytest.approx(0.0, abs=5e-3)
    assert y_rate > 0.0


def test_no_wall_lets_the_hull_through() -> None:
    for psi in (0.0, math.pi / 2, math.pi, -math.pi / 2, 0.8):
        w = world((2.5, 1.875, psi, 0.0, 0.0, 0.0))
        w.command(ALL_AHEAD)
        run(w, 40.0)
        x, y, *_ = w.state
        assert 0.3 <= x <= 4.7
        assert 0.3 <= y <= 3.45
        assert 0.3 in (x, y) or x == 5.0 - 0.3 or y == 3.75 - 0.3


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    gusts = Current(0.05, 0.0, std_m_s=0.02)
    first, same, other = world(current=gusts), world(current=gusts), world(current=gusts, seed=2)
    for w in (first, same, other):
        run(w, 20.0)
    assert first.state == same.state
    assert first.state != other.state


def test_how_often_it_is_asked_hardly_matters() -> None:
    coarse, fine = world(current=Current(0.05, 0.02)), world(current=Current(0.05, 0.02))
    for w in (coarse, fine):
        w.command({**ALL_AHEAD, "front_port": 3.0})
    run(coarse, 4.0, step_ns=100_000_000)
    run(fine, 4.0, step_ns=1_234_567)
    assert coarse.state == pytest.approx(fine.state, abs=1e-9)


def test_the_varying_current_has_its_spread_and_memory() -> None:
    w = world(current=Current(std_m_s=0.02, correlation_s=5.0))
    seen = []
    for k in range(20_000):
        run(w, 0.1, since_s=0.1 * k, step_ns=100_000_000)
        seen.append(w.varying_current_m_s[0])
    variance = statistics.pvariance(seen)
    assert math.sqrt(variance) == pytest.approx(0.02, rel=0.1)
    lagged = statistics.fmean(a * b for a, b in zip(seen, seen[50:], strict=False))  # 5 s apart: 1/e
    assert lagged / variance == pytest.approx(math.exp(-1.0), abs=0.1)


def test_a_stopped_process_stops_the_world() -> None:
    w = world()
    w.command(ALL_AHEAD)
    run(w, 1.0)
    before = w.state
    w.advance(START_NS + 1_000_000_000 + LONGEST_GAP_NS + 1)
    assert w.state == before
    w.advance(START_NS + 1_020_000_000 + LONGEST_GAP_NS)
    assert w.state[3] > before[3]


def test_a_clock_set_back_does_not_stop_the_world_for_ever() -> None:
    w = world()
    w.command(ALL_AHEAD)
    w.advance(START_NS - 3_600_000_000_000)
    w.advance(START_NS - 3_599_900_000_000)
    assert w.state[3] > 0.0


def test_displacing_keeps_to_the_pool_and_wraps_the_heading() -> None:
    w = world((2.5, 1.875, 3.0, 0.1, 0.0, 0.0))
    w.displace(0.5, -0.2, 0.5)
    assert w.state[:3] == pytest.approx((3.0, 1.675, 3.5 - 2 * math.pi))
    assert w.state[3] == 0.1
    w.displace(100.0, 0.0, 0.0)
    assert w.state[0] == pytest.approx(4.7)
