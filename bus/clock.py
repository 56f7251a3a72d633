"""Clocks. Services never read one: the loop hands them the time."""

from __future__ import annotations

import time
from typing import Protocol

NS = 1_000_000_000


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
