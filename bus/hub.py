"""The centre of the star: a router with the last value of every key, and its standby."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from bus import topics
from bus.clock import NS
from bus.config import Deployment, Section
from bus.messages import HubStatistics, Traffic
from bus.security import client_settings, hub_settings, is_address, is_local
from bus.service import Output, Service
from bus.store import Store
from bus.zenoh_bus import HubBus

LINK_S = 0.1
"""How often hubs look for each other, and an idle standby takes over what is new."""
SNAPSHOT_S = 0.5
STATISTICS_S = 1.0
ALONE_S = 1.0
"""A hub that no other linked to for so long has nobody to learn from."""
NAMED = 50
"""So many keys and sources are named in the statistics, the busiest first."""


class HubConfig(Section):
    """Section [hub]."""

    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    standby: str = Field("tcp/127.0.0.1:7448", description="where the standby hub listens; empty for none")
    router: str = Field(
        "",
        description="address of a Zenoh router that is none of ours (zenohd): the hub, its client, only keeps values; "
        "no standby",
    )
    security: Path | None = Field(
        None, description="folder made by `starboard secure init`: only users with a password, and only what is theirs"
    )
    open: bool = Field(False, description="listen on a network address without `security`: anybody there may steer")

    @property
    def addresses(self) -> tuple[str, ...]:
        """Where the hub listens, then the standby; or the router in the hub's place."""
        if self.router:
            return (self.router,)
        return (*self.listen, self.standby) if self.standby else self.listen

    @model_validator(mode="before")
    @classmethod
    def _has_no_standby_beside_a_router(cls, values: Any) -> Any:
        if not (isinstance(values, dict) and values.get("router")):
            return values
        if values.get("standby"):
            raise ValueError("standby: with `router` there is none: a second zenohd can stand by")
        return values | {"standby": ""}

    @model_validator(mode="after")
    def _is_guarded(self) -> Self:
        for address in self.addresses:
            if not is_address(address):
                raise ValueError(f"{address!r} is no address: write tcp/HOST:PORT or tls/HOST:PORT")
            if self.security and not address.startswith("tls/"):
                raise ValueError(f"{address}: with `security` every address begins with tls/")
            if not (self.security or self.open or is_local(address)):
                raise ValueError(
                    f"{address} is open to the network, where anybody could steer: run `starboard secure init DIR` "
                    'and set security = "DIR" (or open = true to do without)'
                )
        return self


def is_latched(key: str) -> bool:
    """Whether the hub keeps the last value of a key; a key that no topic declares is kept."""
    topic = topics.find(key)
    return topic is None or topic.latched


class Hub(Service):
    """Route all messages; keep the last value of every key for late joiners, on disk too; publish statistics."""

    name = "hub"
    rate_hz = 50.0
    statistics = Output(topics.HUB_STATISTICS)

    def __init__(self, config: HubConfig, deployment: Deployment) -> None:
        self._listen, self._link = config.listen, tuple[str, ...]()
        self._router = config.router
        self._alone = not config.standby
        self._prepare(deployment)

    def _prepare(self, deployment: Deployment) -> None:
        self._store = Store(is_latched)
        self._security, self._warp = deployment.security, deployment.warp
        self._snapshot = deployment.run_dir / f"{self.name}.snapshot"
        self._bus: HubBus | None = None
        self._started_s = self._linked_s = self._saved_s = self._published_s = 0.0
        self._error = ""

    def open_bus(self, vessel: str) -> HubBus:
        """Return the hub's own end of the bus, which listens from now on; or wait for the router in its place.

        Raises ConfigError for a taken address.
        """
        self._load()
        if self._router:
            client = client_settings(self._security, StandbyHub.name) if self._security else None
            self._bus = HubBus.beside(vessel, self._router, self._store, client, self._warp)
            return self._bus
        secured = hub_settings(self._security, StandbyHub.name) if self._security else None
        self._bus = HubBus.listen(vessel, self._listen, self._store, self._link, secured, self._warp)
        return self._bus

    def start(self, now_s: float) -> None:
        """Without a standby nobody knows more."""
        self._started_s = self._published_s = now_s
        self._store.renew_rates(round(now_s * NS))
        if self._alone and self._bus is not None:
            self._bus.announce()

    def step(self, now_s: float) -> None:
        """Link, save, tell."""
        if self._bus is None:
            return
        self._bus.fill_store()
        if now_s - self._linked_s >= LINK_S:
            self._linked_s = now_s
            self._follow_link(self._bus, now_s)
        if now_s - self._saved_s >= SNAPSHOT_S:
            self._saved_s = now_s
            self._save()
        if now_s - self._published_s >= STATISTICS_S:
            self._published_s = now_s
            self._store.renew_rates(round(now_s * NS))
            clients = self._bus.count_clients()
            if self._tells(self._bus.linked):
                self.statistics.publish(self._measured(clients, self._bus.linked))

    def stop(self, now_s: float) -> None:
        """Save the last values."""
        self._save()

    def _tells(self, linked: bool) -> bool:
        return True

    def _follow_link(self, bus: HubBus, now_s: float) -> None:
        linked, idle = bus.linked, bus.idle
        bus.hear(everything=not idle)
        if linked and (idle or not bus.pulled):
            bus.pull_store()
        if bus.pulled if linked else now_s - self._started_s > ALONE_S:
            bus.announce()

    def _load(self) -> None:
        try:
            self._store.merge(self._snapshot.read_bytes())
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            self.log.warning("%s: starting without last values: %s", self._snapshot, error)

    def _save(self) -> None:
        try:
            self._snapshot.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._store.save(self._snapshot)
            self.note = self._error = ""
        except OSError as error:
            reason = f"last values not saved: {error.strerror}"
            if reason != self._error:
                self.log.error("%s: %s", self._snapshot, reason)
            self.note = self._error = reason

    def _measured(self, clients: int, linked: bool) -> HubStatistics:
        store = self._store
        entries = store.items()
        return HubStatistics(
            clients=clients,
            linked=linked,
            keys=len(entries),
            messages_hz=store.total.rate_hz,
            bytes_s=store.total.bytes_s,
            refused=store.refused,
            by_key=_busiest((key, e.traffic) for key, e in entries if len(key) <= 200),
            by_source=_busiest((name or "(unnamed)", c) for name, c in list(store.sources.items())),
            missed=dict(_missed(entries)),
        )


class StandbyHub(Hub):
    """A second hub, linked to the first: clients turn to it when the first is gone, and it has all values."""

    name = "hub_standby"

    def __init__(self, deployment: Deployment) -> None:
        self._listen, self._router = (deployment.hub_standby,), ""
        self._link = deployment.hub_endpoints[:-1]
        self._alone = False
        self._prepare(deployment)

    def _tells(self, linked: bool) -> bool:
        return not linked  # the hub tells; both hear every message


def _busiest(traffic: Any) -> dict[str, Traffic]:
    ranked = sorted(traffic, key=lambda item: item[1].rate_hz, reverse=True)[:NAMED]
    return {name: Traffic(messages_hz=round(c.rate_hz, 2), bytes_s=round(c.bytes_s, 1)) for name, c in ranked}


def _missed(entries: Any) -> Any:
    """Yield each reader with what it missed, as its last heartbeat tells."""
    for key, entry in entries:
        if key.startswith("service/") and key.endswith("/heartbeat") and entry.payload:
            try:
                beat = topics.HEARTBEAT.message.decode(entry.payload)
            except ValueError:
                continue
            if beat.gaps or beat.dropped:
                yield key.split("/")[1], beat.gaps + beat.dropped
