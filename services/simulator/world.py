"""The world outside the bus: any vessel in its pool, pushed by actuators, water, wind and tether. No clock, no bus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from marine.allocation import Wrench
from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import Tau
from marine.environment import GaussMarkov, WaveField, Waves, Wind, tether_wrench, wind_wrench
from marine.frames import to_body, to_tank, wrap_angle
from marine.vessel import AsvModel, Vessel
from services.simulator.actuators import Actuators, relative_speed
from services.simulator.plants import AT_THE_SURFACE, plant_of

LONGEST_STEP_NS = 20_000_000
"""The quickest motion takes seconds: one Runge-Kutta step of 20 ms errs by less than 1 nm."""
LONGEST_GAP_NS = 500_000_000
_GUST_NS = 100_000_000
"""Varying current and gusts change every 0.1 s: often against their correlation times, seldom against the vessel."""


@dataclass(frozen=True)
class Current:
    """Current in {E}: a constant, and on each axis a first-order Gauss-Markov process."""

    x_m_s: float = 0.0
    y_m_s: float = 0.0
    std_m_s: float = 0.0
    correlation_s: float = 30.0


@dataclass(frozen=True)
class Surroundings:
    """What moves around the vessel. depth_m: of the water."""

    current: Current = field(default_factory=Current)
    wind: Wind = field(default_factory=Wind)
    waves: Waves | None = None
    depth_m: float = 10.0


class World:
    """The true state. The same commands at the same times give the same bits.

    A pause of more than 0.5 s (the process was stopped) stops the world's time, too.
    """

    def __init__(self, vessel: Vessel, around: Surroundings, seed: int, state: State, now_ns: int) -> None:
        current, wind = around.current, around.wind
        self.state = state
        """[x y psi u v r]."""
        self.upright = AT_THE_SURFACE
        """[z phi theta w p q]."""
        self.constant_current_m_s = (current.x_m_s, current.y_m_s)
        self.actuators = Actuators(vessel)
        self._vessel = vessel
        self._plant = plant_of(vessel.dynamics)
        self._masses = _masses(vessel)
        radius, pool = vessel.radius_m, vessel.pool
        self._walls = (radius, pool.length_x_m - radius, radius, pool.length_y_m - radius)
        self._wind, self._depth_m = wind, around.depth_m
        self._waves = WaveField(around.waves, vessel.radius_m, seed + 3) if around.waves else None
        self._drift = GaussMarkov(current.std_m_s, current.correlation_s, _GUST_NS * 1e-9, seed)
        self._gusts = GaussMarkov(wind.gust_std_m_s, wind.gust_correlation_s, _GUST_NS * 1e-9, seed + 2)
        self._changing = current.std_m_s > 0.0 or wind.gust_std_m_s > 0.0
        self._quiet = not (any(vessel.bias) or vessel.tether or wind.drag_area_m2 or self._waves)
        self._now_ns = now_ns
        self._gust_ns = now_ns
        self._commands: dict[str, float] = {}

    @property
    def current_m_s(self) -> tuple[float, float]:
        """The current at the vessel in {E}, without waves."""
        x, y = self._drift.value
        return self.constant_current_m_s[0] + x, self.constant_current_m_s[1] + y

    @property
    def varying_current_m_s(self) -> tuple[float, float]:
        """The part of the current that changes."""
        return self._drift.value

    @varying_current_m_s.setter
    def varying_current_m_s(self, value: tuple[float, float]) -> None:
        self._drift.value = value

    @property
    def wind_m_s(self) -> tuple[float, float]:
        """The wind at the vessel in {E}."""
        x, y = self._gusts.value
        return self._wind.x_m_s + x, self._wind.y_m_s + y

    @property
    def tau(self) -> Tau:
        """What the actuators give on surge, sway and yaw: N, N, Nm."""
        X, Y, _, _, _, N = self.actuators.wrench
        return X, Y, N

    def command(self, commands: Mapping[str, float]) -> None:
        """Set the commands that the actuators run, from now on."""
        if commands != self._commands:
            self._commands = dict(commands)
            self.actuators.command(self._commands, self._now_ns)

    def advance(self, now_ns: int) -> None:
        """Let the world go on to now, with the commands as they are."""
        if not 0 <= now_ns - self._now_ns <= LONGEST_GAP_NS:
            self._now_ns = self._gust_ns = now_ns
            self.actuators.hurry()
        while self._now_ns < now_ns:
            step_ns = min(now_ns - self._now_ns, LONGEST_STEP_NS)
            arrival_ns = self.actuators.next_ns()
            if arrival_ns is not None and arrival_ns > self._now_ns:
                step_ns = min(step_ns, arrival_ns - self._now_ns)
            self._step(step_ns)
        while self._changing and self._gust_ns + _GUST_NS <= now_ns:
            self._gust_ns += _GUST_NS
            self._drift.step()
            self._gusts.step()

    def displace(self, x_m: float, y_m: float, psi_rad: float) -> None:
        """Move the vessel at once, as a hand does; the walls hold."""
        x, y, psi, u, v, r = self.state
        self.state = self._within_walls((x + x_m, y + y_m, wrap_angle(psi + psi_rad), u, v, r))

    def _step(self, step_ns: int) -> None:
        dt_s = step_ns * 1e-9
        x, y, psi, u, v, _ = self.state
        water, moved = self.current_m_s, (0.0, 0.0)
        if self._waves is not None:
            orbit, moved = self._waves.water(x, y, (self._now_ns + 0.5 * step_ns) * 1e-9, max(0.0, self.upright[0]))
            water = (water[0] + orbit[0], water[1] + orbit[1])
        actuators = self.actuators
        U = relative_speed(u, v, psi, water) if actuators.feel_flow else 0.0
        actuators.advance(self._now_ns, dt_s, U)
        tau = actuators.wrench if self._quiet else self._pushed(actuators.wrench, moved)
        n_squared = actuators.n_squared
        level, upright = self._plant.step(self.state, self.upright, dt_s, tau, water, n_squared=n_squared)
        x, y, psi, u, v, r = level
        self.state = self._within_walls((x, y, wrap_angle(psi), u, v, r))
        if upright is not self.upright:
            self.upright = self._within_water(upright)
        self._now_ns += step_ns

    def _pushed(self, tau: Wrench, water_m_s2: tuple[float, float]) -> Wrench:
        """Return the actuators' wrench with what the surroundings add, in {B}.

        Accelerated water pushes a hull with the inertia that the hull has in it, added mass included (Froude-Krylov and
        diffraction of a body small against the waves): a vessel without drag goes along with it.
        """
        x, y, psi, u, v, _ = self.state
        X, Y, Z, K, M, N = (a + b for a, b in zip(tau, self._vessel.bias, strict=True))
        if self._vessel.tether is not None:
            pull = tether_wrench(self._vessel.tether, x, y, psi)
            X, Y, N = X + pull[0], Y + pull[1], N + pull[2]
        if self._wind.drag_area_m2:
            blow = wind_wrench(self._wind, self.wind_m_s, psi, u, v)
            X, Y, N = X + blow[0], Y + blow[1], N + blow[2]
        a_x, a_y = to_body(*water_m_s2, psi)
        return X + self._masses[0] * a_x, Y + self._masses[1] * a_y, Z, K, M, N

    def _within_walls(self, state: State) -> State:
        """Stop the part of the velocity that goes into a wall: an inelastic, frictionless contact of a round hull."""
        x, y, psi, u, v, r = state
        least_x, most_x, least_y, most_y = self._walls
        if least_x <= x <= most_x and least_y <= y <= most_y:
            return state
        inside_x = min(max(x, least_x), most_x)
        inside_y = min(max(y, least_y), most_y)
        x_rate, y_rate = to_tank(u, v, psi)
        if (inside_x - x) * x_rate < 0.0:
            x_rate = 0.0
        if (inside_y - y) * y_rate < 0.0:
            y_rate = 0.0
        return (inside_x, inside_y, psi, *to_body(x_rate, y_rate, psi), r)

    def _within_water(self, upright: State) -> State:
        """Stop what dives at the surface and at the bottom."""
        z, phi, theta, w, p, q = upright
        inside = min(max(z, 0.0), self._depth_m)
        w = 0.0 if (inside - z) * w < 0.0 else w
        return inside, wrap_angle(phi), wrap_angle(theta), w, p, q


def _masses(vessel: Vessel) -> tuple[float, float]:
    """Return inertia in surge and sway with added mass, in kg; an ASV's model has none: the water carries it."""
    if isinstance(vessel.dynamics, AsvModel):
        return 0.0, 0.0
    return vessel.model.surge.alpha, vessel.model.sway.alpha
