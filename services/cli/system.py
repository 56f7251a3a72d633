"""The running system, as `starboard up` describes it in `current.json`, and a client of its hub for tools."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bus.clock import Warp
from services.cli.errors import CliError

if TYPE_CHECKING:
    from bus.zenoh_bus import ZenohBus


SECURITY = "STARBOARD_SECURITY"
"""Environment variable that names the security folder, for tools on a machine where no system runs."""

HUB_S = 2.0
"""So long a hub is looked for."""
OWN_HUB_S = 10.0
"""The same while a system runs on this machine, whose hub may be starting."""


@dataclass(frozen=True)
class System:
    """Where a system can be found."""

    pid: int
    vessel: str
    hub: tuple[str, ...]
    page: str
    config: Path | None
    recordings: Path
    security: Path | None = None
    warp: Warp = field(default_factory=Warp)

    def write(self, path: Path) -> None:
        """Write `current.json`."""
        values = {
            "pid": self.pid,
            "vessel": self.vessel,
            "hub": list(self.hub),
            "page": self.page,
            "config": str(self.config) if self.config else None,
            "recordings": str(self.recordings),
            "security": str(self.security) if self.security else None,
            "warp": asdict(self.warp),
        }
        path.write_text(json.dumps(values, indent=2))


def current_path() -> Path:
    """Return the path of `current.json`."""
    from services.catalog import run_dir

    return run_dir() / "current.json"


def running() -> System | None:
    """Return the system that runs on this machine, None when there is none."""
    try:
        values = json.loads(current_path().read_text())
        os.kill(values["pid"], 0)
    except (OSError, ValueError, KeyError):
        return None
    config = Path(values["config"]) if values["config"] else None
    security = Path(values["security"]) if values["security"] else None
    hub, recordings, warp = tuple(values["hub"]), Path(values["recordings"]), Warp(**values["warp"])
    return System(values["pid"], values["vessel"], hub, values["page"], config, recordings, security, warp)


def service_states() -> list[dict[str, Any]]:
    """Return what the supervisor last wrote of each service; empty without a running system."""
    if running() is None:
        return []
    try:
        states: list[dict[str, Any]] = json.loads(current_path().with_name("services.json").read_text())
    except (OSError, ValueError):
        return []
    return states


@contextlib.contextmanager
def client(hub: str | None, vessel: str | None = None) -> Iterator[ZenohBus]:
    """Connect a tool to the hub of the running system, or to the one given; raise CliError when nobody answers.

    `vessel` is the prefix of all keys, where it is not the running system's. The password of `operator` is the running
    system's, or that of the folder in STARBOARD_SECURITY.
    """
    from bus.security import client_settings, is_address
    from bus.zenoh_bus import HubUnreachableError, ZenohBus
    from services.catalog import load_settings

    system = running()
    if system is None and hub is None:
        deployment = load_settings(None).deployment()
        prefix, endpoints = load_settings(None).system.vessel, deployment.hub_endpoints
    else:
        prefix = system.vessel if system else load_settings(None).system.vessel
        endpoints = tuple(hub.split(",")) if hub else (system.hub if system else ())
    for address in endpoints:
        if not is_address(address):
            raise CliError(f"--hub {address}: no address: write tcp/HOST:PORT or tls/HOST:PORT, with commas between")
    given = os.environ.get(SECURITY)
    folder = Path(given) if given else system.security if system else None
    if folder is None and any(address.startswith("tls/") for address in endpoints):
        raise CliError(f"this hub asks for a password: set {SECURITY} to the folder made by `starboard secure init`")
    secured = client_settings(folder, "operator") if folder else None
    try:
        bus = ZenohBus.connect(vessel or prefix, endpoints, HUB_S if hub or not system else OWN_HUB_S, secured)
    except HubUnreachableError as error:
        raise CliError(str(error)) from None
    try:
        yield bus
    finally:
        bus.close()
