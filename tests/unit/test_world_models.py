"""The world runs whatever model a vessel file names, exactly enough, in whatever surroundings."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marine.allocation import vessel_allocation
from marine.dynamics.asv import AsvDynamics
from marine.dynamics.horizontal import CoupledDynamics
from marine.dynamics.six_dof import SixDofDynamics
from marine.dynamics.small_vessel import SmallVesselDynamics, mean_square
from marine.dynamics.uncoupled import UncoupledModel
from marine.environment import Waves, Wind
from marine.vessel import AsvModel, CoupledModel, HorizontalModel, Pool, SixDofModel, SmallVesselModel, Thruster, Vessel
from services.simulator.world import Current, Surroundings, World
from services.vessels import known_vessels, load_vessel

NS = 1_000_000_000
SEA = Pool(1e4, 1e4)
COUPLED = CoupledModel(30.0, 3.0, 5.0, 12.0, 1.0, (2.0, 4.0, 0.5), (20.0, 40.0, 2.0), x_g_m=0.05)
SIX_DOF = SixDofModel(
    30.0, (2.0, 2.5, 3.0, 0.0, 0.0, 0.0), (5.0, 12.0, 15.0, 0.5, 0.8, 1.0), (2.0, 4.0, 5.0, 0.5, 0.5, 0.5),
    (20.0, 40.0, 50.0, 1.0, 1.0, 2.0), 300.0, 298.0, r_g_m=(0.0, 0.0, 0.05),
)  # fmt: skip


def free(vessel: Vessel, **changes: Any) -> Vessel:
    """Return a vessel in wide water, its actuators without memory."""
    actuators = tuple(replace(a, lag_s=0.0, rate_per_s=None) for a in vessel.actuators)
    return replace(vessel, pool=SEA, tether=None, actuators=actuators, command_delay_s=0.0, **changes)


def vessels() -> list[Vessel]:
    pladypos = load_vessel("pladypos")
    stronger = tuple(replace(a, characteristic=replace(a.characteristic, k_t=0.05)) for a in pladypos.thrusters)  # type: ignore[arg-type]
    extra = [
        replace(pladypos, name=n, dynamics=d, actuators=stronger)
        for n, d in (("coupled", COUPLED), ("six_dof", SIX_DOF))
    ]
    return [free(v, bias=(0.0,) * 6) for v in [*map(load_vessel, known_vessels()), *extra]]


def derivative(vessel: Vessel, wrench: Any, commands: dict[str, float], current: tuple[float, float]) -> Any:
    """Return f(t, [x y psi u v r z w ...]) straight from the model's own class."""
    X, Y, Z, _, _, N = wrench
    model = vessel.dynamics
    match model:
        case HorizontalModel():
            plane = UncoupledModel(model)
            if model.heave is None:
                return lambda _t, s: plane.derivative(tuple(s), (X, Y, N), current)
            return lambda _t, s: (
                *plane.derivative(tuple(s[:6]), (X, Y, N), current),
                s[7],
                plane.heave_acceleration(s[7], Z),
            )
        case CoupledModel():
            coupled = CoupledDynamics(model)
            return lambda _t, s: coupled.derivative(tuple(s), (X, Y, N), current)
        case SmallVesselModel():
            n2 = mean_square([commands[a.name] for a in vessel.actuators if isinstance(a, Thruster)])
            small = SmallVesselDynamics(model).at(n2)
            return lambda _t, s: small.derivative(tuple(s), (X, Y, N), current)
        case AsvModel():
            asv = AsvDynamics(model)
            return lambda _t, s: asv.derivative(tuple(s), X, N)
        case SixDofModel():
            six = SixDofDynamics(model)
            return lambda _t, s: six.derivative(s, np.array(wrench), np.array([*current, 0.0]))


def seen(world: World, vessel: Vessel) -> list[float]:
    """Return the world's state in the order of the model's own."""
    x, y, psi, u, v, r = world.state
    z, phi, theta, w, p, q = world.upright
    if isinstance(vessel.dynamics, AsvModel):
        return [x, y, psi, u, r]
    if isinstance(vessel.dynamics, SixDofModel):
        return [x, y, z, phi, theta, psi, u, v, w, p, q, r]
    dives = isinstance(vessel.dynamics, HorizontalModel) and vessel.dynamics.heave is not None
    return [x, y, psi, u, v, r, *([z, w] if dives else [])]


@pytest.mark.parametrize("vessel", vessels(), ids=lambda v: v.name)
def test_as_exact_as_dop853_at_the_papers_sample_times(vessel: Vessel) -> None:
    """Random commands held for a sample time (0.033, 0.1, 0.5 s); 20 s of them; in a current where the model has it."""
    asv = isinstance(vessel.dynamics, AsvModel)
    current = (0.0, 0.0) if asv else (0.04, -0.03)
    sample_s = min(s.sample_time_s for s in vessel.sensors)
    world = World(vessel, Surroundings(Current(*current), depth_m=1e3), 1, (5e3, 5e3, 0.3, 0.0, 0.0, 0.0), 0)
    world.upright = (100.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    exact = np.array(seen(world, vessel))
    allocation, rng, now_s = vessel_allocation(vessel), np.random.default_rng(1), 0.0
    while now_s < 20.0:
        commands = {a.name: float(rng.uniform(a.lowest, a.n_max)) for a in vessel.actuators}
        world.command(commands)
        f = derivative(vessel, allocation.delivered(list(commands.values())), commands, current)
        for _ in range(5):
            span = (round(now_s * NS), round((now_s + sample_s) * NS))
            exact = solve_ivp(f, (0.0, (span[1] - span[0]) / NS), exact, method="DOP853", rtol=1e-11, atol=1e-12).y[
                :, -1
            ]
            world.advance(span[1])
            now_s += sample_s
    difference = np.array(seen(world, vessel)) - exact
    angles = [i for i, _ in enumerate(difference) if abs(difference[i]) > 3.0]
    difference[angles] = np.angle(np.exp(1j * difference[angles]))  # psi is wrapped in the world
    assert np.abs(difference).max() < 3e-6  # m, rad; steps over the kink of |nu| nu at rest cost most of it


def test_an_asv_drifts_with_the_current_and_keeps_its_speed_through_water() -> None:
    vessel = free(load_vessel("telemetron"))
    world = World(vessel, Surroundings(Current(0.5, 0.8)), 1, (5e3, 5e3, 0.0, 0.5, 0.8, 0.0), 0)
    world.command({"throttle": 0.4, "rudder": 0.0})
    still = World(vessel, Surroundings(), 1, (5e3, 5e3, 0.0, 0.0, 0.0, 0.0), 0)
    still.command({"throttle": 0.4, "rudder": 0.0})
    for k in range(1, 601):
        world.advance(k * NS // 20)
        still.advance(k * NS // 20)
    assert world.state[0] - still.state[0] == pytest.approx(0.5 * 30.0, abs=1e-6)
    assert world.state[1] - still.state[1] == pytest.approx(0.8 * 30.0, abs=1e-6)
    assert world.state[3] - still.state[3] == pytest.approx(0.5, abs=1e-9)


def test_a_small_hull_goes_with_the_waves_as_the_water_does() -> None:
    """Long waves: hull and water describe the same way, 90 degrees and the drag of their difference apart from none."""
    vessel = free(load_vessel("pladypos"))
    waves = Waves(0.2, 6.0, towards_rad=0.7)
    world = World(vessel, Surroundings(waves=waves), 5, (5e3, 5e3, 0.0, 0.0, 0.0, 0.0), 0)
    assert world._waves is not None
    (u, v), _ = world._waves.water(5e3, 5e3, 0.0)
    world.state = (5e3, 5e3, 0.0, u, v, 0.0)
    worst = 0.0
    for k in range(1, 1201):
        world.advance(k * NS // 20)
        x, y, _, u, v, _ = world.state
        water = world._waves.water(x, y, k / 20)[0]
        worst = max(worst, math.hypot(u - water[0], v - water[1]))
    assert worst < 0.1 * 0.2 / 2 * math.tau / 6.0  # a tenth of the orbits' speed
    assert math.hypot(world.state[0] - 5e3, world.state[1] - 5e3) < 1.0


def test_bias_tether_and_wind_push() -> None:
    vessel = load_vessel("videoray")
    assert vessel.tether is not None
    still = free(vessel, bias=(0.0,) * 6)
    pushed = replace(still, bias=(0.05, 0.0, 0.0, 0.0, 0.0, 0.0))
    pulled = replace(still, tether=replace(vessel.tether, anchor_x_m=5e3 - 10.0, anchor_y_m=5e3, x_m=0.0))
    ends = []
    for v, around in ((still, Surroundings()), (pushed, Surroundings()), (pulled, Surroundings()),
                      (still, Surroundings(wind=Wind(5.0, 0.0, drag_area_m2=0.05)))):  # fmt: skip
        world = World(v, around, 1, (5e3, 5e3, 0.0, 0.0, 0.0, 0.0), 0)
        for k in range(1, 401):
            world.advance(k * NS // 20)
        ends.append(world.state[0] - 5e3)
    assert ends[0] == 0.0
    assert ends[1] > 0.2
    assert ends[2] < -4.0
    assert ends[3] > 0.5


def test_a_clock_set_back_does_not_hold_up_delayed_commands() -> None:
    world = World(load_vessel("videoray"), Surroundings(), 1, (2.5, 1.8, 0.0, 0.0, 0.0, 0.0), 10_000 * NS)
    world.advance(10_000 * NS + NS // 50)
    world.command({"port": 20.0})  # under way for 0.1 s
    world.advance(1 * NS)
    for k in range(1, 20):
        world.advance(NS + k * NS // 20)
    assert world.actuators.values["port"] == pytest.approx(20.0, abs=0.01)
    world.command({"port": 10.0})
    for k in range(20, 40):
        world.advance(NS + k * NS // 20)
    assert world.actuators.values["port"] == pytest.approx(10.0, abs=0.01)


def test_surface_and_bottom_stop_what_dives() -> None:
    vessel = free(load_vessel("falcon"))  # heavy by 10 N
    world = World(vessel, Surroundings(depth_m=1.0), 1, (5e3, 5e3, 0.0, 0.0, 0.0, 0.0), 0)
    depths = []
    for k in range(1, 1001):
        world.advance(k * NS // 20)
        depths.append(world.upright[0])
    assert depths == sorted(depths)
    assert (depths[-1], world.upright[3]) == (1.0, 0.0)
    world.command({"vertical": -100.0})
    for k in range(1001, 1401):
        world.advance(k * NS // 20)
    assert (world.upright[0], world.upright[3]) == (0.0, 0.0)


def test_everything_that_is_random_repeats_bit_by_bit() -> None:
    around = Surroundings(Current(0.02, 0.0, 0.01), Wind(3.0, 1.0, 1.0, drag_area_m2=0.05), Waves(0.1, 3.0))

    def end(seed: int) -> tuple[float, ...]:
        world = World(free(load_vessel("pladypos")), around, seed, (5e3, 5e3, 0.0, 0.0, 0.0, 0.0), 0)
        for k in range(1, 301):
            world.advance(k * NS // 30)
        return world.state

    assert end(1) == end(1)
    assert len({end(1), end(2), end(3)}) == 3


def test_walls_stop_every_model() -> None:
    for name in known_vessels():
        vessel = replace(load_vessel(name), bias=(0.0,) * 6, tether=None)
        x, y = vessel.pool.length_x_m - 2.0 * vessel.radius_m, 0.5 * vessel.pool.length_y_m
        world = World(vessel, Surroundings(), 1, (x, y, 0.0, 0.0, 0.0, 0.0), 0)
        commands, _ = vessel_allocation(vessel).solve(
            [vessel_allocation(vessel).axis_limits()[0], 0.0, 0.0, 0.0, 0.0, 0.0]
        )
        world.command({a.name: n for a, n in zip(vessel.actuators, commands, strict=True)})
        for k in range(1, 1201):
            world.advance(k * NS // 20)
        assert world.state[0] == pytest.approx(vessel.pool.length_x_m - vessel.radius_m), name
