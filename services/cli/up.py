"""`starboard up`: everything under the supervisor, in the foreground."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from services.cli.errors import CliError
from services.cli.system import System, current_path, running

if TYPE_CHECKING:
    from services.catalog import Process, Settings

DEFAULT_CONFIG = Path(__file__).parent.parent.parent / "config" / "simulation.toml"


def up(
    config: Annotated[
        Path, typer.Argument(help="Configuration file: config/pool.toml for the real pool.")
    ] = DEFAULT_CONFIG,
    warp: Annotated[
        float,
        typer.Option(
            min=0.01, max=1000.0, help="So many times faster than real time, in simulation; above 2 no pictures."
        ),
    ] = 1.0,
) -> None:
    """Start everything and watch it; prints the page's address. Ctrl-C stops it all."""
    from services.catalog import load_settings
    from services.supervision import supervise

    settings = load_settings(config)
    if warp != 1.0:
        settings = warped(settings, warp)
    settings.check()
    check_rules(settings)
    if (other := running()) is not None:
        raise CliError(
            f"a system runs already (pid {other.pid}, {other.page}): stop it with Ctrl-C there, "
            "or set STARBOARD_RUN_DIR to start a second one"
        )
    check_ports(settings)
    deployment = settings.deployment()
    deployment.run_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    for old in deployment.run_dir.glob("*.snapshot"):
        old.unlink()  # what an earlier system knew is not this one's state
    page = page_address(settings)
    vessel = settings.vessel_name
    system = System(
        os.getpid(),
        vessel,
        deployment.hub_endpoints,
        page,
        settings.path,
        deployment.recordings_dir,
        deployment.security,
        deployment.warp,
    )
    system.write(current_path())
    print(f"Starboard: {vessel}, {config}; page: {page}  recordings: {deployment.recordings_dir}  (Ctrl-C stops)")
    if warp != 1.0:
        print(f"Starboard: time runs {warp:g} times as fast")
    try:
        supervise(settings.processes, deployment.run_dir, settings.path, teller(settings.processes))
    finally:
        current_path().unlink(missing_ok=True)
        print("Starboard: everything has stopped")


def warped(settings: Settings, factor: float) -> Settings:
    """Return the settings for faster time, from now on; raise CliError where it cannot be."""
    from bus.clock import Warp

    if not settings.system.simulation:
        raise CliError(f"--warp {factor:g}: only a simulated world runs faster; set simulation = true")
    if settings.hub.security:
        raise CliError(f"--warp {factor:g}: the access rules are for real time; unset security in [hub]")
    return settings.at(Warp(factor, time.time_ns()))


def check_ports(settings: Settings) -> None:
    """Raise CliError where somebody listens already at a hub's address: our services would join that other star."""
    import errno
    import socket

    for address in () if settings.hub.router else settings.hub.addresses:
        host, _, port = address.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
        host = host.strip("[]")
        try:
            socket.create_server((host, int(port)), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
        except (OSError, ValueError) as error:  # of other reasons the hub tells
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                raise CliError(
                    f"{address}: another star (or program) has this port: stop it, or set other addresses "
                    "for this one in [hub]: listen, standby"
                ) from None


def check_rules(settings: Settings) -> None:
    """Raise CliError when the access rules are not those of this configuration's services."""
    if (folder := settings.hub.security) is None:
        return
    from bus.security import read_rules
    from services.access import access_rules, bridges

    rules = access_rules(settings.vessel_name, settings.processes, bridges(settings))
    if read_rules(folder) != json.loads(json.dumps(rules)):
        config = f" --config {settings.path}" if settings.path else ""
        raise CliError(
            f"{folder}: its access rules are not those of these services: run `starboard secure init {folder}{config}`"
        )


def page_address(settings: Settings) -> str:
    """Return the address of the operator's page."""
    ui = settings.section(settings.process("ui"))
    host = getattr(ui, "host", "127.0.0.1")
    return f"http://{host}:{getattr(ui, 'port', 8080)}/"


def teller(processes: Iterable[Process]) -> Callable[[str, str], None]:
    """Return what prints one line (service, text), the texts of all these processes below each other."""
    width = max(len(p.name) for p in processes)

    def tell(service: str, text: str) -> None:
        print(f"{time.strftime('%H:%M:%S')}  {service:<{width}}  {text}", flush=True)

    return tell
