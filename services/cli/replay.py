"""`starboard log replay`: a recording through one service, offline."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from bus.service import Service
    from logs.reader import Recording

OUTSIDE = ("hub", "hub_standby", "recorder", "platform_link", "camera_tracker", "ui", "simulator")
"""Services that touch more than the bus: a port, a camera, a disk."""


def replay(
    file: Annotated[Path, typer.Argument(help="An MCAP recording.")],
    through: Annotated[str, typer.Option(metavar="SERVICE", help="estimator, controller, helm, allocator, ...")],
    config: Annotated[Path | None, typer.Option(help="Configuration; without it the one in the recording.")] = None,
    output: Annotated[Path | None, typer.Option(help="Write what the service published as MCAP.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Feed a service with what was recorded, and compare what it publishes now with what it published then."""
    from logs.reader import Recording, RecordingError
    from services.replay import replay as run

    try:
        recording = Recording(file)
    except RecordingError as error:
        raise CliError(str(error)) from None
    if through in OUTSIDE:
        raise CliError(f"{through} touches more than the bus: it cannot be replayed")
    result = run(recording, _service(recording, through, config))
    if output is not None:
        _write(recording, result.samples, output)
    rows = [dataclasses.asdict(c) for c in result.comparisons]
    if as_json:
        print(json.dumps({"file": str(file), "through": through, "topics": rows}))
        return
    from bus.units import unit_of

    for row in rows:
        print(f"{row['key']}: {row['recorded']} messages then, {row['replayed']} now, {row['compared']} compared")
        for name, difference in sorted(row["largest"].items()):
            print(f"  {name:<24} differs by at most {difference:.6g} {unit_of(name)}".rstrip())


def _service(recording: Recording, name: str, config: Path | None) -> Service:
    from services.catalog import build, load_settings

    with tempfile.TemporaryDirectory() as folder:
        attached = next((n for n in recording.attachments() if n.startswith("config/")), None)
        if config is None and attached is not None:
            config = Path(folder) / Path(attached).name
            config.write_bytes(recording.attachments()[attached])
        settings = load_settings(config)
        return build(settings.process(name), settings)


def _write(recording: Recording, samples: list[Any], path: Path) -> None:
    from logs.writer import LogWriter

    try:
        writer = LogWriter(path, recording.vessel, {"vessel": recording.vessel, "replayed": str(recording.path)}, {}, 0)
    except OSError as error:
        raise CliError(f"{path}: cannot be written: {error.strerror}") from None
    for sample in samples:
        writer.write(sample)
    writer.finish()
