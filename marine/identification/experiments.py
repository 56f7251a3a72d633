"""Identification experiments as pure state machines: motion of one axis in, force on it out.

Step and pull-out (pladypos 5, thesis 4.3, 4.4), zig-zag (4.4), self-oscillation (chapter 6, monitored as in Fig. 6.11),
PRBS for least squares. All end by themselves: at a wall's braking distance, when their time is over, or when they have
what they need; then they brake. `eta` is the position along the axis or the unwrapped heading, from the start.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import inf, log, log1p, sqrt
from typing import Literal

from marine.identification.monitor import OscillationMonitor
from marine.identification.prediction import oscillation
from marine.vessel import DegreeOfFreedom

Kind = Literal["step", "zigzag", "self-oscillation", "pull-out", "prbs"]

_BRAKE_S = 0.5
"""Braking force is alpha nu over this time, within the limit: it fades as the vessel comes to rest."""
_AT_REST = 0.02
"""m/s, or rad/s: slower than this is at rest."""
_SETTLED = 5.0
"""A response is settled after so many times the time in which it came to 76 %: then 1 - tanh 5 < 0.01 % is left."""
_LONGEST_S = 180.0
_GUARD_LINGERS_S = 1.0
"""What a guard did before the experiment is told for so long."""
_PRBS_BITS = 127
_LAST_SWITCH_S = 0.3
_COAST_M = 2.0
"""A pull-out lets go at the latest so far from the wall: room for the decay."""
_HYSTERESIS_RAD, _HYSTERESIS_M = 0.35, 0.10


class ExperimentError(ValueError):
    """The experiment cannot be made like this; the message says why and what to change."""


@dataclass(frozen=True)
class Motion:
    """One axis at one time: eta in m or rad from the start, nu; room to the walls ahead and behind in m.

    stopped: why the force is no longer the one that is asked for, as by a guard before the walls; empty: it is.
    """

    t_s: float
    eta: float
    nu: float
    ahead_m: float = inf
    behind_m: float = inf
    stopped: str = ""


@dataclass(frozen=True)
class Setup:
    """What an experiment needs: C (N, Nm), first direction, switching distance x_a (m, rad), count, longest time.

    limit: largest force of the actuators; dof: the model known so far, for braking and bit length only.
    """

    C: float
    direction: int
    x_a: float
    count: int
    longest_s: float
    limit: float
    dof: DegreeOfFreedom


def braking_distance(dof: DegreeOfFreedom, nu: float, force: float) -> float:
    """Return the way to a stop from speed nu (m/s) under a full reverse force (N), with quadratic drag, in m.

    alpha/(2 beta) ln(1 + beta nu^2/F), from alpha nu dnu/ds = -(F + beta nu^2).
    """
    if dof.beta_quadratic == 0.0:
        return 0.5 * dof.alpha * nu**2 / force
    return 0.5 * dof.alpha / dof.beta_quadratic * log1p(dof.beta_quadratic * nu**2 / force)


def design(
    kind: Kind,
    amplitude: float,
    direction: int,
    dof: DegreeOfFreedom,
    limit: float,
    *,
    angular: bool,
    hysteresis: float | None = None,
    count: int = 5,
    longest_s: float | None = None,
    room_m: tuple[float, float] = (inf, inf),
) -> Experiment:
    """Return an experiment; raise ExperimentError when the known model says that it cannot work.

    amplitude: part of `limit` (N, Nm); hysteresis: m or rad; room_m: free way ahead and behind the vessel.
    """
    if limit <= 0.0:
        raise ExperimentError("no actuator acts on this axis")
    C = amplitude * limit
    x_a = hysteresis or (_HYSTERESIS_RAD if angular else _HYSTERESIS_M)
    setup = Setup(C, direction, x_a, count, longest_s or _LONGEST_S, limit, dof)
    if kind in ("zigzag", "self-oscillation"):
        _check_relay(setup, min(room_m))
        return Relay(setup) if kind == "zigzag" else SelfOscillation(setup)
    way = room_m[0] if direction > 0 else room_m[1]
    if kind in ("step", "pull-out") and way < _least_way(setup):
        raise ExperimentError(
            f"only {way:.2f} m of free way in this direction, {_least_way(setup):.2f} m are needed: start at the other "
            "end, or push the other way"
        )
    return {"step": Step, "pull-out": PullOut, "prbs": Prbs}[kind](setup)


def _check_relay(setup: Setup, room_m: float) -> None:
    expected = oscillation(setup.dof, setup.C, setup.x_a)
    if expected.X_m is None or expected.omega is None:
        raise ExperimentError(f"{expected.reason}: choose a larger amplitude or a smaller hysteresis")
    if 1.3 * expected.X_m > room_m:
        raise ExperimentError(
            f"the vessel would swing by {expected.X_m:.2f} m and has {room_m:.2f} m to the wall: start in the middle, "
            "or choose a smaller hysteresis"
        )
    needed_s = (setup.count + 1.5) * 6.2832 / expected.omega
    if needed_s > setup.longest_s:
        raise ExperimentError(
            f"{setup.count} oscillations would take some {needed_s:.0f} s of {setup.longest_s:.0f} s: choose a smaller "
            "hysteresis, a larger amplitude or more time"
        )


def _least_way(setup: Setup) -> float:
    """Return the way in m to 95 % of the final speed and the braking from there; it does not depend on the force."""
    dof = setup.dof
    if dof.beta_quadratic == 0.0:
        return 0.5
    return dof.alpha / dof.beta_quadratic * -0.5 * log(1.0 - 0.95**2) + 0.1


class Experiment(ABC):
    """Common part: guards, braking, when the measurement began and ended (s of the caller's clock)."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.phase = "push"
        self.began_s: float | None = None
        self.ended_s: float | None = None
        self.force = 0.0
        self.failure = ""
        self.note = ""
        """Why it ended early, where the record is good all the same."""

    @property
    @abstractmethod
    def progress(self) -> float:
        """Part of the work that is done, 0 to 1."""

    @property
    def advice(self) -> str:
        """What to change when it does not work."""
        return ""

    @property
    def used_from_s(self) -> float:
        """From when on the record is good for identification, s of the caller's clock."""
        return self.began_s or 0.0

    @abstractmethod
    def push(self, m: Motion, elapsed_s: float) -> float | None:
        """Return the force now, None when the measurement is complete."""

    def at_wall(self, wall: str) -> None:
        """Take note that the measurement ends at a wall's braking distance: a failure unless overridden."""
        self.failure = f"{wall}: start further from it, or with a smaller amplitude"

    def time_over(self) -> None:
        """Take note that the longest duration is over."""
        self.note = f"ended after {self.setup.longest_s:.0f} s"

    def step(self, m: Motion) -> float | None:
        """Return the force (N, Nm) until the next call, None when the vessel has braked and all is over."""
        if self.began_s is None:
            self.began_s = m.t_s
        if self.ended_s is None:
            force = self._guarded(m, m.t_s - self.began_s)
            if force is not None:
                self.force = force
                return force
            self.ended_s, self.phase = m.t_s, "brake"
        if abs(m.nu) < _AT_REST or m.t_s - self.ended_s > 20.0:
            return None
        wanted = -self.setup.dof.alpha * m.nu / _BRAKE_S
        self.force = max(-self.setup.limit, min(self.setup.limit, wanted))
        return self.force

    def _guarded(self, m: Motion, elapsed_s: float) -> float | None:
        way = m.ahead_m if m.nu > 0.0 else m.behind_m
        if abs(m.nu) > _AT_REST and way <= braking_distance(self.setup.dof, m.nu, self.setup.limit) * 1.2 + 0.05:
            self.at_wall(f"the wall was {max(way, 0.0):.2f} m away")
            return None
        if m.stopped and elapsed_s > _GUARD_LINGERS_S:
            self.at_wall(f"the guard braked {m.stopped}")
            return None
        if elapsed_s > self.setup.longest_s:
            self.time_over()
            return None
        return self.push(m, elapsed_s)


class Step(Experiment):
    """A constant force from rest until the speed has settled, or the wall is near."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._speeds: list[tuple[float, float]] = []
        self._settled_at_s = inf

    @property
    def progress(self) -> float:
        """Time against the time at which the response will have settled, as seen by now."""
        last = self._speeds[-1][0] if self._speeds else 0.0
        return min(1.0, last / min(self._settled_at_s, self.setup.longest_s))

    def at_wall(self, wall: str) -> None:
        """A step that ends at the wall is good: the fit says how near to its steady state it came."""
        self.note = wall

    def settled(self, m: Motion, elapsed_s: float) -> bool:
        """Whether the speed has come to its end, without any model."""
        self._speeds.append((elapsed_s, m.nu * self.setup.direction))
        level = 0.76 * max(nu for _, nu in self._speeds)
        reached_s = next((t for t, nu in self._speeds if nu >= level), 0.0)
        self._settled_at_s = _SETTLED * max(reached_s, 0.5)
        return level > _AT_REST and elapsed_s >= self._settled_at_s

    def push(self, m: Motion, elapsed_s: float) -> float | None:
        """Return the constant force."""
        return None if self.settled(m, elapsed_s) else self.setup.direction * self.setup.C


class PullOut(Step):
    """A step, then no force until the motion has died down: the decay shows drag against inertia, thesis 4.4."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._top = 0.0
        self._coasting_s: float | None = None

    def push(self, m: Motion, elapsed_s: float) -> float | None:
        """Return the force, then zero."""
        if self._coasting_s is None:
            room_m = m.ahead_m if self.setup.direction > 0 else m.behind_m
            if not self.settled(m, elapsed_s) and room_m > _COAST_M:
                return self.setup.direction * self.setup.C
            self._coasting_s, self._top, self.phase = elapsed_s, abs(m.nu), "coast"
        decayed = abs(m.nu) < max(0.15 * self._top, _AT_REST)
        return None if decayed and elapsed_s > self._coasting_s + 1.0 else 0.0


class Prbs(Experiment):
    """A pseudo-random binary force (7-bit shift register), turned back where it carries the vessel too far."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self.phase = "prbs"
        self._bit_s = max(0.5, 0.5 * sqrt(setup.x_a * setup.dof.alpha / setup.C))
        self._register = 0x5A
        self._bit = -1
        self._sign = setup.direction
        self._elapsed_s = 0.0

    @property
    def _length_s(self) -> float:
        return min(_PRBS_BITS * self._bit_s, self.setup.longest_s)

    @property
    def progress(self) -> float:
        """Part of the sequence."""
        return min(1.0, self._elapsed_s / self._length_s)

    def push(self, m: Motion, elapsed_s: float) -> float | None:
        """Return +-C."""
        self._elapsed_s = elapsed_s
        if elapsed_s >= self._length_s:
            return None
        bit = int(elapsed_s / self._bit_s)
        if bit != self._bit:
            self._bit = bit
            new = (self._register ^ self._register >> 1) & 1  # x^7 + x^6 + 1
            self._register = self._register >> 1 | new << 6
            self._sign = 1 if new else -1
        if abs(m.eta) > 4.0 * self.setup.x_a:
            self._sign = -1 if m.eta > 0.0 else 1
        return self._sign * self.setup.C


class Relay(Experiment):
    """Zig-zag: the force reverses whenever the vessel is x_a away from the start, for `count` whole turns."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self.phase = "relay"
        self.monitor = OscillationMonitor(setup.x_a, setup.count)
        self._sign = setup.direction
        self._complete_s: float | None = None

    @property
    def progress(self) -> float:
        """Oscillations of those that are needed."""
        return min(1.0, self.monitor.whole / (self.setup.count + 1))

    @property
    def complete(self) -> bool:
        """Whether there are enough turns."""
        return self.monitor.whole > self.setup.count

    def push(self, m: Motion, elapsed_s: float) -> float | None:
        """Return +-C."""
        self.monitor.follow(m.eta)
        if self._sign * m.eta >= self.setup.x_a:
            self._sign = -self._sign
            self.monitor.switched(m.t_s, -self._sign)
            if self.complete and self._complete_s is None:
                self._complete_s = elapsed_s
        if self._complete_s is not None and elapsed_s - self._complete_s > _LAST_SWITCH_S:
            return None  # the record shows the last reversal, too
        return self._sign * self.setup.C

    def time_over(self) -> None:
        """Without its turns the record is worth nothing."""
        self.failure = f"no {self.setup.count} oscillations in {self.setup.longest_s:.0f} s: {self.advice}"

    @property
    def advice(self) -> str:
        """What to change."""
        if not self.monitor.halves:
            return "the vessel has not reached the switching point yet; if it never does, choose a larger amplitude"
        return self.monitor.advice


class SelfOscillation(Relay):
    """Relay with hysteresis until `count` consecutive oscillations agree: the monitoring subsystem of Fig. 6.11."""

    @property
    def progress(self) -> float:
        """Consecutive oscillations of those that are needed."""
        return min(1.0, self.monitor.consecutive / self.setup.count)

    @property
    def complete(self) -> bool:
        """Whether the last oscillations agree."""
        return self.monitor.consecutive >= self.setup.count

    @property
    def used_from_s(self) -> float:
        """A quarter of a period before the oscillations that agree."""
        end_s, swings = self.ended_s or 0.0, self.monitor.swings
        return end_s - sum(s.period_s for s in swings) - 0.25 * swings[-1].period_s if swings else super().used_from_s
