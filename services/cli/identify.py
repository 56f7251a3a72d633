"""`starboard identify METHOD DATA`: parameters from measurements."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from services.cli.errors import CliError
from services.cli.options import Json

if TYPE_CHECKING:
    from marine.identification.record import Record
    from marine.identification.result import FloatArray, IdentificationError, Identified
    from marine.identification.thruster_map import ThrusterMap

app = typer.Typer(no_args_is_help=True, help="Parameters from measurements.", rich_markup_mode=None)

Model = Literal["quadratic", "affine", "asymmetric", "quadratic_linear"]


@app.callback(invoke_without_command=True)
def _identify(
    context: typer.Context,
    paper_tables: Annotated[
        bool, typer.Option("--paper-tables", help="Compute the papers' tables again: ours beside theirs.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Parameters from measurements: a method and its data."""
    if paper_tables:
        from services.cli.paper_tables import show

        show(as_json)
        raise typer.Exit
    if context.invoked_subcommand is None:
        raise CliError("say what: a method and its data (starboard identify --help), or --paper-tables")


@app.command()
def thruster(
    data: Annotated[Path, typer.Argument(help="CSV file with columns command and thrust_n, one row per measurement.")],
    model: Annotated[Model | None, typer.Option(help="Kind of thruster; without it the one that fits best.")] = None,
    dead_zone: Annotated[
        float | None, typer.Option(min=0.0, help="Commands up to this do nothing; without it seen in the data.")
    ] = None,
    as_json: Json = False,
    plot: Annotated[Path | None, typer.Option(help="Draw measurements and fit into this SVG file.")] = None,
) -> None:
    """Fit the thrust of a thruster over its command, from a bench or a bollard pull (thesis 4.1)."""
    from marine.identification.result import IdentificationError
    from marine.identification.thruster_map import dead_zone_of, fit_thruster

    commands, thrusts_n = _read(data)
    try:
        stated = dead_zone_of(commands, thrusts_n) if dead_zone is None else dead_zone
        fitted = fit_thruster(commands, thrusts_n, model, stated)
    except IdentificationError as error:
        raise CliError(f"{data}: {error}") from None
    n_max = float(abs(commands).max())
    stated = max(stated, fitted.begins)
    lines = _vessel_lines(fitted.identified, data, n_max, stated)
    if plot is not None:
        _draw(plot, data, fitted, commands, thrusts_n)
    if as_json:
        print(json.dumps(_document(fitted.identified, data, stated, lines)))
        return
    result = fitted.identified
    print(f"{data}: {result.data.samples} measurements, model {result.model}, {result.citation}")
    for p in result.parameters:
        print(f"  {p.name:10} {p.value:12.6g} +- {p.std:.2g} {p.unit}")
    print(f"  unexplained {result.residual_rms:.3g} N rms; dead zone {stated:g}")
    for warning in result.warnings:
        print(f"  warning: {warning}")
    print("\nfor the vessel file, under [[actuator]]:\n" + "\n".join(lines))


METHODS = {
    "projection": ("projection", "Projection on the first harmonics: any oscillation, relay or zig-zag."),
    "describing-function": ("describing function", "Self-oscillation by the formulas of thesis Table 6.3."),
    "least-squares": ("least squares", "Least squares on integrals, thesis 4.2: any manoeuvre that varies its force."),
    "zig-zag-integrals": ("zig-zag integrals", "Zig-zag by integrals, thesis 4.4: constant drag."),
    "response-fit": ("response fit", "Fit of the simulated response: step, pull-out, anything."),
    "step-fit": ("step fit", "Fit of a step response at constant force, thesis (4.46)."),
    "step-formulas": ("step formulas", "Step response by slope and velocity error, thesis Table 4.1."),
    "velocity-formulas": ("velocity formulas", "Step response by steady speed and time to 76 %, pladypos (9), (10)."),
}
"""Command -> method of marine.identification.record, help."""

_Axis = Literal["surge", "sway", "heave", "yaw"]
_Drag = Literal["constant", "linear", "both"]


def _command(method: str, text: str) -> Any:
    def run(  # noqa: PLR0917 - typer makes options of them
        data: Annotated[Path, typer.Argument(help="Recording (.mcap), or .csv with a header.")],
        axis: Annotated[_Axis | None, typer.Option(help="Of the data.")] = None,
        drag: Annotated[_Drag, typer.Option(help="Form of the drag coefficient.")] = "linear",
        experiment: Annotated[int | None, typer.Option(help="Which of a log's experiments, from 1: the last.")] = None,
        begin_s: Annotated[float | None, typer.Option(help="From here: time in the log, or of the CSV.")] = None,
        end_s: Annotated[float | None, typer.Option(help="Up to here.")] = None,
        sample_s: Annotated[float | None, typer.Option(min=0.001, help="Resample to this.")] = None,
        delay_s: Annotated[float, typer.Option(min=0.0, help="Known delay from force to measured motion.")] = 0.0,
        columns: Annotated[str, typer.Option(help="CSV: time=NAME,eta=NAME,tau=NAME; s, m or rad, N or Nm.")] = "",
        degrees: Annotated[bool, typer.Option("--degrees", help="CSV: headings are in degrees.")] = False,
        flip: Annotated[str, typer.Option(help="Turn the sign of eta, tau or eta,tau.")] = "",
        vessel: Annotated[
            str | None, typer.Option(help="Vessel, name or file: its limits; and --save puts the model into it.")
        ] = None,
        save: Annotated[Path | None, typer.Option(help="Write a vessel file with this model here.")] = None,
        report: Annotated[Path | None, typer.Option(help="Write an HTML report here.")] = None,
        as_json: Json = False,
    ) -> None:
        from marine.identification.record import identify
        from marine.identification.result import IdentificationError
        from services.cli.identify_data import Source, load
        from services.cli.identify_report import document, lines, model_error, write_report

        source = Source(axis, experiment, begin_s, end_s, sample_s, delay_s, columns, degrees, flip)
        record, told = load(data, source)
        try:
            found = identify(record, method, drag, _limit(vessel, record.axis, axis))
        except IdentificationError as error:
            raise CliError(f"{data}: {error}") from None
        misfit = model_error(record, found)
        print(json.dumps(document(found, told, misfit)) if as_json else "\n".join(lines(found, told, misfit)))
        if report is not None:
            write_report(report, record, found, _compared(record, drag), told)
        if save is not None:
            _save(found, vessel, axis, save, data)

    run.__doc__ = text
    return run


for _name, (_method, _text) in METHODS.items():
    app.command(_name)(_command(_method, _text))


@app.command()
def merge(
    vessel: Annotated[str, typer.Argument(help="Vessel, name or file, that the models go into.")],
    files: Annotated[
        list[Path] | None, typer.Argument(help="Vessel files of experiments; none: the newest of each axis there is.")
    ] = None,
    save: Annotated[Path, typer.Option(help="Write the vessel file here.")] = Path("merged.toml"),
    recordings: Annotated[Path, typer.Option(help="Where `identified/` is.")] = Path("recordings"),
) -> None:
    """One vessel file of the axes that experiments have identified, each in a file of its own."""
    from services.identified_vessel import IdentifiedVesselError, merge_models
    from services.vessels import vessel_path

    source = vessel_path(vessel)
    if not files:
        folder = recordings / "identified"
        newest = (sorted(folder.glob(f"{source.stem}-{axis}-*.toml"))[-1:] for axis in get_args(_Axis))
        files = [path for found in newest for path in found]
        if not files:
            raise CliError(f"{folder} has no vessel files of {source.stem}: name them, or --recordings FOLDER")
    try:
        taken = merge_models(source, files, save)
    except IdentifiedVesselError as error:
        raise CliError(str(error)) from None
    except OSError as error:
        raise CliError(f"{error.filename}: {error.strerror}") from None
    for axis, path in taken.items():
        print(f"{axis}: {path}")
    print(f"vessel file: {save}")


def _limit(vessel: str | None, kind: str, axis: _Axis | None) -> float | None:
    """Return the largest force (N) or moment (Nm) of a vessel's actuators on an axis; None when nobody said which."""
    from marine.allocation import axis_limits
    from services.vessels import load_vessel

    name = "yaw" if kind == "angular" else axis
    if vessel is None or name is None:
        return None
    return float(axis_limits(load_vessel(vessel))[{"surge": 0, "sway": 1, "heave": 2, "yaw": 5}[name]])


def _compared(record: Record, drag: _Drag) -> list[tuple[str, Identified | IdentificationError]]:
    """Return what every method makes of the record, or why it cannot be used."""
    from marine.identification.record import METHODS as ALL
    from marine.identification.record import identify
    from marine.identification.result import IdentificationError

    found: list[tuple[str, Identified | IdentificationError]] = []
    for name in ALL:
        try:
            found.append((name, identify(record, name, drag)))
        except IdentificationError as error:
            found.append((name, error))
    return found


def _save(found: Identified, vessel: str | None, axis: _Axis | None, target: Path, data: Path) -> None:
    from services.identified_vessel import IdentifiedVesselError, write_vessel
    from services.vessels import vessel_path

    if vessel is None or axis is None:
        raise CliError("--save needs --vessel (which file to put the model into) and --axis")
    try:
        write_vessel(vessel_path(vessel), target, axis, found, data.name)
    except IdentifiedVesselError as error:
        raise CliError(f"{target}: {error}") from None
    except OSError as error:
        raise CliError(f"{target}: cannot be written: {error.strerror}") from None


def _read(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return commands and thrusts in N of a CSV file; raise CliError with line and reason."""
    import csv

    import numpy as np

    rows: list[tuple[float, float]] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file)
            missing = [name for name in ("command", "thrust_n") if name not in (table.fieldnames or ())]
            if missing:
                raise CliError(f"{path}: no column {missing[0]}; the first line must name: command,thrust_n")
            for row in table:
                try:
                    rows.append((float(row["command"]), float(row["thrust_n"])))
                except (TypeError, ValueError):
                    raise CliError(f"{path}: line {table.line_num}: not two numbers") from None
    except OSError as error:
        raise CliError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise CliError(f"{path}: no CSV file; it must begin with the line: command,thrust_n") from None
    if not rows:
        raise CliError(f"{path}: no measurement in it")
    table_of = np.array(rows)
    return table_of[:, 0], table_of[:, 1]


def _vessel_lines(result: Identified, data: Path, n_max: float, dead_zone: float) -> list[str]:
    """Return the lines of a vessel file that describe the thruster."""
    lines = [f'kind = "{result.model}"']
    for p in result.parameters:
        lines.append(f"{p.name} = {p.value:.8g}  # {data.name}: +- {p.std:.2g} {p.unit}")
    lines.append(f"n_max = {n_max:g}  # largest command measured")
    if dead_zone:
        lines.append(f"dead_zone = {dead_zone:g}")
    return lines


def _document(result: Identified, data: Path, dead_zone: float, lines: list[str]) -> dict[str, object]:
    import math

    return {
        "method": "thruster",
        "data": str(data),
        "model": result.model,
        "parameters": [
            {"name": p.name, "value": p.value, "std": p.std if math.isfinite(p.std) else None, "unit": p.unit}
            for p in result.parameters
        ],
        "dead_zone": dead_zone,
        "residual_rms_n": result.residual_rms,
        "samples": result.data.samples,
        "warnings": list(result.warnings),
        "citation": result.citation,
        "vessel_file": lines,
    }


def _draw(path: Path, data: Path, fitted: ThrusterMap, commands: FloatArray, thrusts_n: FloatArray) -> None:
    import numpy as np

    from services.cli.svg import Chart, write

    chart = Chart(f"{data.name}: {fitted.identified.model}", "command", "thrust, N")
    n = np.linspace(commands.min(), commands.max(), 200)
    chart.line(n.tolist(), [fitted.curve.thrust(x) for x in n.tolist()], "fit")
    chart.points(commands.tolist(), thrusts_n.tolist(), "measured")
    write(path, [chart])
