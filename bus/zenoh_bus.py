"""The bus over Zenoh: the only module that imports zenoh. Settings and their reasons: docs/adr/0001-zenoh.md."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh

from bus.clock import NS, Clock, SystemClock
from bus.config import ConfigError
from bus.messages import Message
from bus.service import Input, RawSample, Service, first_line
from bus.topics import Qos, Topic

log = logging.getLogger("bus")

LEASE_MS = 400
"""A silent hub counts as dead after this; found in docs/adr/0001-zenoh.md to survive a loaded two-core machine."""

_PRIORITY = {
    Qos.COMMAND: zenoh.Priority.REAL_TIME,
    Qos.REQUEST: zenoh.Priority.INTERACTIVE_HIGH,
    Qos.STATE: zenoh.Priority.DATA,
    Qos.IMAGE: zenoh.Priority.BACKGROUND,
}


class HubUnreachableError(ConnectionError):
    """Nobody answers at the hub's address."""


@dataclass(frozen=True, order=True)
class LastValue:
    """What the hub knows of a key."""

    key: str
    payload: bytes | None
    received_ns: int
    count: int
    rate_hz: float


def _settings(mode: str, endpoints: tuple[str, ...], timeout_ms: int) -> zenoh.Config:
    ends: dict[str, Any] = {"endpoints": list(endpoints)}
    values: dict[str, Any] = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tx": {"lease": LEASE_MS}}, "unicast": {"open_timeout": 200}},
    }
    if mode == "router":
        values["listen"] = ends | {"exit_on_failure": True}
    else:
        retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
        values["connect"] = ends | {"timeout_ms": timeout_ms, "exit_on_failure": timeout_ms >= 0, "retry": retry}
    return zenoh.Config.from_json5(json.dumps(values))


def _open(mode: str, endpoints: tuple[str, ...], timeout_ms: int) -> zenoh.Session:
    zenoh.init_log_from_env_or("off")  # its own lines repeat what we say in one
    try:
        return zenoh.open(_settings(mode, endpoints, timeout_ms))
    except zenoh.ZError as error:
        where = ", ".join(endpoints)
        if mode == "client":
            raise HubUnreachableError(f"no hub answers at {where}: is `starboard up` running?") from None
        if "in use" in str(error):
            raise ConfigError(f"cannot listen on {where}: another hub (or program) has this port") from None
        raise ConfigError(f"cannot listen on {where}: {first_line(error).split(' at /')[0]}") from None


class ZenohBus:
    """One process's end of the star. `vessel` is the prefix of all keys."""

    def __init__(self, session: zenoh.Session, vessel: str, clock: Clock | None = None) -> None:
        self.session = session
        self.vessel = vessel
        self._clock = clock or SystemClock()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._retained: list[Input[Any]] = []
        self._kept: list[Any] = []  # declarations live as long as these references

    @classmethod
    def connect(cls, vessel: str, endpoints: tuple[str, ...], timeout_s: float | None = None) -> ZenohBus:
        """Return a client of the hub, waiting for it as long as it takes, or raise HubUnreachableError."""
        if timeout_s is not None:
            return cls(_open("client", endpoints, round(timeout_s * 1000)), vessel)
        reminder = threading.Timer(3.0, log.warning, ("waiting for the hub at %s", ", ".join(endpoints)))
        reminder.daemon = True
        reminder.start()
        try:
            return cls(_open("client", endpoints, -1), vessel)
        finally:
            reminder.cancel()

    @classmethod
    def listen(cls, vessel: str, endpoints: tuple[str, ...]) -> ZenohBus:
        """Return the hub's own end: a router. Raises ConfigError when the address is taken."""
        return cls(_open("router", endpoints, -1), vessel)

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
        self._publisher(topic).put(message.encode())

    def put(self, key: str, payload: bytes) -> None:
        """Send any bytes: for tools and tests."""
        self.session.put(self._key(key), payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def subscribe(self, pattern: str, callback: Callable[[RawSample], None]) -> None:
        """Call back, from another thread, with everything that fits a pattern: for tools."""
        self._kept.append(self.session.declare_subscriber(self._key(pattern), self._raw_handler(callback)))

    def last_values(self, pattern: str = "**", timeout_s: float = 1.0) -> list[LastValue]:
        """Return what the hub knows of the keys that fit a pattern; empty when there is none."""
        found = []
        for reply in self.session.get(self._key(pattern), timeout=timeout_s):
            if reply.ok is None:
                continue
            about = json.loads(reply.ok.attachment.to_bytes()) if reply.ok.attachment else {}
            payload = reply.ok.payload.to_bytes() if about.get("kept", True) else None
            key = self._strip(str(reply.ok.key_expr))
            found.append(
                LastValue(key, payload, about.get("received_ns", 0), about.get("count", 0), about.get("rate_hz", 0.0))
            )
        return sorted(found)

    def alive(self, timeout_s: float = 1.0) -> set[str]:
        """Return the names of the services whose liveliness token stands."""
        replies = self.session.liveliness().get(self._key("service/*"), timeout=timeout_s)
        return {str(r.ok.key_expr).rsplit("/", 1)[1] for r in replies if r.ok is not None}

    def pull_retained(self) -> None:
        """Ask the hub for the last values of inputs that have none yet; they come by themselves."""
        for port in self._retained:
            if port.latest is None:
                self.session.get(self._key(port.topic.pattern), self._retained_handler(port), timeout=1.0)

    def close(self) -> None:
        """Leave the bus."""
        self.session.close()  # type: ignore[no-untyped-call]

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self.pull_retained()

    def _publisher(self, topic: Topic[Any]) -> zenoh.Publisher:
        publisher = self._publishers.get(topic.key)
        if publisher is None:
            blocks = topic.qos is Qos.REQUEST
            publisher = self._publishers[topic.key] = self.session.declare_publisher(
                self._key(topic.key),
                congestion_control=zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP,
                priority=_PRIORITY[topic.qos],
                express=topic.qos in (Qos.COMMAND, Qos.STATE),
            )
        return publisher

    def _handler(self, port: Input[Any], wake: Callable[[], None] | None) -> zenoh.handlers.Callback[zenoh.Sample]:
        def take(sample: zenoh.Sample) -> None:
            port.offer(sample.payload.to_bytes())
            if wake is not None:
                wake()

        return zenoh.handlers.Callback(take, indirect=False)

    def _retained_handler(self, port: Input[Any]) -> Callable[[zenoh.Reply], None]:
        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None and reply.ok.payload:
                port.offer_retained(reply.ok.payload.to_bytes())

        return take

    def _raw_handler(
        self, offer: Callable[[RawSample], None], wake: Callable[[], None] | None = None
    ) -> zenoh.handlers.Callback[zenoh.Sample]:
        def take(sample: zenoh.Sample) -> None:
            key = self._strip(str(sample.key_expr))
            offer(RawSample(key, sample.payload.to_bytes(), self._clock.now_ns()))
            if wake is not None:
                wake()

        return zenoh.handlers.Callback(take, indirect=False)

    def _key(self, pattern: str) -> str:
        return f"{self.vessel}/{pattern}"

    def _strip(self, key: str) -> str:
        return key.removeprefix(self.vessel + "/")


class Store:
    """The hub's memory: last value, count and rate of every key, answered to whoever asks.

    Commands and requests are counted but not kept: they must never come back from the past. Unknown keys are kept;
    the number of keys and the size of a value are bounded, so that no client can fill the hub's memory.
    """

    MAX_KEYS = 10_000
    MAX_BYTES = 2_000_000

    def __init__(self, bus: ZenohBus, latched: Callable[[str], bool], clock: Clock | None = None) -> None:
        self.refused = 0
        """Messages not kept because there were too many keys or too many bytes."""
        self._clock = clock or SystemClock()
        self._entries: dict[str, _Entry] = {}
        self._latched = latched
        self._bus = bus
        everything = bus._key("**")
        handler = zenoh.handlers.Callback(self._keep, indirect=False)
        self._kept = [
            bus.session.declare_subscriber(everything, handler),
            bus.session.declare_queryable(everything, self._answer, complete=True),
        ]

    def update_rates(self) -> None:
        """Work out the rate of every key since the last call."""
        now_ns = self._clock.now_ns()
        for entry in list(self._entries.values()):
            entry.update_rate(now_ns)

    def _keep(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        entry = self._entries.get(key)
        if entry is None:
            if len(self._entries) >= self.MAX_KEYS:
                self.refused += 1
                return
            entry = self._entries[key] = _Entry(self._latched(self._bus._strip(key)))
        if len(sample.payload) > self.MAX_BYTES:
            self.refused += 1
            return
        entry.count += 1
        entry.received_ns = self._clock.now_ns()
        if entry.latched:
            entry.payload = sample.payload

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            for key, entry in list(self._entries.items()):
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, entry.payload or b"", attachment=entry.about())


class _Entry:
    """The hub's memory of one key."""

    def __init__(self, latched: bool) -> None:
        self.latched = latched
        self.payload: zenoh.ZBytes | None = None
        self.received_ns = 0
        self.count = 0
        self.rate_hz = 0.0
        self._counted = 0
        self._counted_ns = 0

    def update_rate(self, now_ns: int) -> None:
        if self._counted_ns:
            self.rate_hz = (self.count - self._counted) * NS / max(now_ns - self._counted_ns, 1)
        self._counted, self._counted_ns = self.count, now_ns

    def about(self) -> bytes:
        values = {
            "kept": self.payload is not None,
            "received_ns": self.received_ns,
            "count": self.count,
            "rate_hz": round(self.rate_hz, 2),
        }
        return json.dumps(values).encode()
