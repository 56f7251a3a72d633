"""The bus over Zenoh: the only module that imports zenoh. Settings and their reasons: docs/adr/0001-zenoh.md."""

from __future__ import annotations

import contextlib
import ctypes
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

from bus.clock import CLOCK, StarClock, Warp
from bus.config import ConfigError
from bus.keys import is_pattern
from bus.messages import Message
from bus.security import Secured
from bus.service import Input, RawSample, Service, first_line
from bus.store import Entry, Store
from bus.topics import Qos, Topic

log = logging.getLogger("bus")

LEASE_MS = 400
"""A silent hub counts as dead after this; found in docs/adr/0001-zenoh.md to survive a loaded two-core machine."""

_QUEUE = 8
"""Messages sent at once that wait for the sending thread; with Zenoh's 2 a busy machine drops some of a quick burst."""

TRY_MS = 300
"""So long one address is tried before the next."""
REMIND_S = 3.0

MAX_MESSAGE_BYTES = 32_000_000
"""A larger message ends its sender's connection: Zenoh's own limit is 1 GB, and it would be gathered in memory."""

_STORE_BACKLOG = 10_000
"""Messages that wait for the store; when it is full, routing waits. The loop empties it 50 times a second."""

_FILL_S = 0.1
"""So long at most the store takes over messages in one go: whoever floods must not keep the loop from all else."""

_DUMP = "@hub/store"
"""Where a hub gives its values to the other one; no wildcard fits a chunk with an @."""
_SINCE = "since_ns"

_NEWS = "@hub/news"
"""Where a hub tells the other one at once what came on a key that was new or quiet."""

_TIME = "@hub/time"
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


_stays: set[int] = set()
"""Zenoh's threads that keep their state in the interpreter."""


def _direct(take: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback[zenoh.Sample]:
    """Return a handler that calls `take` in the thread that receives.

    Such a thread is none of Python's: for each call it would get a new state, with 16 kB of memory mapped and cleared
    for its frames, which takes three times as long as all else about a message. So it takes one and keeps it.
    """

    def call(sample: zenoh.Sample) -> None:
        if (thread := threading.get_ident()) not in _stays:
            _stays.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()  # without its Release
        take(sample)

    return zenoh.handlers.Callback(call, indirect=False)


def key_sent_on(sample: zenoh.Sample) -> str:
    """Return the key of a message, or "" for one that was sent on another key than it came under.

    That happens for a moment when clients return to a hub that hung (docs/adr/0001-zenoh.md). So we attach the key.
    """
    key, sent = str(sample.key_expr), sample.attachment
    try:
        return key if sent is None or sent.to_string() == key else ""
    except ValueError:  # not even a text
        return ""


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
    source: str


def _settings(
    mode: str, listen: tuple[str, ...], connect: tuple[str, ...], timeout_ms: int, secured: Secured
) -> zenoh.Config:
    tx = {"lease": LEASE_MS, "queue": {"size": {"real_time": _QUEUE, "data": _QUEUE}}}
    link = {"tx": tx, "rx": {"max_message_size": MAX_MESSAGE_BYTES}}
    values: dict[str, Any] = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        # Shared memory between processes of one machine would cost each reader of one large message 16 MB resident.
        "transport": {"link": link, "unicast": {"open_timeout": 200}, "shared_memory": {"enabled": False}},
    }
    if listen:
        values["listen"] = {"endpoints": list(listen), "exit_on_failure": True}
    if connect:
        values["connect"] = {
            "endpoints": list(connect),
            "timeout_ms": timeout_ms,
            "exit_on_failure": timeout_ms >= 0,
            "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2},
        }
    config = zenoh.Config.from_json5(json.dumps(values))
    for path, value in secured.items():
        config.insert_json5(path, json.dumps(value))
    return config


def _open(
    mode: str, endpoints: tuple[str, ...], timeout_ms: int, link: tuple[str, ...] = (), secured: Secured | None = None
) -> zenoh.Session:
    zenoh.init_log_from_env_or("off")  # its own lines repeat what we say in one
    listen, connect = ((), endpoints) if mode == "client" else (endpoints, link)
    try:
        return zenoh.open(_settings(mode, listen, connect, timeout_ms, secured or {}))
    except zenoh.ZError as error:
        where = ", ".join(endpoints)
        if mode == "client":
            raise HubUnreachableError(where) from None
        if "in use" in str(error):
            raise ConfigError(f"cannot listen on {where}: another hub (or program) has this port") from None
        raise ConfigError(f"cannot listen on {where}: {first_line(error).split(' at /')[0]}") from None


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
                bus = cls(_open("client", in_turn, TRY_MS, secured=secured), vessel, clock or StarClock())
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

        self.session.get(self._key(_TIME), take, timeout=1.0, allowed_destination=zenoh.Locality.REMOTE)

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

        return _direct(take)

    def _retained_handler(self, port: Input[Any]) -> Callable[[zenoh.Reply], None]:
        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None and reply.ok.payload:
                key, _ = self._told(reply.ok)
                if port.is_pattern or key == port.topic.key:
                    port.offer_retained(reply.ok.payload.to_bytes(), key if port.is_pattern else "")

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

        return _direct(take)

    def _key(self, pattern: str) -> str:
        return f"{self.vessel}/{pattern}"

    def _strip(self, key: str) -> str:
        return key.removeprefix(self.vessel + "/")


class HubBus(ZenohBus):
    """The hub's own end of the bus: a router with the store, linked to the other hub if there is one.

    Links go one way (from the standby to the hub): mutual ones have made the router panic. Until it has the other's
    values, a hub does not claim to know them all, so that queries reach the one that does. A standby without clients
    does not listen: it would be woken by each message. It asks the hub for what is new instead (`pull_store`).
    """

    def __init__(
        self, session: zenoh.Session, vessel: str, store: Store, *, follows: bool, routes: bool = True
    ) -> None:
        super().__init__(session, vessel)
        self._follows, self._routes = follows, routes
        self.pulled = False
        """Whether the values of the hub linked now have been taken over."""
        self._store = store
        self._announced = False
        self._heard: zenoh.Subscriber[Any] | None = None
        self._hearing = threading.Lock()
        self._switching = threading.Lock()
        self._pulled_to_ns = 0
        self.hear(everything=True)
        self._kept += [
            session.declare_queryable(self._key(_DUMP), self._dump),
            session.declare_subscriber(self._key(_NEWS), self._hear_news),
            session.declare_queryable(self._key(_TIME), self._tell_time, complete=True),
        ]
        self._answers = session.declare_queryable(self._key("**"), self._answer)

    @classmethod
    def listen(  # noqa: PLR0917
        cls,
        vessel: str,
        endpoints: tuple[str, ...],
        store: Store,
        link: tuple[str, ...] = (),
        secured: Secured | None = None,
        warp: Warp | None = None,
    ) -> HubBus:
        """Return a router that listens at `endpoints` and links to `link`; raise ConfigError for a taken address."""
        CLOCK.warp = warp or Warp()
        return cls(_open("router", endpoints, -1, link, secured), vessel, store, follows=bool(link))

    @classmethod
    def beside(cls, vessel: str, router: str, store: Store, secured: Secured | None, warp: Warp | None) -> HubBus:
        """Return the store as a client of a router that is none of ours, waiting for it as long as it takes."""
        session = ZenohBus.connect(vessel, (router,), secured=secured, clock=None).session
        CLOCK.warp = warp or Warp()
        return cls(session, vessel, store, follows=False, routes=False)

    def ask_time(self, answered: Callable[[], None] | None = None) -> None:
        """Follow the hub's clock as a standby; the hub's own is the star's."""
        if self._follows:
            super().ask_time(answered)

    @property
    def clients(self) -> int:
        """How many clients are connected to this hub."""
        return sum(t.whatami == zenoh.WhatAmI.CLIENT for t in self.session.info.transports())

    @property
    def linked(self) -> bool:
        """Whether the other hub is connected."""
        return self._routes and any(t.whatami == zenoh.WhatAmI.ROUTER for t in self.session.info.transports())

    @property
    def idle(self) -> bool:
        """Whether this is a standby that nobody uses while the hub, whose values it has, is there."""
        return self._follows and self.pulled and self.linked and not self.clients

    def hear(self, *, everything: bool) -> None:
        """Listen to all messages or to none; from any thread."""
        with self._switching:
            if everything and self._heard is None:
                channel: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_STORE_BACKLOG)
                self._heard = self.session.declare_subscriber(self._key("**"), channel)
                self.pull_store()  # what has passed since the last time
            elif not everything and self._heard is not None:
                self.fill_store()
                with self._hearing:
                    before, self._heard = self._heard, None
                self._pulled_to_ns = 0
                before.undeclare()  # type: ignore[no-untyped-call]

    def pull_store(self) -> None:
        """Ask the other hub for its values, or while this one is `idle` for those since the last time."""
        self.session.get(
            f"{self._key(_DUMP)}?{_SINCE}={self._pulled_to_ns}",
            self._merge,
            allowed_destination=zenoh.Locality.REMOTE,
            target=zenoh.QueryTarget.ALL,
            timeout=1.0,
        )

    def announce(self) -> None:
        """Claim to know every key, so that queries end here."""
        if not self._announced:
            self._announced = True
            before = self._answers
            self._answers = self.session.declare_queryable(self._key("**"), self._answer, complete=True)
            before.undeclare()  # type: ignore[no-untyped-call]

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        if self.session.is_closed():  # our own end is an event, too
            return
        self.hear(everything=True)  # until it is clear that nobody needs us
        if event.transport.whatami == zenoh.WhatAmI.ROUTER:
            self.pulled = False
            self._pulled_to_ns = 0

    def fill_store(self) -> None:
        """Take over what has passed since the last call. In batches: a callback for each message would slow its way."""
        now_ns = self.clock.now_ns()
        end_s = time.monotonic() + _FILL_S
        with self._hearing:
            heard = self._heard
            while heard is not None and time.monotonic() < end_s and (sample := heard.try_recv()) is not None:
                key = self._strip(key_sent_on(sample))
                payload = sample.payload.to_bytes()
                if payload or sample.kind == zenoh.SampleKind.PUT:
                    self._store.keep(key, payload, now_ns)
                else:
                    self._store.forget(key)
            if self._store.news:
                self._store.news = False
                self.session.put(
                    self._key(_NEWS),
                    self._store.dump(now_ns),
                    congestion_control=zenoh.CongestionControl.DROP,  # a hung standby holds up nobody; it asks, too
                    allowed_destination=zenoh.Locality.REMOTE,
                )

    def _answer(self, query: zenoh.Query) -> None:
        self.fill_store()
        with query:
            for key, entry in self._store.items():
                if query.key_expr.intersects(full := zenoh.KeyExpr(self._key(key))):
                    query.reply(full, entry.payload or b"", attachment=_about(key, entry))

    def _dump(self, query: zenoh.Query) -> None:
        self.fill_store()
        with query:
            query.reply(query.key_expr, self._store.dump(int(query.parameters.get(_SINCE) or 0)))

    def _tell_time(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, self.clock.tell())

    def _merge(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        self._learn(reply.ok.payload)
        if self._heard is None:
            self._pulled_to_ns = self._store.newest_ns
        self.pulled = True

    def _hear_news(self, sample: zenoh.Sample) -> None:
        if self._heard is None:  # who listens would count it twice
            self._learn(sample.payload)

    def _learn(self, dumped: zenoh.ZBytes) -> None:
        try:
            self._store.merge(dumped.to_bytes())
        except ValueError as error:
            log.warning("the other hub's values cannot be read: %s", error)


def _about(key: str, entry: Entry) -> bytes:
    values = {
        "key": key,
        "kept": entry.payload is not None,
        "received_ns": entry.received_ns,
        "count": entry.traffic.count,
        "rate_hz": round(entry.traffic.rate_hz, 2),
        "source": entry.source,
    }
    return json.dumps(values).encode()
