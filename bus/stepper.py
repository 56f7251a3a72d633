"""One service between two waits: fill inputs, step, heartbeat, statistics. The same live and in memory."""

from __future__ import annotations

import os
from collections.abc import Callable

from bus.clock import NS, StarClock
from bus.messages import Heartbeat
from bus.service import Moment, Output, Send, Service
from bus.topics import HEARTBEAT

HEARTBEAT_NS = NS


class Stepper:
    """Steps a service and tells how it fares.

    `timer` gives seconds for the step times of the heartbeat; without one they are zero: `MemoryBus` is deterministic.
    """

    def __init__(
        self, service: Service, send: Send, timer: Callable[[], float] | None = None, clock: StarClock | None = None
    ) -> None:
        self.service = service
        self.period_ns = round(NS / service.rate_hz)
        self.due_ns = 0
        self._timer = timer
        self._clock = clock
        self._moment = Moment(source=service.name)
        self._inputs = service.inputs
        self._raw_inputs = service.raw_inputs
        waking = [port for port in self._inputs if port.wakes]
        self.choosy = [port for port in waking if port.min_interval_ns or port.changed_only]
        """Inputs that wake, but not at once or not always."""
        self._eager = [port for port in waking if port not in self.choosy]
        self._heartbeat = Output(HEARTBEAT.of(service.name))
        for output in [*service.outputs, self._heartbeat]:
            output.bind(self._moment, send)
        self._steps = 0
        self._late = 0
        self._busy_s = 0.0
        self._longest_s = 0.0
        self._beat_ns = 0
        self._told: dict[str, int] = {}
        self._note = ""

    def start(self, now_ns: int) -> None:
        """Start the service; its first step is due at once."""
        self._moment.now_ns = now_ns
        self.due_ns = now_ns
        self._beat_ns = now_ns
        self.service.start(now_ns / NS)
        self._beat("starting", now_ns)

    def step(self, now_ns: int) -> None:
        """Run one step and set when the next is due."""
        self._moment.now_ns = now_ns
        for port in self._inputs:
            if port.idle:
                continue
            port.refresh(now_ns)
            if port.problem:
                self._tell_problem(port.topic.key, port.problem)
                port.problem = ""
        if self._timer is None:
            self.service.step(now_ns / NS)
        else:
            begin_s = self._timer()
            self.service.step(now_ns / NS)
            spent_s = self._timer() - begin_s
            self._busy_s += spent_s
            self._longest_s = max(self._longest_s, spent_s)
        self._steps += 1
        if now_ns < self.due_ns:  # woken by an input
            self.due_ns = now_ns + self.period_ns
        else:
            self._keep_pace(now_ns)
        if now_ns - self._beat_ns >= HEARTBEAT_NS:
            self._beat("running", now_ns)

    def woken(self, now_ns: int) -> bool:
        """Whether a wake means a step now, or only one later (`next_ns`), or none: nothing has changed."""
        if not self.choosy:
            return True
        if any(port.due_ns(now_ns) for port in self._eager) or any(raw.waits for raw in self._raw_inputs):
            return True
        return self.next_ns(now_ns) <= now_ns

    def next_ns(self, now_ns: int) -> int:
        """Return when the next step is due: after the period, or before that for an input whose interval is over."""
        offered = [at for port in self.choosy if not port.idle and (at := port.due_ns(now_ns)) is not None]
        return min([self.due_ns, *offered])

    def _keep_pace(self, now_ns: int) -> None:
        if now_ns - self.due_ns > self.period_ns:
            self._late += 1
        self.due_ns += self.period_ns
        if self.due_ns <= now_ns:
            self.due_ns = now_ns + self.period_ns

    def _tell_problem(self, key: str, problem: str) -> None:
        """Say a recurring problem once in the log; the heartbeat counts the rest."""
        self._note = problem
        self._told[key] = self._told.get(key, 0) + 1
        if self._told[key] == 1:
            self.service.log.warning("%s (further ones are counted in the heartbeat)", problem)

    def stop(self, now_ns: int) -> None:
        """Bring the service into its safe state."""
        self._moment.now_ns = now_ns
        try:
            self.service.stop(now_ns / NS)
        finally:
            self._beat("stopping", now_ns)

    def _beat(self, state: str, now_ns: int) -> None:
        seconds = (now_ns - self._beat_ns) / NS
        warp = self.service.warp
        kept = self._steps / (seconds * self.service.rate_hz) if seconds > 0 else 1.0
        uncertainty_ns = self._clock.uncertainty_ns if self._clock else None
        self._heartbeat.publish(
            Heartbeat(
                state=state,
                pid=os.getpid(),
                rate_hz=self._steps / seconds if seconds > 0 else 0.0,
                late_steps=self._late,
                step_mean_ms=1e3 * self._busy_s / max(self._steps, 1),
                step_max_ms=1e3 * self._longest_s,
                malformed=sum(port.malformed for port in self._inputs),
                gaps=sum(port.gaps for port in self._inputs),
                dropped=sum(port.dropped for port in self._inputs) + sum(port.dropped for port in self._raw_inputs),
                overwritten=sum(port.overwritten for port in self._inputs),
                warp=warp,
                warp_reached=warp * min(kept, 1.0),
                clock_offset_s=self._clock.offset_ns / NS if self._clock else 0.0,
                clock_uncertainty_s=None if uncertainty_ns is None else uncertainty_ns / NS,
                note=self.service.note or self._note,
            )
        )
        self._beat_ns, self._steps, self._busy_s, self._longest_s = now_ns, 0, 0.0, 0.0
