"""Clocks. Services never read one: the loop hands them the time."""

from __future__ import annotations

import json
import time
from collections import deque
from dataclasses import dataclass
from typing import Protocol

NS = 1_000_000_000

_MEASUREMENTS = 8
"""Of so many measurements of the offset the one with the shortest round trip counts."""


class Clock(Protocol):
    """A source of UNIX time in ns."""

    def now_ns(self) -> int:
        """Return the time in ns."""
        ...


class SystemClock:
    """The machine's clock."""

    def now_ns(self) -> int:
        """Return the time in ns since 1970."""
        return time.time_ns()


@dataclass(frozen=True)
class Warp:
    """How time runs in a star: from the epoch on `factor` times as fast. One for all processes: the hub tells it."""

    factor: float = 1.0
    epoch_ns: int = 0

    def of(self, real_ns: int) -> int:
        """Return the star's time at a real time (only what has passed since the epoch is multiplied)."""
        if self.factor == 1.0:
            return real_ns
        return self.epoch_ns + round(self.factor * (real_ns - self.epoch_ns))


class StarClock:
    """The star's time in one process: this machine's clock, set by the hub's, and warped as the hub says."""

    def __init__(self, machine: Clock | None = None) -> None:
        self._machine = machine or SystemClock()
        self._measured: deque[tuple[int, int]] = deque(maxlen=_MEASUREMENTS)
        self.warp = Warp()
        self.offset_ns = 0
        """What is added to this machine's clock; 0 as long as the measurement does not tell it from 0."""
        self.uncertainty_ns: int | None = None
        """Half the shortest round trip; None before the first measurement."""

    def now_ns(self) -> int:
        """Return the star's time."""
        return self.warp.of(self.real_ns())

    def real_ns(self) -> int:
        """Return the hub's clock, as well as is known."""
        return self._machine.now_ns() + self.offset_ns

    def machine_ns(self) -> int:
        """Return this machine's own clock: for measurements."""
        return self._machine.now_ns()

    def forget(self) -> None:
        """Begin anew, at another hub."""
        self._measured.clear()
        self.warp, self.offset_ns, self.uncertainty_ns = Warp(), 0, None

    def tell(self) -> bytes:
        """Return what a hub answers when it is asked for the time."""
        told = {"real_ns": self.real_ns(), "factor": self.warp.factor, "epoch_ns": self.warp.epoch_ns}
        return json.dumps(told).encode()

    def hear(self, asked_ns: int, told: bytes, heard_ns: int) -> None:
        """Take over a hub's answer; asked_ns, heard_ns: this machine's clock. Raises ValueError for nonsense.

        As in NTP the hub's reading belongs to the middle of the round trip: the error is at most half of that.
        """
        try:
            answer = json.loads(told)
            real_ns, factor, epoch_ns = int(answer["real_ns"]), float(answer["factor"]), int(answer["epoch_ns"])
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"not a hub's time: {error}") from None
        if not (0 < factor < 1e6 and heard_ns >= asked_ns):
            raise ValueError("not a hub's time")
        self.warp = Warp(factor, epoch_ns)
        self._measured.append((heard_ns - asked_ns, real_ns - (asked_ns + heard_ns) // 2))
        round_trip_ns, offset_ns = min(self._measured)
        self.uncertainty_ns = (round_trip_ns + 1) // 2
        self.offset_ns = offset_ns if abs(offset_ns) > self.uncertainty_ns else 0


CLOCK = StarClock()
"""The clock of this process; its bus sets it."""


class SimulatedClock:
    """A clock that a test or `MemoryBus` moves."""

    def __init__(self, start_ns: int = 1_000 * NS) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the simulated time in ns."""
        return self._now_ns

    def advance_to(self, now_ns: int) -> None:
        """Move forward; raise ValueError for a step back."""
        if now_ns < self._now_ns:
            raise ValueError(f"time runs forward only: {now_ns} < {self._now_ns}")
        self._now_ns = now_ns
