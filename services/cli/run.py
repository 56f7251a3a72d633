"""`starboard run NAME`: one service in the foreground, what every supervisor calls."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from services.cli.system import running


def run(
    name: Annotated[str, typer.Argument(help="A name from `starboard status`, such as estimator.")],
    config: Annotated[
        Path | None, typer.Option(help="Configuration file; without it the one of the running system, or defaults.")
    ] = None,
    hub: Annotated[str | None, typer.Option(help="Address of the hub, such as tcp/127.0.0.1:7447.")] = None,
) -> None:
    """Run one service until Ctrl-C or SIGTERM. It waits for the hub, and finds it again after a loss."""
    from bus.run import prepare_process
    from services.catalog import build, load_settings

    prepare_process()
    if config is None and (system := running()) is not None:
        config = system.config
    settings = load_settings(config)
    entry = settings.process(name)
    service = build(entry, settings)

    from bus.hub import Hub
    from bus.run import run as run_loop
    from bus.zenoh_bus import ZenohBus
    from services.vessels import vessel_path

    endpoints = (hub,) if hub else settings.deployment().hub_endpoints
    vessel = vessel_path(settings.system.vessel).stem
    bus = service.open_bus(vessel) if isinstance(service, Hub) else ZenohBus.connect(vessel, endpoints)
    run_loop(service, bus)
