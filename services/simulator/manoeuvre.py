"""Manoeuvres of one vessel in free water, without bus or controllers: step, zig-zag, turning circle, given inputs."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from marine.allocation import Wrench, vessel_allocation
from marine.vessel import AXES, Pool, Vessel
from services.simulator.world import Surroundings, World

DEGREES_OF_FREEDOM = ("surge", "sway", "heave", "roll", "pitch", "yaw")
COLUMNS = ("t_s", "x_m", "y_m", "z_m", "psi_rad", "surge_m_s", "sway_m_s", "heave_m_s", "yaw_rad_s")
_SEA_M = 2e5
"""Without walls: nothing gets to the end of it."""


@dataclass
class Track:
    """What a vessel did: COLUMNS as series; psi_rad is not wrapped, the place starts at zero; actuators by name."""

    vessel: str
    columns: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in COLUMNS})
    actuators: dict[str, list[float]] = field(default_factory=dict)
    """Where each actuator was, in the unit of its command."""

    def __getitem__(self, name: str) -> list[float]:
        return self.columns[name]


Demand = Callable[[float, float], Wrench]
"""Wrench [X Y Z K M N] in {B} at a time in s and a heading in rad (not wrapped)."""
Given = Callable[[float], Mapping[str, float]]
"""Commands of the actuators at a time in s."""


class NotPossibleError(ValueError):
    """The vessel cannot do what is asked; the message says why."""


def reach(vessel: Vessel, dof: str, share: float) -> float:
    """Return a share of what the vessel can do on surge, sway ... alone, N or Nm; raise NotPossibleError if nothing."""
    most = vessel_allocation(vessel).axis_limits()[DEGREES_OF_FREEDOM.index(dof)]
    if not most:
        able = [d for d, axis in zip(DEGREES_OF_FREEDOM, AXES, strict=True) if axis in vessel.controlled]
        raise NotPossibleError(f"{vessel.name} has no actuator for {dof}; it controls {', '.join(able)}")
    return share * most


def step(vessel: Vessel, dof: str, share: float) -> Demand:
    """Return a constant force or moment on one axis from t = 0 on."""
    demand = _wrench({dof: reach(vessel, dof, share)})
    return lambda _t, _psi: demand


def turning_circle(vessel: Vessel, surge_share: float, yaw_share: float) -> Demand:
    """Return constant surge and yaw."""
    demand = _wrench({"surge": reach(vessel, "surge", surge_share), "yaw": reach(vessel, "yaw", yaw_share)})
    return lambda _t, _psi: demand


def zigzag(vessel: Vessel, surge_share: float, yaw_share: float, angle_rad: float) -> Demand:
    """Return Kempf's zig-zag: the moment changes its sign each time the heading has gone angle_rad to that side."""
    surge, yaw = reach(vessel, "surge", surge_share), reach(vessel, "yaw", yaw_share)
    side = 1.0

    def demand(_t: float, psi_rad: float) -> Wrench:
        nonlocal side
        if side * psi_rad >= angle_rad:
            side = -side
        return _wrench({"surge": surge, "yaw": side * yaw})

    return demand


def held(times_s: Sequence[float], rows: Sequence[Mapping[str, float]]) -> Given:
    """Return given commands, each held until the next; zero before the first."""
    return lambda t_s: rows[at - 1] if (at := bisect_right(times_s, t_s + 1e-9)) else {}


def run(
    vessel: Vessel,
    steer: Demand | None,
    seconds: float,
    *,
    given: Given | None = None,
    around: Surroundings | None = None,
    seed: int = 1,
    dt_s: float = 0.05,
) -> Track:
    """Return what the vessel does in free water (no walls, no tether), from rest; inputs change every dt_s.

    steer: wrench, which the allocation makes commands of; given: commands instead of it.
    """
    free = replace(vessel, pool=Pool(_SEA_M, _SEA_M), tether=None)
    middle = 0.5 * _SEA_M
    world = World(free, around or Surroundings(), seed, (middle, middle, 0.0, 0.0, 0.0, 0.0), 0)
    allocation, names = vessel_allocation(vessel), [a.name for a in vessel.actuators]
    track = Track(vessel.name, actuators={name: [] for name in names})
    psi = 0.0
    for k in range(round(seconds / dt_s) + 1):
        t_s = k * dt_s
        world.advance(round(t_s * 1e9))
        x, y, wrapped, u, v, r = world.state
        psi += math.remainder(wrapped - psi, math.tau)
        z, _, _, w, _, _ = world.upright
        for name, value in zip(COLUMNS, (t_s, x - middle, y - middle, z, psi, u, v, w, r), strict=True):
            track.columns[name].append(value)
        for name in names:
            track.actuators[name].append(world.actuators.values[name])
        if given is not None:
            world.command(given(t_s))
        elif steer is not None:
            commands, _ = allocation.solve(steer(t_s, psi), math.hypot(u, v), dt_s)
            world.command(dict(zip(names, commands, strict=True)))
    return track


def step_figures(track: Track, dof: str) -> dict[str, float]:
    """Return final velocity and the time after which 63 % of it were reached first."""
    column = {"surge": "surge_m_s", "sway": "sway_m_s", "heave": "heave_m_s", "yaw": "yaw_rad_s"}[dof]
    speeds = track[column]
    tail = speeds[-max(1, len(speeds) // 20) :]
    final = sum(tail) / len(tail)
    reached = next((t for t, s in zip(track["t_s"], speeds, strict=True) if abs(s) >= 0.632 * abs(final)), math.nan)
    return {f"final_{column}": final, "time_to_63_percent_s": reached}


def circle_figures(track: Track) -> dict[str, float]:
    """Return speed, yaw rate and radius at the end, and the tactical diameter: way to the side after half a turn."""
    u, v, r = track["surge_m_s"][-1], track["sway_m_s"][-1], track["yaw_rad_s"][-1]
    speed = math.hypot(u, v)
    half = next((abs(y) for y, psi in zip(track["y_m"], track["psi_rad"], strict=True) if abs(psi) >= math.pi), None)
    figures = {"speed_m_s": speed, "yaw_rad_s": r, "radius_m": speed / abs(r) if r else math.inf}
    return figures if half is None else {**figures, "tactical_diameter_m": half}


def zigzag_figures(track: Track, angle_rad: float) -> dict[str, float]:
    """Return the first two overshoots and the mean period, as far as the run has them."""
    peaks: list[tuple[float, float]] = []
    side = 1.0
    best = (0.0, 0.0)
    for t, psi in zip(track["t_s"], track["psi_rad"], strict=True):
        if side * psi > side * best[1]:
            best = (t, psi)
        elif side * best[1] >= angle_rad and side * psi < 0.0:
            peaks.append(best)
            side, best = -side, (t, psi)
    figures = {}
    for name, peak in zip(("first_overshoot_rad", "second_overshoot_rad"), peaks, strict=False):
        figures[name] = abs(peak[1]) - angle_rad
    if len(peaks) >= 3:
        figures["period_s"] = 2.0 * (peaks[-1][0] - peaks[0][0]) / (len(peaks) - 1)
    return figures


def _wrench(parts: Mapping[str, float]) -> Wrench:
    X, Y, Z, K, M, N = (parts.get(dof, 0.0) for dof in DEGREES_OF_FREEDOM)
    return X, Y, Z, K, M, N
