"""The hub's own end of the star: a router and the last value of every key."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from bus.clock import CLOCK, Warp
from bus.security import Secured
from bus.store import Entry, Store
from bus.zenoh_bus.client import TIME, ZenohBus
from bus.zenoh_bus.session import key_sent_on, open_session

log = logging.getLogger("bus")

_STORE_BACKLOG = 10_000
"""Messages that wait for the store; when it is full, routing waits. The loop empties it 50 times a second."""

_FILL_S = 0.1
"""So long at most the store takes over messages in one go: whoever floods must not keep the loop from all else."""

_DUMP = "@hub/store"
"""Where a hub gives its values to the other one; no wildcard fits a chunk with an @."""
_SINCE = "since_ns"

_NEWS = "@hub/news"
"""Where a hub tells the other one at once what came on a key that was new or quiet."""

_CLIENTS = "@hub/clients"
"""Where a hub tells the other one how many clients are connected to it."""
_CLIENTS_DIGITS = 6


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
        self._pulled_to_ns = self._others = 0
        self.hear(everything=True)
        self._kept += [
            session.declare_queryable(self._key(_DUMP), self._dump),
            session.declare_subscriber(self._key(_NEWS), self._hear_news),
            session.declare_subscriber(self._key(_CLIENTS), self._hear_clients),
            session.declare_queryable(self._key(TIME), self._tell_time, complete=True),
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
        return cls(open_session("router", endpoints, -1, link, secured), vessel, store, follows=bool(link))

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

    def count_clients(self) -> int:
        """Return how many clients are connected to either hub; tell the other one of ours.

        Of its clients we know as of its last call: after a fail-over they stay with the standby.
        """
        own, linked = self.clients, self.linked
        if linked:
            self.session.put(self._key(_CLIENTS), str(own), allowed_destination=zenoh.Locality.REMOTE)
        return own + (self._others if linked else 0)

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
            self._pulled_to_ns = self._others = 0

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

    def _hear_clients(self, sample: zenoh.Sample) -> None:
        told = sample.payload.to_bytes()
        if told.isdigit() and len(told) <= _CLIENTS_DIGITS:  # without passwords anybody may send nonsense
            self._others = int(told)

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
