"""The centre of the star: a Zenoh router with the last value of every key for late joiners."""

from __future__ import annotations

from bus import topics
from bus.config import Section
from bus.service import Service
from bus.zenoh_bus import Store, ZenohBus


class HubConfig(Section):
    """Section [hub]."""

    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)


def is_latched(key: str) -> bool:
    """Whether the hub keeps the last value of a key; a key that no topic declares is kept."""
    topic = topics.find(key)
    return topic is None or topic.latched


class Hub(Service):
    """Keep the last value of every key for late joiners. The loop gives it a bus that listens instead of connecting."""

    name = "hub"
    rate_hz = 1.0

    def __init__(self, config: HubConfig) -> None:
        self.config = config
        self._store: Store | None = None

    def serve(self, bus: ZenohBus) -> None:
        """Open the store on the hub's own end of the bus."""
        self._store = Store(bus, is_latched)

    def step(self, now_s: float) -> None:
        """Renew the rates that `starboard status` shows."""
        if self._store is not None:
            self._store.update_rates()
