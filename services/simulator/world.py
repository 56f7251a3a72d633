"""The world outside the bus: the vessel in its pool, pushed by thrusters and current. No clock, no file, no bus."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass

from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import Tau, UncoupledModel
from marine.frames import to_body, to_tank, wrap_angle
from marine.vessel import Vessel

LONGEST_STEP_NS = 20_000_000
"""The quickest motion takes seconds: one Runge-Kutta step of 20 ms errs by less than 1 nm."""
LONGEST_GAP_NS = 500_000_000
_GUST_NS = 100_000_000
"""The varying current changes every 0.1 s: often against its correlation time, seldom against the vessel."""


@dataclass(frozen=True)
class Current:
    """Current in {E}: a constant, and on each axis a first-order Gauss-Markov process."""

    x_m_s: float = 0.0
    y_m_s: float = 0.0
    std_m_s: float = 0.0
    correlation_s: float = 30.0


class World:
    """The true state. The same commands at the same times give the same bits.

    A pause of more than 0.5 s (the process was stopped) stops the world's time, too.
    """

    def __init__(self, vessel: Vessel, current: Current, seed: int, state: State, now_ns: int) -> None:
        self.state = state
        self.constant_current_m_s = (current.x_m_s, current.y_m_s)
        self.varying_current_m_s = (0.0, 0.0)
        self.dead: frozenset[str] = frozenset()
        """Thrusters that give no thrust whatever their command."""
        self.tau: Tau = (0.0, 0.0, 0.0)
        self._vessel = vessel
        self._model = UncoupledModel(vessel.model)
        self._random = random.Random(seed)
        self._now_ns = now_ns
        self._gust_ns = now_ns
        self._fading = math.exp(-_GUST_NS * 1e-9 / current.correlation_s)
        self._gust_m_s = current.std_m_s * math.sqrt(1.0 - self._fading**2)
        self._commands: dict[str, float] = {}
        self._columns = [
            (t.name, t.k_t, math.cos(t.angle_rad), math.sin(t.angle_rad), _lever_m(t.x_m, t.y_m, t.angle_rad))
            for t in vessel.thrusters
        ]

    @property
    def current_m_s(self) -> tuple[float, float]:
        """The current at the vessel in {E}."""
        return (
            self.constant_current_m_s[0] + self.varying_current_m_s[0],
            self.constant_current_m_s[1] + self.varying_current_m_s[1],
        )

    def command(self, commands: Mapping[str, float]) -> None:
        """Set the commands that the thrusters run, pladypos (1): K_T |n| n along each thruster's axis."""
        if commands == self._commands:
            return
        self._commands = dict(commands)
        self._apply()

    def kill(self, thrusters: frozenset[str]) -> None:
        """Let these thrusters be dead, and no others."""
        self.dead = thrusters
        self._apply()

    def _apply(self) -> None:
        X = Y = N = 0.0
        for name, k_t, c, s, lever in self._columns:
            n = self._commands.get(name, 0.0)
            thrust = 0.0 if name in self.dead else k_t * abs(n) * n
            X, Y, N = X + c * thrust, Y + s * thrust, N + lever * thrust
        self.tau = (X, Y, N)

    def advance(self, now_ns: int) -> None:
        """Let the world go on to now, with the commands as they are."""
        if not 0 <= now_ns - self._now_ns <= LONGEST_GAP_NS:
            self._now_ns = self._gust_ns = now_ns
        while self._now_ns < now_ns:
            step_ns = min(now_ns - self._now_ns, LONGEST_STEP_NS)
            x, y, psi, u, v, r = self._model.step(self.state, step_ns * 1e-9, self.tau, self.current_m_s)
            self.state = self._within_walls((x, y, wrap_angle(psi), u, v, r))
            self._now_ns += step_ns
        while self._gust_m_s and self._gust_ns + _GUST_NS <= now_ns:
            self._gust_ns += _GUST_NS
            self._blow()

    def displace(self, x_m: float, y_m: float, psi_rad: float) -> None:
        """Move the vessel at once, as a hand does; the walls hold."""
        x, y, psi, u, v, r = self.state
        self.state = self._within_walls((x + x_m, y + y_m, wrap_angle(psi + psi_rad), u, v, r))

    def _within_walls(self, state: State) -> State:
        """Stop the part of the velocity that goes into a wall: an inelastic, frictionless contact of a round hull."""
        x, y, psi, u, v, r = state
        radius, pool = self._vessel.radius_m, self._vessel.pool
        inside_x = min(max(x, radius), pool.length_x_m - radius)
        inside_y = min(max(y, radius), pool.length_y_m - radius)
        if inside_x == x and inside_y == y:
            return state
        x_rate, y_rate = to_tank(u, v, psi)
        if (inside_x - x) * x_rate < 0.0:
            x_rate = 0.0
        if (inside_y - y) * y_rate < 0.0:
            y_rate = 0.0
        return (inside_x, inside_y, psi, *to_body(x_rate, y_rate, psi), r)

    def _blow(self) -> None:
        gust, fading = self._random.gauss, self._fading
        x, y = self.varying_current_m_s
        self.varying_current_m_s = (
            fading * x + gust(0.0, self._gust_m_s),
            fading * y + gust(0.0, self._gust_m_s),
        )


def _lever_m(x_m: float, y_m: float, angle_rad: float) -> float:
    return x_m * math.sin(angle_rad) - y_m * math.cos(angle_rad)
