"""The whole star in one process with a simulated clock: deterministic, and much faster than real time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from bus.clock import NS, SimulatedClock
from bus.keys import is_pattern, matches
from bus.messages import Message
from bus.service import Input, RawInput, RawSample, Service
from bus.stepper import Stepper
from bus.topics import Topic

M = TypeVar("M", bound=Message)

_WAKE_LIMIT = 10_000
_Reader = tuple[Callable[[bytes | Message, str], None], str, str]
"""An input's `offer`, the key that it wants to know, the service that it wakes."""


class MemoryBus:
    """Runs any set of services; a message arrives at the instant it is published.

    `json=True` sends every message through its wire format; the result must be the same bit by bit.
    """

    def __init__(self, *, json: bool = False) -> None:
        self.clock = SimulatedClock()
        self._json = json
        self._steppers: dict[str, Stepper] = {}
        self._paused: set[str] = set()
        self._ready: dict[str, None] = {}  # in order, each once
        self._readers: dict[str, list[tuple[str, Input[Any]]]] = {}
        self._raw_readers: list[tuple[str, RawInput]] = []
        self._routes: dict[str, list[_Reader]] = {}
        self._last: dict[str, tuple[Topic[Any], Message]] = {}
        self._taps: dict[str, list[Callable[[Any], None]]] = {}
        self._sequences: dict[str, int] = {}

    @property
    def now_s(self) -> float:
        """The simulated time in s."""
        return self.clock.now_ns() / NS

    def add(self, service: Service) -> None:
        """Start a service on the bus, as a late joiner; one of the same name is replaced."""
        if service.name in self._steppers:
            self.kill(service.name)
        stepper = Stepper(service, self._send)
        self._steppers[service.name] = stepper
        self._routes.clear()
        for port in service.inputs:
            self._readers.setdefault(port.topic.pattern, []).append((service.name, port))
            retained = self._last.get(port.topic.key)
            if retained is not None and retained[0].latched:
                port.offer(self._encoded(retained[1]), retained=True)
            if port.is_pattern:
                self._offer_all_retained(port)
        for raw in service.raw_inputs:
            self._raw_readers.append((service.name, raw))
        stepper.start(self.clock.now_ns())

    def kill(self, name: str) -> None:
        """Take a service off the bus without its `stop`, as SIGKILL does."""
        ports = {id(p) for p in [*self._steppers[name].service.inputs, *self._steppers[name].service.raw_inputs]}
        del self._steppers[name]
        self._ready.pop(name, None)
        self._paused.discard(name)
        self._routes.clear()
        self._readers = {k: [r for r in v if id(r[1]) not in ports] for k, v in self._readers.items()}
        self._raw_readers = [r for r in self._raw_readers if id(r[1]) not in ports]

    def stop(self, name: str) -> None:
        """Stop a service properly, as SIGTERM does."""
        self._steppers[name].stop(self.clock.now_ns())
        self.kill(name)

    def pause(self, name: str) -> None:
        """Hold a service, as SIGSTOP does: it steps no more, its inputs go on filling."""
        self._paused.add(name)

    def resume(self, name: str) -> None:
        """Let a held service go on."""
        self._paused.discard(name)
        self._steppers[name].due_ns = self.clock.now_ns()

    def publish(self, topic: Topic[M], message: M, source: str = "") -> None:
        """Publish from outside any service, as the topic's publisher or as `source`; the header is filled in."""
        seq = self._sequences.get(topic.key, 0)
        self._sequences[topic.key] = seq + 1
        self._send(topic, message.stamped(self.clock.now_ns(), seq, source or topic.publisher))

    def publish_bytes(self, key: str, payload: bytes) -> None:
        """Put any bytes on a key, as a broken client would."""
        self._offer(self._route_of(key), payload)

    def last(self, topic: Topic[M]) -> M | None:
        """Return the last message of a topic."""
        entry = self._last.get(topic.key)
        return None if entry is None else entry[1]  # type: ignore[return-value]

    def tap(self, topic: Topic[M], callback: Callable[[M], None]) -> None:
        """Call back with every message of a topic, from outside the simulated system."""
        self._taps.setdefault(topic.key, []).append(callback)

    def run_for(self, seconds: float) -> None:
        """Let simulated time pass."""
        end_ns = self.clock.now_ns() + round(seconds * NS)
        self._wake_all()
        while self._run_next(end_ns):
            pass
        self.clock.advance_to(end_ns)

    def run_until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Let time pass until a condition holds; raise TimeoutError when it does not within `timeout_s`."""
        end_ns = self.clock.now_ns() + round(timeout_s * NS)
        self._wake_all()
        while not condition():
            if not self._run_next(end_ns):
                raise TimeoutError(f"condition not met within {timeout_s} s of simulated time")

    def _run_next(self, end_ns: int) -> bool:
        """Step the service that is due first, and all that it wakes; return False when none is due until the end."""
        now_ns, first, first_ns = self.clock.now_ns(), None, end_ns + 1
        for name, stepper in self._steppers.items():
            due_ns = stepper.next_ns(now_ns) if stepper.choosy else stepper.due_ns
            if due_ns < first_ns and name not in self._paused:
                first, first_ns = stepper, due_ns
        if first is None:
            return False
        self.clock.advance_to(max(first_ns, now_ns))
        first.step(self.clock.now_ns())
        self._wake_all()
        return True

    def _wake_all(self) -> None:
        now_ns = self.clock.now_ns()
        for _ in range(_WAKE_LIMIT):
            for name in self._ready:
                if name not in self._paused:
                    break
            else:
                return
            del self._ready[name]
            stepper = self._steppers[name]
            if stepper.woken(now_ns):
                stepper.step(now_ns)
        raise RuntimeError(f"services wake each other without end: {list(self._ready)}")

    def _encoded(self, message: Message) -> bytes | Message:
        return message.encode() if self._json else message

    def _send(self, topic: Topic[Any], message: Message) -> None:
        key = topic.key
        self._last[key] = (topic, message)
        route = self._routes.get(key)
        if route is None:
            route = self._route_of(key)
        if route:
            self._offer(route, message.encode() if self._json else message)
        if self._raw_readers:
            raw = RawSample(key, message.encode(), self.clock.now_ns())
            for name, raw_port in self._raw_readers:
                if matches(raw_port.pattern, key):
                    raw_port.offer(raw)
                    if raw_port.wakes:
                        self._ready[name] = None
        if key in self._taps:
            for callback in self._taps[key]:
                callback(message)

    def _route_of(self, key: str) -> list[_Reader]:
        """Work out a route, which `_routes` keeps until a service comes or goes."""
        patterns = [p for p in self._readers if p == key or (is_pattern(p) and matches(p, key))]
        route = self._routes[key] = [
            (port.offer, key if port.is_pattern else "", name if port.wakes else "")
            for p in patterns
            for name, port in self._readers[p]
        ]
        return route

    def _offer_all_retained(self, port: Input[Any]) -> None:
        for key, (topic, message) in self._last.items():
            if topic.latched and matches(port.topic.pattern, key):
                port.offer(self._encoded(message), key, retained=True)

    def _offer(self, route: list[_Reader], sample: bytes | Message) -> None:
        for offer, key, woken in route:
            offer(sample, key)
            if woken:
                self._ready[woken] = None
