"""`starboard script FILE`: timed pokes from a TOML file."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections import Counter, deque
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.options import Hub, Json
from services.cli.system import client

if TYPE_CHECKING:
    from bus.service import RawSample
    from bus.zenoh_bus import ZenohBus
    from services.cli.script_file import Poke, ScriptRun

_TICK_S = 0.02
_AWAY_S = 0.5
"""A longer time between two looks at the clock (Ctrl-Z, kill -STOP) is a pause, not time of the script."""


def script(  # noqa: PLR0917 - typer makes options of them
    file: Annotated[Path, typer.Argument(help="The script: docs/tools.md describes it.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print what would be sent when; send nothing.")] = False,
    seed: Annotated[int | None, typer.Option(help="Start of the random numbers, in place of the file's.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Also write keys that belong to a service.")] = False,
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Send the pokes of a script at their times and conditions; all is checked before the first.

    Space pauses and goes on (so do Ctrl-Z and fg); Ctrl-C ends it with exit code 130. A condition that did not come
    true in time ends it with exit code 1.
    """
    from services.cli.script_file import ScriptRun, read_script

    run = ScriptRun(read_script(file, force=force), seed, dry=dry_run)
    if dry_run:
        while not run.ended:
            for poke in run.advance(run.next_in_s, {}):
                _tell(poke, as_json)
        return
    with client(hub) as bus:
        try:
            _run(bus, run, force, as_json)
        except KeyboardInterrupt:
            print(f"starboard: {file}: stopped in round {run.round} at {run.clock_s:.1f} s", file=sys.stderr)
            raise typer.Exit(130) from None
    if run.failure:
        print(f"starboard: {file}: {run.failure}", file=sys.stderr)
        raise typer.Exit(1)


def _run(bus: ZenohBus, run: ScriptRun, force: bool, as_json: bool) -> None:
    from services.cli.keyboard import Keyboard
    from services.cli.variables import checked_message, readable

    values: dict[str, Any] = {}
    heard: deque[RawSample] = deque()
    for key in run.script.watched:
        bus.subscribe(key, heard.append)
        values |= {v.key: readable(v.payload) for v in bus.last_values(key) if v.payload}
    state, sent, before_s = "", Counter[str](), time.monotonic()
    with Keyboard() as keyboard:
        while not run.ended:
            while heard:
                sample = heard.popleft()
                values[sample.key] = readable(sample.payload)
            now_s = time.monotonic()
            passed_s, before_s = now_s - before_s, now_s
            for poke in run.advance(passed_s if passed_s < _AWAY_S else 0.0, values):
                topic, message = checked_message(poke.key, poke.fields, force=force)
                bus.publish(topic, message.stamped(bus.clock.now_ns(), sent[poke.key], "script"))
                sent[poke.key] += 1
                _tell(poke, as_json)
            if run.state != state and run.state in ("waiting to start", "waiting", "paused"):
                print(f"starboard: {run.state}", file=sys.stderr)
            state = run.state
            if not run.ended and keyboard.read(_wait_s(run)) == " ":
                run.paused = not run.paused


def _wait_s(run: ScriptRun) -> float:
    return min(max(run.next_in_s, 0.001), _TICK_S) if run.state == "running" else _TICK_S


def _tell(poke: Poke, as_json: bool) -> None:
    if as_json:
        print(json.dumps(dataclasses.asdict(poke)), flush=True)
    else:
        print(f"{poke.at_s:8.2f} s  round {poke.round}  {poke.key}  {json.dumps(poke.fields)}", flush=True)
