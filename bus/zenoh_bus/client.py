"""One process' end of the star."""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh
from pydantic import ValidationError

from bus.clock import CLOCK, StarClock
from bus.keys import is_pattern
from bus.messages import Message
from bus.security import Secured
from bus.service import Input, RawSample, Service
from bus.topics import Qos, Topic
from bus.zenoh_bus.session import TRY_MS, HubUnreachableError, direct, key_sent_on, open_session

log = logging.getLogger("bus")

REMIND_S = 3.0

TIME = "@hub/time"
"""Where the hub tells the time, and how fast it runs."""
_TIME_ASKED = 4
_TIME_WAIT_S = 1.0
"""A hub that has just begun to listen tells the time a little later; a router that is none of ours never."""

_REFUSED = " (or it refuses our password)"  # Zenoh does not tell the difference

_PRIORITY = {
    Qos.COMMAND: zenoh.Priority.REAL_TIME,
    Qos.REQUEST: zenoh.Priority.INTERACTIVE_HIGH,
    Qos.STATE: zenoh.Priority.DATA,
    Qos.IMAGE: zenoh.Priority.BACKGROUND,
}


@dataclass(frozen=True, order=True)
class LastValue:
    """What the hub knows of a key."""

    key: str
    payload: bytes | None
    received_ns: int
    count: int
    rate_hz: float
    source: str


class ZenohBus:
    """One process's end of the star. `vessel` is the prefix of all keys."""

    def __init__(self, session: zenoh.Session, vessel: str, clock: StarClock = CLOCK) -> None:
        self.session = session
        self.vessel = vessel
        self.clock = clock
        self._publishers: dict[str, tuple[zenoh.Publisher, zenoh.ZBytes]] = {}
        self.astray = 0
        """Messages for tools and the recorder that came under another's key, and were dropped."""
        self._retained: list[Input[Any]] = []
        self._kept: list[Any] = []  # declarations live as long as these references

    @classmethod
    def connect(
        cls,
        vessel: str,
        endpoints: tuple[str, ...],
        timeout_s: float | None = None,
        secured: Secured | None = None,
        clock: StarClock | None = CLOCK,
    ) -> ZenohBus:
        """Return a client of the hub, waiting for it as long as it takes, or raise HubUnreachableError.

        `secured`: `bus.security.client_settings`, where the hub asks for a password. The clock is set by the hub's,
        where there is one.
        """
        begin_s = time.monotonic()
        told = False
        for turn in itertools.count():
            # Zenoh would wait for the first address for ever, though another answers. Once connected it tries them all.
            first = turn % len(endpoints)
            with contextlib.suppress(HubUnreachableError):
                in_turn = (*endpoints[first:], *endpoints[:first])
                bus = cls(open_session("client", in_turn, TRY_MS, secured=secured), vessel, clock or StarClock())
                if clock is not None:
                    bus._set_clock()
                return bus
            waited_s = time.monotonic() - begin_s
            if timeout_s is not None and waited_s >= timeout_s:
                break
            if timeout_s is None and waited_s > REMIND_S and not told:
                told = True
                log.warning("waiting for the hub at %s%s", ", ".join(endpoints), _REFUSED if secured else "")
        raise HubUnreachableError(
            f"no hub answers at {', '.join(endpoints)}{_REFUSED if secured else ''}: is `starboard up` running?"
        )

    def _set_clock(self) -> None:
        self.clock.forget()
        end_s = time.monotonic() + _TIME_WAIT_S
        asked = 0
        while asked < _TIME_ASKED and time.monotonic() < end_s:
            answered = threading.Event()
            self.ask_time(answered.set)
            if answered.wait(0.05):
                asked += 1

    def ask_time(self, answered: Callable[[], None] | None = None) -> None:
        """Ask the hub for the time; the clock is set when it has answered. Returns at once."""
        asked_ns = self.clock.machine_ns()

        def take(reply: zenoh.Reply) -> None:
            heard_ns = self.clock.machine_ns()
            if reply.ok is None:
                return
            try:
                self.clock.hear(asked_ns, reply.ok.payload.to_bytes(), heard_ns)
            except ValueError as error:
                log.warning("the hub's time cannot be read: %s", error)
            if answered is not None:
                answered()

        self.session.get(self._key(TIME), take, timeout=1.0, allowed_destination=zenoh.Locality.REMOTE)

    def attach(self, service: Service, wake: Callable[[], None]) -> None:
        """Declare a service's ports; `wake` is called from another thread when an input that wakes has something."""
        for port in service.inputs:
            handler = self._handler(port, wake if port.wakes else None)
            self._kept.append(self.session.declare_subscriber(self._key(port.topic.pattern), handler))
            if port.topic.latched:
                self._retained.append(port)
        for raw in service.raw_inputs:
            handler = self._raw_handler(raw.offer, wake if raw.wakes else None)
            self._kept.append(self.session.declare_subscriber(self._key(raw.pattern), handler))
        for output in service.outputs:
            self._publisher(output.topic)
        token = self.session.liveliness().declare_token(self._key(f"service/{service.name}"))
        self._kept.append(token)
        listener = self.session.info.declare_transport_events_listener(self._on_transport, history=False)
        self._kept.append(listener)
        self.pull_retained()

    def publish(self, topic: Topic[Any], message: Message) -> None:
        """Send a message whose header is filled in."""
        publisher, key = self._publisher(topic)
        publisher.put(message.encode(), attachment=key)

    def put(self, key: str, payload: bytes) -> None:
        """Send any bytes: for tools and tests."""
        key = self._key(key)
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, attachment=key)

    def subscribe(self, pattern: str, callback: Callable[[RawSample], None]) -> None:
        """Call back, from another thread, with everything that fits a pattern: for tools.

        A message that the callback cannot decode is dropped: what others send must not end a tool.
        """

        def hear(sample: RawSample) -> None:
            with contextlib.suppress(ValidationError):
                callback(sample)

        self._kept.append(self.session.declare_subscriber(self._key(pattern), self._raw_handler(hear)))

    def last_values(self, pattern: str = "**", timeout_s: float = 1.0) -> list[LastValue]:
        """Return what the hub knows of the keys that fit a pattern; empty when there is none."""
        found: dict[str, LastValue] = {}
        for reply in self.session.get(self._key(pattern), timeout=timeout_s):
            if reply.ok is None:
                continue
            key, about = self._told(reply.ok)
            payload = reply.ok.payload.to_bytes() if about.get("kept", True) else None
            received_ns = about.get("received_ns", 0)
            if key not in found or found[key].received_ns < received_ns:  # two hubs may answer
                count, rate_hz, source = about.get("count", 0), about.get("rate_hz", 0.0), about.get("source", "")
                found[key] = LastValue(key, payload, received_ns, count, rate_hz, source)
        return sorted(found.values())

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Return the names of the services whose liveliness token stands."""
        replies = self.session.liveliness().get(self._key("service/*"), timeout=timeout_s)
        return {str(r.ok.key_expr).rsplit("/", 1)[1] for r in replies if r.ok is not None}

    def pull_retained(self) -> None:
        """Ask the hub for the last values of inputs that have none yet; they come by themselves."""
        for port in self._retained:
            if port.latest is None or port.is_pattern:
                self.session.get(self._key(port.topic.pattern), self._retained_handler(port), timeout=1.0)

    def close(self) -> None:
        """Leave the bus."""
        self.session.close()  # type: ignore[no-untyped-call]

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self.pull_retained()

    def _publisher(self, topic: Topic[Any]) -> tuple[zenoh.Publisher, zenoh.ZBytes]:
        known = self._publishers.get(topic.key)
        if known is None:
            key, blocks = self._key(topic.key), topic.qos is Qos.REQUEST
            publisher = self.session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP,
                priority=_PRIORITY[topic.qos],
                express=topic.qos in (Qos.COMMAND, Qos.STATE),
            )
            known = self._publishers[topic.key] = publisher, zenoh.ZBytes(key)
        return known

    def _handler(self, port: Input[Any], wake: Callable[[], None] | None) -> zenoh.handlers.Callback[zenoh.Sample]:
        exact = self._key(port.topic.key)

        def take(sample: zenoh.Sample) -> None:
            key = key_sent_on(sample)
            if key == exact:
                port.offer(sample.payload.to_bytes())
            elif port.is_pattern and key and not is_pattern(key):
                port.offer(sample.payload.to_bytes(), self._strip(key))
            else:
                port.refuse(f"it was put on {key[:100] or 'another key'}")
            if wake is not None:
                wake()

        return direct(take)

    def _retained_handler(self, port: Input[Any]) -> Callable[[zenoh.Reply], None]:
        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None and reply.ok.payload:
                key, _ = self._told(reply.ok)
                if port.is_pattern or key == port.topic.key:
                    port.offer(reply.ok.payload.to_bytes(), key if port.is_pattern else "", retained=True)

        return take

    def _told(self, answer: zenoh.Sample) -> tuple[str, dict[str, Any]]:
        """Return the key of a last value and what the hub knows of it."""
        about = json.loads(answer.attachment.to_bytes()) if answer.attachment else {}
        return about.get("key") or self._strip(str(answer.key_expr)), about

    def _raw_handler(
        self, offer: Callable[[RawSample], None], wake: Callable[[], None] | None = None
    ) -> zenoh.handlers.Callback[zenoh.Sample]:
        def take(sample: zenoh.Sample) -> None:
            key = key_sent_on(sample)
            if not key:
                self.astray += 1
                return
            offer(RawSample(self._strip(key), sample.payload.to_bytes(), self.clock.now_ns()))
            if wake is not None:
                wake()

        return direct(take)

    def _key(self, pattern: str) -> str:
        return f"{self.vessel}/{pattern}"

    def _strip(self, key: str) -> str:
        return key.removeprefix(self.vessel + "/")
