"""What the actuators gave and when: the wrenches that were delivered, each in force until the next or for a while."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from bus.clock import NS
from marine.dynamics.uncoupled import Tau

WRENCH_HOLD_NS = 350_000_000
"""Without a new command the platform stops its thrusters: a delivered wrench counts no longer than this."""
LONGEST_STEP_NS = 50_000_000
"""A filter predicts no further in one step."""
_NO_WRENCH: Tau = (0.0, 0.0, 0.0)


class Wrenches:
    """The last 64 of them: [X Y N] in N and Nm, with their times."""

    def __init__(self) -> None:
        self._wrenches: deque[tuple[int, Tau]] = deque(maxlen=64)

    def add(self, stamp_ns: int, tau: Tau) -> None:
        """Take in the newest."""
        self._wrenches.append((stamp_ns, tau))

    def clear(self) -> None:
        """Forget all."""
        self._wrenches.clear()

    def forget_before(self, stamp_ns: int) -> None:
        """Forget what was no longer in force at a time."""
        while len(self._wrenches) > 1 and self._wrenches[1][0] <= stamp_ns:
            self._wrenches.popleft()

    def at(self, at_ns: int) -> tuple[Tau, int]:
        """Return the wrench in force at a time, and when it ends."""
        tau, until_ns, next_ns = _NO_WRENCH, 0, 2**63
        for stamp_ns, delivered in self._wrenches:
            if stamp_ns > at_ns:
                next_ns = stamp_ns
                break
            tau, until_ns = delivered, stamp_ns + WRENCH_HOLD_NS
        return (tau, min(until_ns, next_ns)) if at_ns < until_ns else (_NO_WRENCH, next_ns)

    def between(self, from_ns: int, to_ns: int) -> Iterator[tuple[float, Tau]]:
        """Yield the steps in which a filter predicts from one time to another: their length in s, and the wrench."""
        at_ns = from_ns
        while at_ns < to_ns:
            tau, until_ns = self.at(at_ns)
            next_ns = min(until_ns, to_ns, at_ns + LONGEST_STEP_NS)
            yield (next_ns - at_ns) / NS, tau
            at_ns = next_ns
