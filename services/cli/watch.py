"""`starboard watch`: the variables as they change, as a live table, as lines or as JSON."""

from __future__ import annotations

import json
import math
import sys
import time
from collections import deque
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bus.clock import CLOCK
from services.cli.errors import CliError
from services.cli.options import Hub, Vessel, complete_key, key_of_vessel
from services.cli.system import client

if TYPE_CHECKING:
    from bus.service import RawSample
    from services.cli.board import Board

REFRESH_S = 0.2
SILENT_S = 3.0
"""After so long without anything `watch` says so, once, on stderr."""
BACKLOG = 50_000


def watch(  # noqa: PLR0917 - typer makes options of them
    pattern: Annotated[
        str, typer.Argument(help="Key expression: navigation/state, helm/*, **.", autocompletion=complete_key)
    ] = "**",
    scope: Annotated[
        str,
        typer.Option(
            metavar="KEY", help="One message with all its fields and its history.", autocompletion=complete_key
        ),
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print one line of JSON a message.")] = False,
    every_s: Annotated[float, typer.Option(min=0.0, help="Lines: of each key at most one in this time.")] = 0.0,
    count: Annotated[int, typer.Option(min=0, help="Lines: end after so many; 0 for no end.")] = 0,
    hub: Hub = None,
    vessel: Vessel = None,
) -> None:
    """Watch variables: value, unit, source, age, rate. Into a pipe or file: one line a message. Ctrl-C ends it."""
    wanted, vessel = key_of_vessel(scope or pattern, vessel)
    if scope and "*" in scope:
        raise CliError(f"--scope {scope}: name one key")
    heard: deque[RawSample] = deque(maxlen=BACKLOG)
    with client(hub, vessel=vessel) as bus:
        try:
            bus.subscribe(wanted, heard.append)
            if as_json or not (sys.stdout.isatty() and sys.stdin.isatty()):
                _print_lines(heard, as_json, every_s, count)
            else:
                _show(bus, wanted, heard, scope and wanted)
        except KeyboardInterrupt:
            pass


def _print_lines(heard: deque[RawSample], as_json: bool, every_s: float, count: int) -> None:
    from services.cli.board import text_line

    printed = 0
    told_ns: dict[str, int] = {}
    silent_at_s = time.monotonic() + SILENT_S
    while True:
        while heard:
            sample = heard.popleft()
            if sample.received_ns - told_ns.get(sample.key, 0) < every_s * 1e9:
                continue
            told_ns[sample.key] = sample.received_ns
            print(_json_line(sample) if as_json else text_line(sample))
            printed += 1
            if printed == count:
                return
        if not told_ns and time.monotonic() > silent_at_s:
            silent_at_s = math.inf
            print("starboard: nothing has come yet; `starboard status` lists what is published", file=sys.stderr)
        sys.stdout.flush()
        time.sleep(0.02)


def _json_line(sample: RawSample) -> str:
    from services.cli.variables import readable

    return json.dumps({"key": sample.key, "received_ns": sample.received_ns, "value": readable(sample.payload)})


def _show(bus: Any, wanted: str, heard: deque[RawSample], scope: str) -> None:
    from rich.console import Console
    from rich.live import Live

    from services.cli.board import Board
    from services.cli.keyboard import Keyboard

    board = Board(scope)
    for value in bus.last_values(wanted):
        if value.payload:
            board.know(value.key, value.payload, value.received_ns, value.rate_hz)
    console = Console()
    with Keyboard() as keyboard, Live(console=console, screen=True, auto_refresh=False) as live:
        while not board.ended:
            board.take([heard.popleft() for _ in range(len(heard))])
            live.update(_picture(board, console.width, console.height), refresh=True)
            end_s = time.monotonic() + REFRESH_S
            while (left_s := end_s - time.monotonic()) > 0:
                if key := keyboard.read(left_s):
                    board.press(key, CLOCK.now_ns())
                    break


def _picture(board: Board, width: int, height: int) -> Any:
    from services.cli.board import board_table, scope_table

    return scope_table(board, width) if board.scope else board_table(board, CLOCK.now_ns(), max(height - 4, 3))
