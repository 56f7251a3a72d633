"""`starboard topics`, `get` and `poke`: the variables on the bus."""

from __future__ import annotations

import difflib
import json
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bus.clock import CLOCK
from services.cli.errors import CliError
from services.cli.options import (
    Hub,
    Json,
    Pattern,
    Vessel,
    complete_key,
    complete_operator_key,
    key_expression,
    key_of_vessel,
)
from services.cli.system import client

if TYPE_CHECKING:
    from bus.messages import Message
    from bus.service import RawSample
    from bus.topics import Topic
    from bus.zenoh_bus import ZenohBus

COMMAND_WAIT_S = 1.0
"""How long `get` waits for the next message of a key whose last value nobody keeps."""


def topics(
    pattern: Annotated[
        str, typer.Argument(help="Key expression: navigation/*, **/status.", autocompletion=complete_key)
    ] = "**",
    as_json: Json = False,
    mermaid: Annotated[bool, typer.Option("--mermaid", help="Draw the star as a Mermaid diagram.")] = False,
    schemas: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the JSON schema of every message into this folder.")
    ] = None,
) -> None:
    """List the variables: key, message, owner, rate, unit of each field."""
    from bus.keys import matches
    from bus.topics import all_topics

    if mermaid:
        from services.generate import star_diagram

        print(star_diagram())
        return
    wanted = key_expression(pattern)
    names = wanted.split("/")  # one of them may fill the placeholder of a template
    found = [t for t in all_topics() if any(matches(wanted, t.key.replace("{name}", name)) for name in names)]
    if not found:
        raise CliError(f"{pattern}: no variable is declared so; `starboard topics` lists them all")
    if schemas is not None:
        _write_schemas(found, schemas)
        return
    rows = [_about(t) for t in found]
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


def _about(topic: Topic[Any]) -> dict[str, Any]:
    from bus.units import unit_of

    return {
        "key": topic.key,
        "message": topic.message.__name__,
        "publisher": topic.publisher,
        "rate_hz": topic.rate_hz,
        "qos": topic.qos.value,
        "latched": topic.latched,
        "logged": topic.logged,
        "doc": topic.doc,
        "units": {name: unit_of(name) for name in topic.message.model_fields},
    }


def _write_schemas(some: list[Topic[Any]], folder: Path) -> None:
    """Write `<Message>.schema.json` for each message and `topics.json`, which says what key carries which."""
    messages = {t.message.__name__: t.message for t in some}
    index = [_about(t) | {"schema": f"{t.message.__name__}.schema.json"} for t in some]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, message in messages.items():
            schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | message.model_json_schema()
            (folder / f"{name}.schema.json").write_text(json.dumps(schema, indent=2) + "\n")
        (folder / "topics.json").write_text(json.dumps(index, indent=2) + "\n")
    except OSError as error:
        raise CliError(f"{folder}: cannot be written: {error.strerror}") from None
    print(f"{folder}: {len(messages)} schemas, topics.json with {len(index)} keys")


def get(key: Pattern, hub: Hub = None, vessel: Vessel = None, as_json: Json = False) -> None:
    """Print the last value of a variable, or of all that fit. Commands are never kept: of them the next is awaited."""
    from bus.keys import is_pattern

    expression, vessel = key_of_vessel(key, vessel)
    with client(hub, vessel=vessel) as bus:
        values = _values(bus, expression)
    if not values:
        raise CliError(
            f"nobody has published {key}; `starboard topics` lists the keys, `starboard status` the live ones"
        )
    now_ns = CLOCK.now_ns()
    rows = [
        {"key": k, "age_s": round((now_ns - received_ns) * 1e-9, 3), "value": readable(payload)}
        for k, (payload, received_ns) in sorted(values.items())
    ]
    if as_json:
        print(json.dumps(rows if is_pattern(expression) else rows[0]))
        return
    from bus.units import unit_of

    for row in rows:
        print(f"{row['key']}, {row['age_s']:.2f} s old")
        value = row["value"]
        for name, content in value.items() if isinstance(value, dict) else [("value", value)]:
            print(f"  {name:<24} {json.dumps(content)} {unit_of(name) if content is not None else ''}".rstrip())


def _values(bus: ZenohBus, expression: str) -> dict[str, tuple[bytes, int]]:
    """Return payload and time of arrival by key; what the hub does not keep is listened for."""
    heard: dict[str, tuple[bytes, int]] = {}
    news = threading.Event()

    def hear(sample: RawSample) -> None:
        heard[sample.key] = (sample.payload, sample.received_ns)
        news.set()

    known = bus.last_values(expression)
    kept = {v.key: (v.payload, v.received_ns) for v in known if v.payload}
    missing = {v.key for v in known} - set(kept)
    if missing or not kept:
        bus.subscribe(expression, hear)
        end_s = time.monotonic() + COMMAND_WAIT_S
        while (left_s := end_s - time.monotonic()) > 0 and news.wait(left_s):
            news.clear()
            if missing <= set(heard) and (kept or heard):
                break
    return heard | kept


def readable(payload: bytes) -> Any:
    """Return the content of a payload: JSON, the header of a picture, or how many bytes it has."""
    from pydantic_core import from_json

    from bus.messages import split_image

    try:
        return from_json(payload)
    except ValueError:
        pass
    try:
        header, picture = split_image(payload)
        return {**from_json(header), "jpeg_bytes": len(picture)}
    except (ValueError, TypeError):
        return {"payload_bytes": len(payload)}


def poke(
    key: Annotated[
        str,
        typer.Argument(
            help="A key without the vessel, such as simulation/fault.", autocompletion=complete_operator_key
        ),
    ],
    values: Annotated[
        list[str],
        typer.Argument(help="""Fields, as one JSON object '{"kind": "current"}' or as pairs kind=current x_m_s=0.1"""),
    ],
    force: Annotated[bool, typer.Option("--force", help="Also write keys that belong to a service.")] = False,
    hub: Hub = None,
) -> None:
    """Publish a message by hand, checked against its schema first. The header is filled in."""
    topic, message = checked_message(key, _fields(key, values), force=force)
    with client(hub) as bus:
        bus.publish(topic, message.stamped(bus.clock.now_ns(), 0, message.source or "poke"))
    print(f"{key}: sent")


def _fields(key: str, values: list[str]) -> dict[str, Any]:
    """Return the fields of a poke; a value of a pair is JSON, or else a word."""
    if not values[0].lstrip().startswith(("{", "[")) and all("=" in v for v in values):
        pairs = (value.split("=", 1) for value in values)
        return {name: _word(text) for name, text in pairs}
    try:
        fields = json.loads(" ".join(values))
    except (ValueError, RecursionError) as error:
        raise CliError(f"{key}: the fields are neither JSON ({error}) nor pairs name=value") from None
    if not isinstance(fields, dict):
        raise CliError(f"{key}: the fields must be a JSON object, such as {{}}")
    return fields


def _word(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def checked_message(key: str, fields: dict[str, Any], *, force: bool) -> tuple[Topic[Any], Message]:
    """Return topic and message of a poke; raise CliError that names key and field. `force`: also services' keys."""
    from pydantic import ValidationError

    from bus.service import first_line
    from bus.topics import OPERATOR, all_topics, find

    topic = find(key)
    if topic is None or "{" in key:
        near = difflib.get_close_matches(key, [t.key for t in all_topics()], 1)
        hint = f"did you mean {near[0]}?" if near else "`starboard topics` lists them"
        raise CliError(f"{key}: no such variable; {hint}")
    if topic.publisher != OPERATOR and not force:
        raise CliError(f"{key} belongs to {topic.publisher}; use --force to write it all the same")
    known = topic.message.model_fields
    if unknown := [name for name in fields if name not in known]:
        raise CliError(f"{key}: no such field: {', '.join(unknown)}; fields: {', '.join(known)}")
    try:
        return topic, topic.message.model_validate(fields)
    except ValidationError as error:
        raise CliError(f"{key}: {first_line(error)}; fields: {', '.join(known)}") from None
