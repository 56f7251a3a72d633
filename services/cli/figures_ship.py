"""Figures of a real ship: zig-zags and turning circles of a 3 m model of the Esso Osaka (free-running tests)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from marine.identification import ship_runs
from marine.identification.manoeuvres import TurningCircle, rudder_over, turning_circle, zigzag_figures
from marine.identification.result import FloatArray
from marine.identification.ship_runs import Line, ShipRun
from marine.vessel import DegreeOfFreedom
from services.cli.errors import CliError
from services.cli.figure_parts import Figure
from services.cli.svg import Chart

DATA = Path(__file__).parents[3] / "shared/data/ship/esso-osaka"
"""Where the folders zigzag/ and turning/ of FRT-DS-ESSO are looked for."""
LENGTH_M = 3.0
"""Length between perpendiculars of the model."""


class Record(NamedTuple):
    """One CSV file in SI: t, x, y, psi (unwrapped), r, propeller in rps, rudder in rad (positive to starboard)."""

    name: str
    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    psi_rad: FloatArray
    r_rad_s: FloatArray
    n_rps: FloatArray
    rudder_rad: FloatArray

    @property
    def run(self) -> ShipRun:
        """The part with a steady propeller."""
        return ship_runs.steady_propeller(
            self.name,
            t_s=self.t_s,
            psi_rad=self.psi_rad,
            r_rad_s=self.r_rad_s,
            rudder_rad=self.rudder_rad,
            n_rps=self.n_rps,
        )


_COLUMNS = (
    "t [s]",
    "x_position_mid [m]",
    "y_position_mid [m]",
    "psi_hat [rad]",
    "r_angvelo [rad/s]",
    "n_prop [rps]",
    "delta_rudder [rad]",
)


def read(folder: Path) -> list[Record]:
    """Return all records of a folder by name; raise CliError where there are none, or not with these columns."""
    records = []
    for path in sorted(folder.glob("*.csv")):
        with path.open(encoding="utf-8") as file:
            header = file.readline().strip().split(",")
        missing = [c for c in _COLUMNS if c not in header]
        if missing:
            raise CliError(f"{path}: no column {missing[0]!r}")
        table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=[header.index(c) for c in _COLUMNS])
        t, x, y, psi, r, n, rudder = table.T
        records.append(Record(path.stem.split("_", 1)[1], t, x, y, np.unwrap(psi), r, n, rudder))
    if not records:
        raise CliError(f"{folder}: no CSV files; give the folder of FRT-DS-ESSO with --data DIR")
    return records


def ship(data: Path) -> Figure:
    """Every method on every zig-zag, and how well each predicts the other zig-zags."""
    runs = [record.run for record in read(data / "zigzag")]
    lines = ship_runs.cross_validation(runs)
    squares = {line.run: line for line in lines if (line.method, line.drag) == ("least squares", "linear")}
    shown, source = runs[-1].manoeuvre, runs[0]
    chart = Chart(f"zig-zag {shown.name}", "time, s", "rate of turn, deg/s")
    chart.line(shown.t_s.tolist(), np.degrees(shown.r_rad_s).tolist(), "measured")
    for name, label in ((shown.name, "own model"), (source.name, f"model of {source.name[-8:]}")):
        line = squares[name]
        predicted = ship_runs.prediction(shown, DegreeOfFreedom(line.alpha, 0.0, line.beta), line.delta)
        chart.line(shown.t_s.tolist(), np.degrees(predicted).tolist(), label)
    drags = Chart("linear drag by method", "zig-zag", "beta_rr, rad s^2/rad^2 at 10 rps")
    for method in ("least squares", "self-oscillation", "projection"):
        found = [(k + 1.0, _of(lines, run.name, method)) for k, run in enumerate(runs)]
        known = [(k, line.beta) for k, line in found if not line.refused]
        drags.points([k for k, _ in known], [b for _, b in known], method)
    drags.line([0.0, len(runs) + 1.0], [0.0, 0.0])
    best = float(np.mean([line.others for line in squares.values()]))
    caption = (
        "Real zig-zags of a 3 m model: rate of turn measured, and predicted by least squares with linear drag from "
        "this run and from another one at another speed (moment n^2 delta); linear drag of each run by each "
        f"method that could be used. A run predicts the others within {100.0 * best:.0f} % of their rms on average. "
        "Data: FRT-DS-ESSO, Osaka University, CC BY-NC 4.0."
    )
    return Figure((chart, drags), caption, tuple(table(lines)))


def turning(data: Path) -> Figure:
    """Turning circles and overshoots of the ship."""
    chart = Chart("turning circles", "to starboard of the first course, m", "along it, m")
    rows = [
        f"{'turning circle':<22}{'rudder':>8}" + "".join(f"{h:>12}" for h in ("advance/L", "transfer/L", "tactical/L"))
    ]
    for record in read(data / "turning"):
        circle, begun = circle_of(record)
        psi = record.psi_rad[begun]
        x, y = record.x_m - record.x_m[begun], record.y_m - record.y_m[begun]
        ahead, across = x * np.cos(psi) + y * np.sin(psi), y * np.cos(psi) - x * np.sin(psi)
        rudder = float(np.degrees(np.median(record.rudder_rad[begun:])))
        chart.line(across[begun::10].tolist(), ahead[begun::10].tolist(), f"{rudder:.0f} degrees of rudder")
        parts = (circle.advance_m, circle.transfer_m, circle.tactical_diameter_m)
        rows.append(f"{record.name:<22}{rudder:8.0f}" + "".join(f"{part / LENGTH_M:12.2f}" for part in parts))
    rows.append(f"{'zig-zag':<22}{'rudder':>8}{'overshoots, degrees':>26}")
    for record in read(data / "zigzag"):
        run = record.run
        overshoots = np.degrees(zigzag_figures(run.t_s, run.psi_rad, run.rudder_rad).overshoots_rad)
        said = ", ".join(f"{x:.1f}" for x in overshoots)
        rows.append(f"{record.name:<22}{np.degrees(np.max(run.manoeuvre.rudder_rad)):8.0f}{said:>26}")
    caption = (
        "Turning circles of a 3 m model of the Esso Osaka from when the rudder moved, turned onto one first course. "
        "Advance, transfer and tactical diameter are in the table, in lengths. Wind lets the circles drift. Data: "
        "FRT-DS-ESSO, Osaka University, CC BY-NC 4.0."
    )
    return Figure((chart,), caption, tuple(rows))


def circle_of(record: Record) -> tuple[TurningCircle, int]:
    """Return the figures of a turning circle, and the sample at which its rudder moved."""
    begun_s = rudder_over(record.t_s, record.rudder_rad)
    circle = turning_circle(record.t_s, record.x_m, record.y_m, record.psi_rad, rudder_s=begun_s)
    return circle, int(np.searchsorted(record.t_s, begun_s))


def table(lines: list[Line]) -> list[str]:
    """Return the table of all methods and runs, refusals with their reasons."""
    head = f"{'zig-zag':<22}{'method':<26}{'drag':<10}{'alpha':>8}{'beta':>9}{'Delta':>8}{'own %':>8}{'others %':>10}"
    rows = [head]
    for line in lines:
        start = f"{line.run:<22}{line.method:<26}{line.drag:<10}"
        if line.refused:
            rows.append(start + f" refused: {line.refused.split(':', maxsplit=1)[0]}")
            continue
        rows.append(
            start
            + f"{line.alpha:8.1f}{line.beta:9.2f}{line.delta:8.3f}{100.0 * line.own:8.1f}{100.0 * line.others:10.1f}"
        )
    return rows


def _of(lines: list[Line], run: str, method: str) -> Line:
    return next(line for line in lines if (line.run, line.method, line.drag) == (run, method, "linear"))
