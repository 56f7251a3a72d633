"""`starboard figures`: the figures of thesis chapters 6 to 8 computed again, and those of a real ship."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from services.cli.figure_parts import Figure


class _Drawing(NamedTuple):
    group: str
    function: str
    title: str
    argument: str | int | None = None


_ROV = {
    "decisions": "which drag pairs of experiments decide for",
    "alpha": "errors of inertia",
    "drag": "errors of drag",
    "steady_state": "differences of steady states",
    "time_constant": "differences of time constants",
    "prediction": "sums of absolute errors",
}


def _rov(vehicle: str, names: dict[str, str]) -> dict[str, _Drawing]:
    return {n: _Drawing(vehicle.lower(), f, f"{vehicle}: {_ROV.get(f, f)}", vehicle) for n, f in names.items()}


def _charlie(name: str, function: str, title: str, day: int = 0) -> dict[str, _Drawing]:
    return {name: _Drawing("charlie", function, f"Charlie{f', day {day}' if day else ''}: {title}", day)}


FIGURES: dict[str, _Drawing] = {
    "example-6.1": _Drawing("examples", "example_6_1", "matrix algorithm on a second-order process"),
    "6.3": _Drawing("examples", "figure_6_3", "hysteresis as set and as switched"),
    "example-7.1": _Drawing("examples", "example_7_1", "Falcon, yaw: which drag"),
    "example-7.2": _Drawing("examples", "example_7_2", "Falcon, heave: which drag"),
    "example-7.3": _Drawing("examples", "example_7_3", "yaw with linear drag: which drag"),
    "7.1": _Drawing("videoray", "experiment", "VideoRay: one experiment", "VideoRay"),
    "7.2": _Drawing("videoray", "no_oscillation", "VideoRay: a relay without hysteresis", "VideoRay"),
    **_rov("VideoRay", dict(zip(("7.3", "7.4", "7.5", "7.6", "7.7", "7.8"), _ROV, strict=True))),
    "7.9": _Drawing("automarine", "steady_rates", "AutoMarine: steady rates of step responses", "AutoMarine"),
    "7.10": _Drawing("automarine", "step_inertia", "AutoMarine: inertia from step responses", "AutoMarine"),
    **_rov("AutoMarine", dict(zip(("7.11", "7.12", "7.13", "7.14", "7.15", "7.17"), _ROV, strict=True))),
    "7.16": _Drawing("automarine", "validation_run", "AutoMarine: a record for validation", "AutoMarine"),
    **_charlie("7.18", "wind", "wind"),
    **_charlie("7.19", "margins", "condition for self-oscillations"),
    **_charlie("7.20", "experiment", "heading and rudder of one experiment"),
    **_charlie("7.21", "path", "path of one experiment"),
    **_charlie("7.22", "decisions", "which drag pairs decide for", 1),
    **_charlie("7.23", "decisions", "which drag pairs decide for", 2),
    **_charlie("7.24", "drag", "errors of drag", 1),
    **_charlie("7.25", "drag", "errors of drag", 2),
    **_charlie("7.26", "drag_shares", "shares of experiments by error of drag"),
    **_charlie("7.27", "time_constant", "differences of time constants", 1),
    **_charlie("7.28", "time_constant", "differences of time constants", 2),
    **_charlie("7.29", "time_constant_shares", "shares of experiments by difference of time constants"),
    **_charlie("7.30", "prediction", "sums of absolute errors", 1),
    **_charlie("7.31", "prediction", "sums of absolute errors", 2),
    "8.16": _Drawing("guidance", "reference_changes", "distance keeping: ramp and step"),
    "8.17": _Drawing("guidance", "laser_absent", "distance keeping: twice 5 s without measurements"),
    **{
        number: _Drawing("guidance", "far_away", f"line following: method {method}, {limit} the limit", number)
        for number, method, limit in (
            ("8.20", 1, "without"),
            ("8.21", 1, "with"),
            ("8.22", 2, "without"),
            ("8.23", 2, "with"),
        )
    },
    **{
        number: _Drawing("guidance", "u_turn", f"line following: U-turn by {law}", law)
        for number, law in (("8.24", "method 1"), ("8.25", "method 2, case 1"), ("8.26", "method 2, case 2"))
    },
    "8.27": _Drawing("guidance", "rudder_activity", "line following: rudder by two model functions"),
    "ship": _Drawing("ship", "ship", "real zig-zags: every method, each run predicts the others"),
    "spirals": _Drawing("manoeuvres", "spirals", "direct and reverse spiral of a stable and of an unstable ship"),
    "turning": _Drawing("ship", "turning", "real turning circles and overshoots"),
}
"""Name -> what draws it. Numbers are those of the thesis."""

_MODULES = {
    "examples": "services.cli.figures_examples",
    "videoray": "services.cli.figures_rov",
    "automarine": "services.cli.figures_rov",
    "charlie": "services.cli.figures_charlie",
    "manoeuvres": "services.cli.figures_manoeuvres",
    "guidance": "services.cli.figures_guidance",
    "ship": "services.cli.figures_ship",
}


def figures(
    names: Annotated[
        list[str] | None, typer.Argument(help="Numbers of the thesis, ship, turning, or a group; all without.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write NAME.svg into.")] = Path("figures"),
    data: Annotated[Path | None, typer.Option(help="Folder of the real ship's runs (FRT-DS-ESSO).")] = None,
    list_them: Annotated[bool, typer.Option("--list", help="Only list names, groups and titles.")] = False,
) -> None:
    """Draw figures of the thesis again, from its printed tables and from simulated campaigns."""
    if list_them:
        for name, drawing in FIGURES.items():
            print(f"{name:<12} {drawing.group:<11} {drawing.title}")
        return
    chosen = _chosen(names or [])
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CliError(f"{out}: cannot be made: {error.strerror}") from None
    from rich.console import Console
    from rich.progress import track

    from services.cli.svg import write

    for name in track(chosen, "drawing", console=Console(stderr=True), disable=not sys.stderr.isatty()):
        try:
            figure = draw(name, data)
        except CliError as error:
            if names:
                raise
            print(f"starboard: {name} left out: {error}", file=sys.stderr)
            continue
        write(out / f"{name}.svg", figure.charts, figure.caption)
        print(f"{out / name}.svg: {figure.caption}")
        for line in figure.table:
            print(f"  {line}")


def draw(name: str, data: Path | None = None) -> Figure:
    """Return one figure; raise CliError when it needs ship data that are not there."""
    drawing = FIGURES[name]
    module = importlib.import_module(_MODULES[drawing.group])
    function = getattr(module, drawing.function)
    if drawing.group == "ship":
        figure: Figure = function(data or module.DATA)
    else:
        figure = function() if drawing.argument is None else function(drawing.argument)
    return figure


def _chosen(names: list[str]) -> list[str]:
    """Return the figures that are meant, groups spelled out."""
    chosen: list[str] = []
    for name in names or list(FIGURES):
        exact = [name] if name in FIGURES else [f for f, drawing in FIGURES.items() if drawing.group == name]
        if not exact:
            raise CliError(f"no figure is called {name!r}: starboard figures --list")
        chosen += [f for f in exact if f not in chosen]
    return chosen
