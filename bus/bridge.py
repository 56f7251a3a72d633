"""A bridge to a second community: chosen variables of each star on the other's hub, under their vessel's name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import Field, field_validator

from bus.config import Deployment, Section
from bus.security import client_settings
from bus.service import Service
from bus.zenoh_bus import HubUnreachableError, ZenohBus

TRY_S = 2.0


class BridgeConfig(Section):
    """Section of a bridge."""

    hub: tuple[str, ...] = Field(
        ("tcp/127.0.0.1:7547",),
        description="addresses of the other community's hubs; none: its bridge comes to our hub, "
        "with the user and the rights of this section",
    )
    send: tuple[str, ...] = Field(
        ("navigation/state",), description="what of this vessel the others get: key expressions without the vessel"
    )
    receive: tuple[str, ...] = Field((), description="what we get from them: key expressions that begin with a vessel")
    security: Path | None = Field(None, description="folder with ca.pem and users/<user> for the other hub")
    user: str = Field("bridge", description="our name there")

    @field_validator("receive")
    @classmethod
    def _names_a_vessel(cls, receive: tuple[str, ...]) -> tuple[str, ...]:
        for key in receive:
            vessel, _, rest = key.partition("/")
            if "*" in vessel or "@" in key or not rest:
                raise ValueError(f"{key}: begins with a vessel's name, such as charlie/navigation/state")
        return receive

    def keys(self, vessel: str) -> tuple[list[str], list[str]]:
        """Return the full keys that the bridge (publishes, reads) at our own hub."""
        return list(self.receive), [f"{vessel}/{key}" for key in self.send]


class Bridge(Service):
    """Pass chosen variables on to a second community's hub, and back. Each star keeps its own vessel's keys."""

    name = "bridge"
    rate_hz = 2.0

    def __init__(self, config: BridgeConfig, deployment: Deployment) -> None:
        self._config = config
        self._deployment = deployment
        self._vessel = deployment.vessel_path.stem if deployment.vessel_path else ""
        self._near: ZenohBus | None = None
        self._far: ZenohBus | None = None
        self._kept: list[Any] = []
        self._tried_s = 0.0
        self.passed = {"sent": 0, "received": 0}
        """Messages passed on since start."""

    def start(self, now_s: float) -> None:
        """Connect to our own hub a second time: what is passed on has its own way."""
        for key in self._config.receive:
            if key.split("/")[0] == self._vessel:
                raise ValueError(f"[bridge] receive: {key} is this vessel's own")
        if not self._config.hub:
            self.note = "the other community's bridge comes to our hub"
            return
        folder = self._deployment.security
        secured = client_settings(folder, self.name) if folder else None
        self._near = ZenohBus.connect(self._vessel, self._deployment.hub_endpoints, None, secured, clock=None)

    def step(self, now_s: float) -> None:
        """Connect to the other hub until it is there; from then on it is found again by itself."""
        if self._near is None:
            return
        if self._far is None and now_s - self._tried_s >= TRY_S:
            self._tried_s = now_s
            self._connect(self._near)
        if self._far is not None:
            self.note = f"{self.passed['sent']} sent, {self.passed['received']} received"

    def stop(self, now_s: float) -> None:
        """Leave both hubs."""
        for bus in (self._far, self._near):
            if bus is not None:
                bus.close()

    def _connect(self, near: ZenohBus) -> None:
        config = self._config
        try:
            secured = client_settings(config.security, config.user) if config.security else None
            far = ZenohBus.connect(self._vessel, config.hub, 0.0, secured, clock=None)
        except HubUnreachableError:
            self.note = f"no hub answers at {', '.join(config.hub)}; tried again"
            return
        writes, reads = config.keys(self._vessel)
        for keys, source, sink, way in ((reads, near, far, "sent"), (writes, far, near, "received")):
            for key in keys:
                self._kept.append(source.session.declare_subscriber(key, self._pass_on(sink, way)))
        self._far = far

    def _pass_on(self, sink: ZenohBus, way: str) -> Callable[[Any], None]:
        def take(sample: Any) -> None:
            self.passed[way] += 1
            sink.session.put(sample.key_expr, sample.payload, priority=sample.priority, attachment=sample.attachment)

        return take
