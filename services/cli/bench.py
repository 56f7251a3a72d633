"""`starboard bench NAME`: the project's figures, measured on this machine."""

from __future__ import annotations

import importlib
import json
import sys
from typing import Annotated

import typer

from services.cli.errors import CliError

BENCHMARKS = (
    "chain",
    "hold",
    "holding",
    "resources",
    "memory",
    "wake",
    "bus",
    "models",
    "ship",
    "tracker",
    "control",
    "distance_keeping",
    "line_following",
)


def bench(
    name: Annotated[str, typer.Argument(help=f"{', '.join(BENCHMARKS)}, or all.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document a benchmark.")] = False,
    as_table: Annotated[bool, typer.Option("--markdown", help="Print a table for the documentation.")] = False,
) -> None:
    """Measure, with peers in the same run. A benchmark that could not measure prints no value and exits with 1."""
    if name != "all" and name not in BENCHMARKS:
        raise CliError(f"no benchmark is called {name!r}; known: {', '.join(BENCHMARKS)}, all")
    from benchmarks.result import NotMeasured

    failed = False
    for one in BENCHMARKS if name == "all" else (name,):
        try:
            _run(one, as_json=as_json, as_table=as_table)
        except NotMeasured as reason:
            print(f"starboard: bench {one}: {reason}", file=sys.stderr)
            failed = True
    if failed:
        raise typer.Exit(1)


def _run(name: str, *, as_json: bool, as_table: bool) -> None:
    from benchmarks.result import machine, table

    about = machine()
    results = importlib.import_module(f"benchmarks.{name}").measure()
    if as_json:
        rows = [{"metric": r.metric, "value": r.value, "peers": r.peers} for r in results]
        print(json.dumps({"bench": name, "machine": about, "results": rows}))
        return
    if as_table:
        print(table(results))
        return
    print(f"{name} on {about['cores']} cores, {about['cpu']}, Python {about['python']}")
    for r in results:
        goal = "" if r.goal is None else f"   (goal {r.goal:g})"
        peers = "".join(f"   {peer} {value:.4g}" for peer, value in r.peers.items())
        print(f"  {r.metric:<44} {r.value:.4g}{peers}{goal}")
