"""`starboard run NAME`: one service in the foreground, what every supervisor calls."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from services.cli.options import complete_service
from services.cli.system import running


def run(
    name: Annotated[
        str,
        typer.Argument(help="A name from `starboard status`, such as estimator.", autocompletion=complete_service),
    ],
    config: Annotated[
        Path | None, typer.Option(help="Configuration file; without it the one of the running system, or defaults.")
    ] = None,
    hub: Annotated[
        str | None, typer.Option(help="Addresses of hub and standby, such as tls/10.0.0.1:7447,tls/10.0.0.1:7448.")
    ] = None,
) -> None:
    """Run one service until Ctrl-C or SIGTERM. It waits for the hub, and finds it again after a loss."""
    from bus.run import prepare_process
    from services.catalog import build, load_settings

    prepare_process()
    system = running()
    if config is None and system is not None:
        config = system.config
    settings = load_settings(config)
    if system is not None:
        settings = settings.at(system.warp)
    entry = settings.process(name)
    service = build(entry, settings)

    from bus.hub import Hub
    from bus.run import run as run_loop
    from bus.security import client_settings
    from bus.zenoh_bus import ZenohBus

    vessel = settings.vessel_name
    if isinstance(service, Hub):
        run_loop(service, service.open_bus(vessel))
        return
    deployment = settings.deployment()
    endpoints = tuple(hub.split(",")) if hub else deployment.hub_endpoints
    secured = client_settings(deployment.security, name) if deployment.security else None
    run_loop(service, ZenohBus.connect(vessel, endpoints, secured=secured))
