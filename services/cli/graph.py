"""`starboard graph`: the star as Mermaid or as a picture, from the declarations or from what is connected."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from services.cli.errors import CliError
from services.cli.options import Hub, Json
from services.cli.system import client

if TYPE_CHECKING:
    from bus.service import RawSample
    from services.star import Node

LISTEN_S = 1.5
"""How long to listen for what the hub does not keep; longer than a heartbeat's period."""


def graph(
    live: Annotated[bool, typer.Option("--live", help="What is connected and publishes now.")] = False,
    svg: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a picture (SVG) instead.")] = None,
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Draw the star: who publishes what to the hub, and who reads it. Without options as Mermaid.

    With --live what is published is what was seen; who reads what is as declared: Zenoh does not tell it.
    """
    from services.star import declared_star, mermaid
    from services.star import svg as picture

    nodes, title = (_live(hub), "What is connected") if live else (declared_star(), "The star as declared")
    if as_json:
        print(json.dumps([dataclasses.asdict(node) for node in nodes]))
    elif svg is None:
        print(mermaid(nodes))
    else:
        try:
            svg.write_text(picture(nodes, title), encoding="utf-8")
        except OSError as error:
            raise CliError(f"{svg}: cannot be written: {error.strerror}") from None
        print(f"{svg}: {len(nodes)} clients around the hub")


def _live(hub: str | None) -> list[Node]:
    from services.catalog import load_settings
    from services.cli.board import fields_of
    from services.cli.system import running
    from services.star import declared_star, live_star

    sources: dict[str, set[str]] = {}

    def note(key: str, payload: bytes) -> None:
        sources.setdefault(key, set()).add(str(fields_of(payload).get("source", "")))

    heard: list[RawSample] = []
    with client(hub) as bus:
        bus.subscribe("**", heard.append)
        for value in bus.last_values():
            if value.payload:
                note(value.key, value.payload)
        alive = bus.alive()
        time.sleep(LISTEN_S)
    for sample in heard:
        note(sample.key, sample.payload)
    system = running()
    processes = load_settings(system.config if system else None).processes
    return live_star(declared_star(processes), alive, sources)
