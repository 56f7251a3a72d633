"""`starboard simulate`: a manoeuvre of a vessel file's model, without bus, camera or controllers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bus.messages import WRENCH_FIELDS
from services.cli.errors import CliError
from services.cli.options import Json

if TYPE_CHECKING:
    from marine.vessel import Vessel
    from services.simulator.manoeuvre import Demand, Given, Track

KINDS = ("step", "zigzag", "turning-circle")
_UNITS = {"_rad_s": ("deg/s", 180.0 / math.pi), "_rad": ("deg", 180.0 / math.pi), "_m_s": ("m/s", 1.0)}


def simulate(  # noqa: PLR0917 - typer makes an option of each
    vessel: Annotated[str, typer.Argument(help="A name in config/vessels or a file.")],
    manoeuvre: Annotated[
        str,
        typer.Option("--input", help=f"{', '.join(KINDS)}, or a CSV file: t_s and actuators, or t_s and surge_n ..."),
    ] = "step",
    against: Annotated[
        list[str] | None,
        typer.Option(help="Another vessel, or `uncoupled`: the model that estimator and controllers take. Repeatable."),
    ] = None,
    axis: Annotated[
        Literal["surge", "sway", "heave", "yaw"], typer.Option(help="step: the degree of freedom.")
    ] = "surge",
    size: Annotated[
        float, typer.Option(min=-1, max=1, help="step: force or moment; zigzag, turning-circle: yaw moment; of 1.")
    ] = 0.5,
    surge: Annotated[float, typer.Option(min=-1, max=1, help="zigzag, turning-circle: surge force, of 1.")] = 0.5,
    angle_deg: Annotated[float, typer.Option(min=0.1, max=179, help="zigzag: heading at which it turns back.")] = 20.0,
    seconds: Annotated[float, typer.Option(min=0.1, max=86400)] = 60.0,
    around: Annotated[
        Path | None, typer.Option(help="Configuration whose [simulator] has current, wind, waves, seed.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw it into this SVG file.")] = None,
    as_json: Json = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the series as CSV, in SI.")] = False,
) -> None:
    """Simulate a manoeuvre in free water from rest, and compare vessels or models."""
    from services.simulator.manoeuvre import NotPossibleError, run

    vessels = _vessels(vessel, against or [])
    surroundings, seed = _surroundings(around)
    results: list[tuple[Track, dict[str, float]]] = []
    for one in vessels:
        try:
            steer, given = _input(one, manoeuvre, axis, size, surge, math.radians(angle_deg))
        except NotPossibleError as error:
            raise CliError(str(error)) from None
        track = run(one, steer, seconds, given=given, around=surroundings, seed=seed)
        results.append((track, _figures(track, manoeuvre, axis, math.radians(angle_deg))))
    if plot is not None:
        _draw(plot, manoeuvre, [track for track, _ in results])
    if as_json:
        runs = [{"vessel": t.vessel, "figures": f, "series": t.columns, "actuators": t.actuators} for t, f in results]
        print(json.dumps({"input": manoeuvre, "runs": runs}))
    elif as_csv:
        _print_csv([track for track, _ in results])
    else:
        for track, figures in results:
            print(f"{track.vessel}: {manoeuvre}, {seconds:g} s")
            for name, value in figures.items():
                print("  " + _readable(name, value))


def _vessels(first: str, others: list[str]) -> list[Vessel]:
    from dataclasses import replace

    from services.vessels import load_vessel

    vessel = load_vessel(first)
    found = [vessel]
    for name in others:
        if name == "uncoupled":
            found.append(replace(vessel, name=f"{vessel.name} uncoupled", dynamics=vessel.model))
        else:
            found.append(load_vessel(name))
    return found


def _surroundings(path: Path | None) -> tuple[Any, int]:
    from bus.config import parse, read_toml
    from services.simulator.service import SimulatorConfig

    if path is None:
        return None, 1
    config = parse(SimulatorConfig, read_toml(path).get("simulator", {}), path, "simulator")
    return config.around, config.seed


def _input(  # noqa: PLR0917
    vessel: Vessel, kind: str, axis: str, size: float, surge: float, angle_rad: float
) -> tuple[Demand | None, Given | None]:
    """Return what drives the vessel: a wrench or commands."""
    from services.simulator import manoeuvre as m

    if kind == "step":
        return m.step(vessel, axis, size), None
    if kind == "zigzag":
        return m.zigzag(vessel, surge, size, angle_rad), None
    if kind == "turning-circle":
        return m.turning_circle(vessel, surge, size), None
    if not kind.endswith(".csv"):
        raise CliError(f"--input {kind}: no such manoeuvre; known: {', '.join(KINDS)}, or a file ending in .csv")
    return _from_file(vessel, Path(kind))


def _from_file(vessel: Vessel, path: Path) -> tuple[Demand | None, Given | None]:
    from services.simulator.manoeuvre import held

    times, rows = _read(path)
    names, actuators = set(rows[0]), {a.name for a in vessel.actuators}
    if names <= actuators:
        return None, held(times, rows)
    if names <= set(WRENCH_FIELDS):
        wrench = held(times, rows)

        def demand(t_s: float, _psi: float) -> tuple[float, float, float, float, float, float]:
            row = wrench(t_s)
            X, Y, Z, K, M, N = (row.get(name, 0.0) for name in WRENCH_FIELDS)
            return X, Y, Z, K, M, N

        return demand, None
    unknown = sorted(names - actuators - set(WRENCH_FIELDS)) or sorted(names)
    raise CliError(
        f"{path}: column {unknown[0]}: give either actuators of {vessel.name} ({', '.join(sorted(actuators))}) "
        f"or components of the wrench ({', '.join(WRENCH_FIELDS)})"
    )


def _read(path: Path) -> tuple[list[float], list[dict[str, float]]]:
    """Return times in s and the other columns row by row; raise CliError with line and reason."""
    import csv

    times: list[float] = []
    rows: list[dict[str, float]] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file)
            names = list(table.fieldnames or [])
            if "t_s" not in names or len(names) < 2:
                raise CliError(f"{path}: the first line must name t_s and at least one column more")
            for row in table:
                try:
                    values = {name: float(row[name]) for name in names}
                except (TypeError, ValueError):
                    raise CliError(f"{path}: line {table.line_num}: not {len(names)} numbers") from None
                if not all(map(math.isfinite, values.values())):
                    raise CliError(f"{path}: line {table.line_num}: not a finite number")
                if times and values["t_s"] <= times[-1]:
                    raise CliError(f"{path}: line {table.line_num}: time does not grow")
                times.append(values.pop("t_s"))
                rows.append(values)
    except OSError as error:
        raise CliError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise CliError(f"{path}: no CSV file") from None
    if not rows:
        raise CliError(f"{path}: no row in it")
    return times, rows


def _figures(track: Track, kind: str, axis: str, angle_rad: float) -> dict[str, float]:
    from services.simulator import manoeuvre as m

    if kind == "step":
        return m.step_figures(track, axis)
    if kind == "zigzag":
        return m.zigzag_figures(track, angle_rad)
    return m.circle_figures(track) if kind == "turning-circle" else {}


def _readable(name: str, value: float) -> str:
    """Return a figure with its unit, angles in degrees."""
    for suffix, (unit, scale) in _UNITS.items():
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix).replace('_', ' '):<22} {value * scale:.4g} {unit}"
    stem, _, unit = name.rpartition("_")
    return f"{stem.replace('_', ' '):<22} {value:.4g} {unit}"


def _print_csv(tracks: list[Track]) -> None:
    import csv
    import sys

    writer = csv.writer(sys.stdout)
    single = tracks[0] if len(tracks) == 1 else None
    writer.writerow(["vessel", *tracks[0].columns, *(single.actuators if single else ())])
    for track in tracks:
        series = [*track.columns.values(), *(track.actuators.values() if single else ())]
        for values in zip(*series, strict=True):
            writer.writerow([track.vessel, *values])


def _draw(path: Path, kind: str, tracks: list[Track]) -> None:
    from services.cli.svg import Chart, write

    place = Chart(f"{kind}: path", "y, m", "x, m")
    heading = Chart("heading", "time, s", "psi, deg")
    turning = Chart("yaw rate", "time, s", "r, deg/s")
    speed = Chart("velocities", "time, s", "m/s")
    commands = Chart("actuators", "time, s", "unit of the command")
    for track in tracks:
        t = track["t_s"]
        place.line(track["y_m"], track["x_m"], track.vessel)
        heading.line(t, [math.degrees(psi) for psi in track["psi_rad"]], track.vessel)
        turning.line(t, [math.degrees(r) for r in track["yaw_rad_s"]], track.vessel)
        for name in ("surge", "sway", "heave"):
            values = track[f"{name}_m_s"]
            if any(values):
                speed.line(t, values, f"{track.vessel}: {name}" if len(tracks) > 1 else name)
        for name, values in track.actuators.items():
            commands.line(t, values, name if len(tracks) == 1 else f"{track.vessel}: {name}")
    charts = [place, heading, turning, speed, *([commands] if len(tracks) == 1 else [])]
    write(path, charts)
