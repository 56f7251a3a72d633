"""`starboard topics`, `get` and `poke`: the variables on the bus."""

from __future__ import annotations

import json
import threading
import time
from typing import Annotated, Any

import typer

from services.cli.errors import CliError
from services.cli.system import client

Hub = Annotated[str | None, typer.Option(help="Address of the hub; without it the running system's.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]

COMMAND_WAIT_S = 1.0


def topics(
    as_json: Json = False,
    mermaid: Annotated[bool, typer.Option("--mermaid", help="Draw the star as a Mermaid diagram.")] = False,
) -> None:
    """List every variable: key, message, owner, rate, unit of each field."""
    from bus.topics import all_topics
    from bus.units import unit_of

    if mermaid:
        from services.generate import star_diagram

        print(star_diagram())
        return
    rows = [
        {
            "key": t.key,
            "message": t.message.__name__,
            "publisher": t.publisher,
            "rate_hz": t.rate_hz,
            "qos": t.qos.value,
            "logged": t.logged,
            "doc": t.doc,
            "units": {name: unit_of(name) for name in t.message.model_fields},
        }
        for t in all_topics()
    ]
    if as_json:
        print(json.dumps(rows))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("key", "message", "publisher", "rate Hz", "what it is")
    for row in rows:
        rate = "on change" if row["rate_hz"] is None else f"{row['rate_hz']:g}"
        table.add_row(str(row["key"]), str(row["message"]), str(row["publisher"]), rate, str(row["doc"]))
    Console().print(table)


def get(
    key: Annotated[str, typer.Argument(help="A key without the vessel, such as navigation/state.")],
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Print the last value of a variable. Commands are never kept: of them the next one is awaited."""
    with client(hub) as bus:
        payload, received_ns = _value(bus, key)
    age_s = round((time.time_ns() - received_ns) * 1e-9, 3)
    value = _readable(payload)
    if as_json:
        print(json.dumps({"key": key, "age_s": age_s, "value": value}))
        return
    from bus.units import unit_of

    print(f"{key}, {age_s:.2f} s old")
    for name, content in value.items() if isinstance(value, dict) else [("value", value)]:
        print(f"  {name:<24} {json.dumps(content)} {unit_of(name)}".rstrip())


def _value(bus: Any, key: str) -> tuple[bytes, int]:
    from bus.service import RawSample

    found = [v for v in bus.last_values(key) if v.payload]
    if found:
        return found[0].payload, found[0].received_ns
    heard: list[RawSample] = []
    arrived = threading.Event()

    def hear(sample: RawSample) -> None:
        heard.append(sample)
        arrived.set()

    bus.subscribe(key, hear)
    if not arrived.wait(COMMAND_WAIT_S):
        raise CliError(
            f"nobody has published {key}; `starboard topics` lists the keys, `starboard status` the live ones"
        )
    return heard[0].payload, heard[0].received_ns


def _readable(payload: bytes) -> Any:
    from bus.messages import split_image

    try:
        return json.loads(payload)
    except ValueError:
        pass
    try:
        header, picture = split_image(payload)
        return {**json.loads(header), "jpeg_bytes": len(picture)}
    except ValueError:
        return {"bytes": len(payload)}


def poke(
    key: Annotated[str, typer.Argument(help="A key without the vessel, such as simulation/fault.")],
    value: Annotated[str, typer.Argument(help="""Fields as JSON, such as '{"kind": "camera_black"}'.""")],
    force: Annotated[bool, typer.Option("--force", help="Also write keys that belong to a service.")] = False,
    hub: Hub = None,
) -> None:
    """Publish a message by hand, checked against its schema first. The header is filled in."""
    from pydantic import ValidationError

    from bus.service import first_line
    from bus.topics import OPERATOR, find

    topic = find(key)
    if topic is None:
        raise CliError(f"{key}: no such variable; `starboard topics` lists them")
    if topic.publisher != OPERATOR and not force:
        raise CliError(f"{key} belongs to {topic.publisher}; use --force to write it all the same")
    try:
        fields = json.loads(value)
        header = {"stamp_ns": time.time_ns(), "source": "poke"}
        message = topic.message.model_validate(header | fields)
    except json.JSONDecodeError as error:
        raise CliError(f"{key}: the fields are no valid JSON: {error}") from None
    except (ValidationError, TypeError) as error:
        known = ", ".join(topic.message.model_fields)
        raise CliError(f"{key}: {first_line(error)}; fields: {known}") from None
    with client(hub) as bus:
        bus.publish(topic, message)
    print(f"{key}: sent")
