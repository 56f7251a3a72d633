"""A real ship: the yaw model fitted to one zig-zag of the Esso Osaka model, and what it says of the others.

Free-running 3 m model on a pond, in wind (data/ship/esso-osaka). Model: yaw of thesis (2.38), constant drag, with
n^2 delta as input (n: propeller speed). `python -m benchmarks.ship FILE.svg` draws all predictions.
"""

from __future__ import annotations

import itertools
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.result import NotMeasured, Result
from marine.identification import least_squares, validation
from marine.identification.result import FloatArray

DATA = Path(__file__).parents[2] / "shared/data/ship/esso-osaka/zigzag"


@dataclass(frozen=True)
class Run:
    """One zig-zag: time in s, yaw rate in rad/s, propeller speed in 1/s, rudder in rad; shape (n,)."""

    name: str
    t_s: FloatArray
    r_rad_s: FloatArray
    n_rps: FloatArray
    delta_rad: FloatArray

    def moment(self, with_propeller: bool) -> FloatArray:
        """Return the input of the yaw model, in units of its own."""
        return (self.n_rps / 10.0) ** 2 * self.delta_rad if with_propeller else self.delta_rad


@dataclass(frozen=True)
class Prediction:
    """A model of one run, on another or the same. error: RMS of the yaw rate's error over its standard deviation."""

    fitted: Run
    predicted: Run
    r_rad_s: FloatArray
    error: float


def runs() -> list[Run]:
    """Return all zig-zags; raise NotMeasured without the data."""
    paths = sorted(DATA.glob("*.csv"))
    if not paths:
        raise NotMeasured(f"no zig-zags in {DATA}")
    tables = [(p.stem[-8:], np.genfromtxt(p, delimiter=",", skip_header=1)) for p in paths]
    return [Run(name, t[:, 0], t[:, 6], t[:, 7], t[:, 8]) for name, t in tables]


def predict(fitted: Run, predicted: Run, *, with_propeller: bool = True) -> Prediction:
    """Fit the yaw model to one run by least squares (4.20) and simulate another from its inputs alone."""
    found = least_squares.uncoupled(
        fitted.t_s, fitted.moment(with_propeller), nu=fitted.r_rad_s, drag="constant", axis="angular"
    )
    r = validation.simulate(
        validation.model_of(found),
        predicted.t_s,
        predicted.moment(with_propeller),
        nu_0=float(predicted.r_rad_s[0]),
        delta=found["delta"],
    )
    error = float(np.sqrt(np.mean((r - predicted.r_rad_s) ** 2)) / np.std(predicted.r_rad_s))
    return Prediction(fitted, predicted, r, error)


def measure() -> list[Result]:
    """Return medians over all ordered pairs of different runs, and over runs predicted by their own model."""
    every = runs()
    pairs = list(itertools.permutations(every, 2))

    def others(with_propeller: bool) -> list[float]:
        return [100.0 * predict(a, b, with_propeller=with_propeller).error for a, b in pairs]

    errors = others(with_propeller=True)
    own = statistics.median(100.0 * predict(run, run).error for run in every)
    return [
        Result(
            "ship_yaw_rate_prediction_error_p50_percent",
            statistics.median(errors),
            {"rudder_alone": statistics.median(others(with_propeller=False)), "mean_of_the_run": 100.0},
        ),
        Result("ship_yaw_rate_prediction_error_worst_percent", max(errors)),
        Result("ship_yaw_rate_own_run_error_p50_percent", own),
    ]


def draw(path: Path) -> None:
    """Draw every run with what the first run's model says of it (of the first: the second's)."""
    from services.cli.svg import Chart, write

    every = runs()
    charts = []
    for run in every:
        teacher = every[1] if run is every[0] else every[0]
        found = predict(teacher, run)
        title = f"run {run.name}: model of {teacher.name}, {100 * found.error:.0f} % error"
        chart = Chart(title, "time, s", "yaw rate, deg/s")
        chart.line(run.t_s.tolist(), np.degrees(run.r_rad_s).tolist(), "measured")
        chart.line(run.t_s.tolist(), np.degrees(found.r_rad_s).tolist(), "predicted")
        charts.append(chart)
    write(path, charts)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
