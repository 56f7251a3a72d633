"""`starboard log`: what is in the recordings."""

from __future__ import annotations

import json
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError
from services.cli.replay import replay

if TYPE_CHECKING:
    from rich.console import Console

    from logs.reader import Recording

app = typer.Typer(no_args_is_help=True, help="Look into recordings, repair them.", rich_markup_mode=None)
app.command()(replay)

_GROWS_S = 3.0
"""A file without end that was written to within this is being recorded; the recorder writes 5 times a second."""

File = Annotated[Path, typer.Argument(help="An MCAP recording.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]


@app.command("list")
def list_recordings(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder of recordings; without it the running system's, or recordings.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the recordings of a folder: start, duration, size, messages, whether complete."""
    if directory is None:
        from services.cli.system import running

        system = running()
        directory = system.recordings if system else Path("recordings")
    if not directory.is_dir():
        raise CliError(f"{directory}: no such folder; name the one with the recordings")
    rows = [_row(path) for path in sorted(directory.glob("*.mcap"))]
    if as_json:
        print(json.dumps(rows))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("file", "start", "duration", "size", "messages", "complete")
    for row in rows:
        if "error" in row:
            table.add_row(row["file"], "", "", "", "", row["error"])
            continue
        size = f"{row['size_bytes'] / 1e6:.1f} MB"
        start = row["start"][:19].replace("T", " ")
        complete = "yes" if row["complete"] else "growing" if row["grows"] else "no end"
        table.add_row(row["file"], start, f"{row['duration_s']:.1f} s", size, str(row["messages"]), complete)
    _wide(Console()).print(table)


@app.command()
def info(file: File, as_json: Json = False) -> None:
    """Show what one recording holds: origin, topics with counts and rates."""
    recording = _open(file)
    about = _about(recording)
    rows = [t._asdict() for t in recording.topics.values()]
    if as_json:
        attachments = {name: len(data) for name, data in recording.attachments().items()}
        print(json.dumps(about | {"topics": rows, "metadata": recording.metadata, "attachments": attachments}))
        return
    from rich.console import Console
    from rich.table import Table

    console = _wide(Console())
    for name, value in (recording.metadata.get("starboard", {}) | about).items():
        console.print(f"{name:32}{value}", highlight=False, markup=False)
    table = Table("topic", "message", "messages", "rate Hz")
    for row in rows:
        table.add_row(row["key"], row["schema"], str(row["messages"]), f"{row['rate_hz']:.2f}")
    console.print(table)


@app.command()
def recover(
    file: File, output: Annotated[Path | None, typer.Option(help="Default: FILE.recovered.mcap beside it.")] = None
) -> None:
    """Write a complete file out of a recording that was cut off."""
    from logs.container import RecordingError
    from logs.recovery import recover as recover_file

    try:
        done = recover_file(file, output)
    except RecordingError as error:
        raise CliError(str(error)) from None
    damaged = f", {done.damaged_chunks} damaged chunks left out" if done.damaged_chunks else ""
    print(f"{done.path}: {done.messages} messages{damaged}")


def _wide(console: Console) -> Console:
    """Let a table be wider than a narrow terminal or pipe rather than cut names off."""
    console.width = max(console.width, 100)
    return console


def _open(path: Path) -> Recording:
    from logs.reader import Recording, RecordingError

    try:
        return Recording(path)
    except RecordingError as error:
        raise CliError(str(error)) from None


def _row(path: Path) -> dict[str, Any]:
    try:
        return {"file": path.name} | _about(_open(path))
    except CliError as error:
        return {"file": path.name, "error": str(error).removeprefix(f"{path}: ")}


def _about(recording: Recording) -> dict[str, Any]:
    start = datetime.fromtimestamp(recording.start_ns * 1e-9).astimezone()
    stat = recording.path.stat()
    return {
        "vessel": recording.vessel,
        "start": start.isoformat(timespec="milliseconds"),
        "duration_s": round(recording.duration_s, 3),
        "size_bytes": stat.st_size,
        "messages": recording.message_count,
        "complete": recording.complete,
        "grows": not recording.complete and time.time() - stat.st_mtime < _GROWS_S,
    }
