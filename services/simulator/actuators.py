"""The vessel's actuators as they answer commands: delay, rate, lag, dead zone, failure; thesis 2.1, 3.1."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from marine.actuators import Drive, lagged
from marine.actuators.rudder import linear_force
from marine.allocation import Wrench, allocation_matrix
from marine.allocation.of_vessel import rudder_column
from marine.dynamics.small_vessel import mean_square
from marine.vessel import BilinearThrust, Rudder, SmallVesselModel, Thruster, Vessel


@dataclass(frozen=True)
class Failure:
    """What is wrong with an actuator: the part of its force that it keeps, and where it sticks, if it does."""

    kept: float = 1.0
    stuck_at: float | None = None


DEAD = Failure(kept=0.0)
NO_WRENCH: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_SETTLED = 1e-9


class Actuators:
    """Commands in, the wrench [X Y Z K M N] in {B} out.

    A rudder's force is thesis (2.12), as the allocator takes it: the vessel files keep it below the stall angle.
    """

    def __init__(self, vessel: Vessel) -> None:
        self.failures: Mapping[str, Failure] = {}
        """Actuators that do not do what they are told."""
        self.values = {a.name: 0.0 for a in vessel.actuators}
        """Where each actuator is, in the unit of its command."""
        self.wrench = NO_WRENCH
        self.n_squared = 0.0
        """Mean square of the thrusters' commands as they turn: the setting n^2 of thesis (2.38), for models of that."""
        self._targets = dict(self.values)
        columns = [tuple(column) for column in allocation_matrix(vessel.actuators).T.tolist()]
        self._parts = [
            (a.name, a if isinstance(a, Rudder) else Drive(a), column)
            for a, column in zip(vessel.actuators, columns, strict=True)
        ]
        self._limits = {a.name: (a.lowest, a.n_max) for a in vessel.actuators}
        feel_setting = isinstance(vessel.dynamics, SmallVesselModel)
        self._thrusters = [a.name for a in vessel.actuators if feel_setting and isinstance(a, Thruster)]
        self._slow = [a for a in vessel.actuators if a.lag_s > 0.0 or a.rate_per_s is not None]
        self.feel_flow = any(
            (isinstance(a, Rudder) and a.k_r1 > 0.0)
            or (isinstance(a, Thruster) and isinstance(a.characteristic, BilinearThrust))
            for a in vessel.actuators
        )
        """Whether the wrench depends on the vessel's speed through water."""
        self._delay_ns = round(vessel.command_delay_s * 1e9)
        self._under_way: deque[tuple[int, dict[str, float]]] = deque()
        self._moving = False
        self._U = 0.0

    def command(self, commands: Mapping[str, float], now_ns: int) -> None:
        """Take new commands; they reach the actuators after the delay, at once where there is none."""
        if self._delay_ns:
            if not self._under_way or self._under_way[-1][1] != commands:
                self._under_way.append((now_ns + self._delay_ns, dict(commands)))
        else:
            self._aim(commands)

    def fail(self, failures: Mapping[str, Failure]) -> None:
        """Let these have failed, and no others."""
        self.failures = dict(failures)
        self._push()

    def hurry(self) -> None:
        """Let the last command under way arrive at once: the clock has jumped, its time means nothing now."""
        if self._under_way:
            commands = self._under_way[-1][1]
            self._under_way.clear()
            self._aim(commands)

    def next_ns(self) -> int | None:
        """Return when the next delayed command arrives, None when none is under way."""
        return self._under_way[0][0] if self._under_way else None

    def advance(self, now_ns: int, dt_s: float, U: float) -> None:
        """Go on by dt_s to now at the vessel's speed U through water, in m/s."""
        while self._under_way and self._under_way[0][0] <= now_ns:
            self._aim(self._under_way.popleft()[1])
        if self._moving:
            self._move(dt_s)
        elif not (self.feel_flow and U != self._U):
            return
        self._U = U
        self._push()

    def _aim(self, commands: Mapping[str, float]) -> None:
        targets = {}
        for name, (lowest, highest) in self._limits.items():
            value = commands.get(name, 0.0)
            targets[name] = lowest if value <= lowest else highest if value >= highest else value
        if targets == self._targets:
            return
        self._targets = targets
        if self._slow:
            self._moving = True
            slow = {a.name for a in self._slow}
            self.values = {n: self.values[n] if n in slow else target for n, target in targets.items()}
        else:
            self.values = targets
        self._push()

    def _move(self, dt_s: float) -> None:
        self._moving = False
        values = dict(self.values)
        for actuator in self._slow:
            name = actuator.name
            before, target = values[name], self._targets[name]
            after = lagged(before, target, dt_s, actuator.lag_s)
            if actuator.rate_per_s is not None:
                reach = actuator.rate_per_s * dt_s
                after = max(before - reach, min(before + reach, after))
            if abs(after - target) < _SETTLED * max(1.0, abs(target)):
                after = target
            self._moving = self._moving or after != target
            values[name] = after
        self.values = values

    def _push(self) -> None:
        X = Y = Z = K = M = N = 0.0
        values, failed = self.values, bool(self.failures)
        for name, drive, fixed in self._parts:
            value, kept = self._acts(name) if failed else (values[name], 1.0)
            if isinstance(drive, Rudder):
                wash, kept_behind = self._acts(drive.behind)
                wash = max(0.0, wash) * math.sqrt(kept_behind)  # thrust goes with its square
                force = linear_force(value, wash, self._U, drive.k_r1, drive.k_r2)
                column = rudder_column(drive, value)
            else:
                column = fixed
                force = (drive.at(self._U) if self.feel_flow else drive).thrust(value)
            force *= kept
            x, y, z, k, m, n = column
            X, Y, Z = X + x * force, Y + y * force, Z + z * force
            K, M, N = K + k * force, M + m * force, N + n * force
        self.wrench = (X, Y, Z, K, M, N)
        if self._thrusters:
            acting = [self._acts(name) for name in self._thrusters]
            self.n_squared = mean_square([value * math.sqrt(kept) for value, kept in acting])

    def _acts(self, name: str) -> tuple[float, float]:
        """Return where an actuator is, and the part of its force that it keeps."""
        failure = self.failures.get(name)
        if failure is None:
            return self.values[name], 1.0
        return (self.values[name] if failure.stuck_at is None else failure.stuck_at), failure.kept


def relative_speed(u: float, v: float, psi_rad: float, water_m_s: tuple[float, float]) -> float:
    """Return U in m/s through water that moves in {E}; u, v in {B}."""
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return math.hypot(u - c * water_m_s[0] - s * water_m_s[1], v + s * water_m_s[0] - c * water_m_s[1])
