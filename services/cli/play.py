"""`starboard play`: a recorded log again on the bus, beside the live vessel, never as it."""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bus.clock import NS
from services.cli.errors import CliError
from services.cli.options import Hub, complete_key, key_expression
from services.cli.system import client

if TYPE_CHECKING:
    from logs.reader import Entry, Recording

PREFIX = "replay"
"""All keys of a played log begin with `replay/<vessel>/`."""
_TICK_S = 0.05


def play(  # noqa: PLR0917 - typer makes options of them
    file: Annotated[Path, typer.Argument(help="An MCAP recording.")],
    speed: Annotated[float, typer.Option(min=0.0, help="2 plays twice as fast; 0 as fast as the bus takes it.")] = 1.0,
    from_s: Annotated[float, typer.Option("--from", min=0.0, help="Begin so many seconds after the start.")] = 0.0,
    to_s: Annotated[float | None, typer.Option("--to", min=0.0, help="End so many seconds after the start.")] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option(help="Key expression of what to play; may be given again.", autocompletion=complete_key),
    ] = None,
    hub: Hub = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was played as JSON.")] = False,
) -> None:
    """Publish a recording under replay/VESSEL/, with its own stamps. Space pauses, Ctrl-C ends.

    See it with `starboard watch --vessel replay/VESSEL`.
    """
    recording, keys = _open(file, [key_expression(t) for t in topics or ["**"]])
    if to_s is not None and to_s <= from_s:
        raise CliError(f"--to {to_s:g} must be more than --from {from_s:g}")
    name = f"{PREFIX}/{recording.vessel or file.stem}"
    entries = _between(recording, keys, from_s, to_s)
    if (first := next(entries, None)) is None:
        end = "" if to_s is None else f" to {to_s:g} s"
        raise CliError(
            f"{file}: no message of these topics from {from_s:g} s{end} (it lasts {recording.duration_s:.1f} s)"
        )
    entries = itertools.chain((first,), entries)
    with client(hub, vessel=name) as bus:
        player = Player(speed, recording.start_ns + round(from_s * NS), bus.put)
        try:
            with _progress(as_json, recording, from_s, to_s) as show:
                _play(player, entries, show)
        except KeyboardInterrupt:
            player.interrupted = True
    span_s = (player.position_ns - recording.start_ns) / NS
    done = {
        "prefix": name,
        "messages": player.played,
        "reached_s": round(span_s, 3),
        "complete": not player.interrupted,
    }
    if as_json:
        print(json.dumps(done))
    else:
        end = "stopped" if player.interrupted else "done"
        print(f"{name}: {player.played} messages, {end} at {span_s:.1f} s of {recording.duration_s:.1f} s")
    if player.interrupted:
        raise typer.Exit(130)


class Player:
    """Publishes entries when they are due. It has no clock: the caller says how much time has passed."""

    def __init__(self, speed: float, start_ns: int, put: Callable[[str, bytes], None]) -> None:
        self.speed = speed
        self.position_ns = start_ns
        """Time in the recording."""
        self.played = 0
        self.interrupted = False
        self._put = put

    def due_in_s(self, entry: Entry) -> float:
        """Return how long to wait for an entry."""
        return (entry.log_ns - self.position_ns) / NS / self.speed if self.speed else 0.0

    def passed(self, seconds: float) -> None:
        """Let real time pass."""
        self.position_ns += round(seconds * NS * self.speed)

    def publish(self, entry: Entry) -> None:
        """Send an entry as it was on the wire."""
        self._put(entry.key, wire_bytes(entry.message))
        self.played += 1
        if not self.speed:
            self.position_ns = entry.log_ns


def wire_bytes(message: Any) -> bytes:
    """Return a recorded message as it goes over the bus."""
    if isinstance(message, bytes):
        return message
    encode = getattr(message, "encode", None)
    return encode() if encode is not None and not isinstance(message, str) else json.dumps(message).encode()


def _play(player: Player, entries: Iterator[Entry], show: Callable[[int, bool], None]) -> None:
    from services.cli.keyboard import Keyboard

    paused = False
    before_s = time.monotonic()
    with Keyboard() as keyboard:
        for entry in entries:
            while paused or player.due_in_s(entry) > 0:
                wait_s = _TICK_S if paused else min(player.due_in_s(entry), _TICK_S)
                if keyboard.read(wait_s) == " ":
                    paused = not paused
                now_s = time.monotonic()
                # a longer time away (Ctrl-Z, a suspended laptop) is a pause too
                player.passed(0.0 if paused else min(now_s - before_s, 10 * _TICK_S))
                before_s = now_s
                show(player.position_ns, paused)
            player.publish(entry)


def _between(recording: Recording, keys: list[str], from_s: float, to_s: float | None) -> Iterator[Entry]:
    start_ns = recording.start_ns + round(from_s * NS)
    end_ns = recording.start_ns + round(to_s * NS) if to_s is not None else None
    for entry in recording.messages(*keys):
        if end_ns is not None and entry.log_ns > end_ns:
            return
        if entry.log_ns >= start_ns:
            yield entry


def _open(file: Path, patterns: list[str]) -> tuple[Recording, list[str]]:
    from bus.keys import matches
    from logs.reader import Recording, RecordingError

    try:
        recording = Recording(file)
    except RecordingError as error:
        raise CliError(str(error)) from None
    keys = [key for key in recording.topics if any(matches(p, key) for p in patterns)]
    if not keys:
        raise CliError(f"{file}: nothing fits {' '.join(patterns)}; `starboard log info {file}` lists its topics")
    return recording, keys


def _progress(quiet: bool, recording: Recording, from_s: float, to_s: float | None) -> Any:
    """Return a context that yields what to call with the place in the recording, in ns, and whether it is paused."""
    import contextlib

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    @contextlib.contextmanager
    def shown() -> Iterator[Callable[[int, bool], None]]:
        if quiet or not sys.stderr.isatty():
            yield lambda _at, _paused: None
            return
        end_s = recording.duration_s if to_s is None else to_s
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[at]:.1f} s  space: pause"))
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("playing", total=end_s - from_s, at=from_s)

            def show(position_ns: int, paused: bool) -> None:
                at_s = (position_ns - recording.start_ns) / NS
                progress.update(task, completed=at_s - from_s, at=at_s, description="paused " if paused else "playing")

            yield show

    return shown()
