"""What the runs say together: tables by force level, percentiles over seeds, and whether the goals are reached."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import NamedTuple

import numpy as np

from benchmarks.campaigns.jobs import LEVELS, SELF_OSCILLATIONS, SHARES, STEP_AXES, STEP_RUNS, Run
from marine.identification.result import DataUsed, Identified, in_paper_units, mean_and_std, parameters
from marine.identification.step import equal
from marine.vessel import DegreeOfFreedom, Vessel
from services.vessels import load_vessel

FIT, PAPER, SLOPE = "response fit", "velocity formulas", "step formulas"
PROJECTION, DESCRIBING, LEAST_SQUARES = "projection", "describing function", "least squares"
METHODS = (PROJECTION, LEAST_SQUARES, DESCRIBING)
"""Of a self-oscillation, the best first."""
NAMES = ("alpha", "beta_quadratic")
CITED = {
    FIT: "fit of the whole response, (4.46)",
    PAPER: "pladypos (9), (10)",
    SLOPE: "slope formulas, (4.47), (4.48)",
    PROJECTION: "projection on the first harmonic",
    DESCRIBING: "thesis Table 6.3",
    LEAST_SQUARES: "least squares on integrals",
}
_SURGE = (8.252, 21.37, 0.0378, 29.85)
PRINTED = {"surge": _SURGE, "sway": _SURGE, "yaw": (87.68, 17.84, 48.83, 30.81)}
"""pladypos Table 2: alpha, its deviation in %, beta, its deviation in %."""
DISTANCES_M = (1.59, 2.20, 2.67)
"""To 95, 98, 99 % of the steady speed in surge and sway."""


class Goal(NamedTuple):
    """A number to reach; `reached` and `limit` in `unit`."""

    name: str
    limit: float
    reached: float
    unit: str = "%"

    @property
    def passed(self) -> bool:
        """Whether it is reached; not with nothing measured."""
        return self.reached <= self.limit


class Row(NamedTuple):
    """Runs of one axis and force by one method, in SI; `std` in % of the mean, `error` of the mean in %."""

    level: float
    """0 for all levels together."""
    force: float
    method: str
    runs: int
    marked: int
    """Runs that end below 98 % of the fitted steady state."""
    mean: tuple[float, float]
    std_percent: tuple[float, float]
    error_percent: tuple[float, float]
    worst_percent: tuple[float, float]
    """Largest error of a single run."""
    ways: tuple[float, ...]


class Spread(NamedTuple):
    """Errors over seeds of one kind of self-oscillation by one method, in %."""

    method: str
    runs: int
    bias: tuple[float, float]
    percentile_95: tuple[float, float]
    worst: tuple[float, float]


def true(run: Run) -> DegreeOfFreedom:
    """Return the simulator's parameters."""
    found: DegreeOfFreedom = getattr(load_vessel(run.vessel).model, run.axis)
    return found


def errors(runs: Iterable[Run], method: str) -> np.ndarray:
    """Return relative errors of (alpha, beta) in %, shape (runs, 2); runs where the method failed are left out."""
    rows = [
        [100.0 * (run.methods[method].parameters[name] / float(getattr(true(run), name)) - 1.0) for name in NAMES]
        for run in runs
        if not run.methods[method].failure
    ]
    return np.array(rows).reshape(-1, 2)


def table(runs: list[Run], axis: str) -> list[Row]:
    """Return the rows of one axis: each level by each method, then all levels together."""
    own = sorted((r for r in runs if r.kind == "step" and r.axis == axis), key=lambda r: r.amplitude)
    parts = [(level, list(some)) for level, some in groupby(own, key=lambda r: r.amplitude)]
    return [_row(level, some, method) for level, some in [*parts, (0.0, own)] if some for method in (FIT, PAPER, SLOPE)]


def _row(level: float, runs: list[Run], method: str) -> Row:
    off = errors(runs, method)
    dof = true(runs[0])
    both = [mean_and_std(column) for column in off.T] if len(off) else [(np.nan, np.nan)] * 2
    mean = [float(getattr(dof, name)) * (1.0 + one[0] / 100.0) for name, one in zip(NAMES, both, strict=True)]
    ways = np.array([run.ways for run in runs], dtype=float)
    return Row(
        level,
        float(np.mean([run.force for run in runs])),
        method,
        len(off),
        sum(any("steady state" in w for w in run.methods[FIT].warnings + run.methods[PAPER].warnings) for run in runs),
        (mean[0], mean[1]),
        _pair(one[1] / (1.0 + one[0] / 100.0) for one in both),
        _pair(one[0] for one in both),
        _pair(np.abs(off).max(axis=0)) if len(off) else (np.nan, np.nan),
        tuple(float(np.nanmean(column)) if np.isfinite(column).any() else np.nan for column in ways.T),
    )


def spread(runs: list[Run], method: str) -> Spread:
    """Return how far one method is off over the seeds."""
    off = errors(runs, method)
    if not len(off):
        return Spread(method, 0, (np.nan, np.nan), (np.nan, np.nan), (np.nan, np.nan))
    size = np.abs(off)
    return Spread(
        method, len(off), _pair(off.mean(axis=0)), _pair(np.quantile(size, 0.95, axis=0)), _pair(size.max(axis=0))
    )


def oscillations(runs: list[Run], vessel: str, axis: str) -> list[Run]:
    """Return the self-oscillations of one kind."""
    return [r for r in runs if (r.kind, r.vessel, r.axis) == ("self-oscillation", vessel, axis)]


def goals(runs: list[Run], seeds: int) -> list[Goal]:
    """Return every number of the issue that can be reached or missed."""
    found: list[Goal] = []
    for axis in STEP_AXES:
        rows = table(runs, axis)
        fits = [row for row in rows if row.method == FIT]
        if sum(row.runs for row in fits if row.level) < STEP_RUNS * len(LEVELS):
            rows = fits = []
        for method, limit in ((FIT, 1.0), (PAPER, 3.0)):
            off = [abs(e) for row in rows if row.method == method for e in row.error_percent]
            found.append(Goal(f"steps in {axis}: mean at the worst level, {CITED[method]}", limit, _largest(off)))
        std = [s for row in fits for s in row.std_percent]
        found.append(Goal(f"steps in {axis}: standard deviation at the worst level, {CITED[FIT]}", 3.0, _largest(std)))
        if axis != "yaw":
            off = [100.0 * abs(m / d - 1.0) for row in fits for m, d in zip(row.ways, DISTANCES_M, strict=True)]
            found.append(Goal(f"steps in {axis}: ways to {_shares()} against 1.59, 2.20, 2.67 m", 1.0, _largest(off)))
    for kind in SELF_OSCILLATIONS:
        some = oscillations(runs, kind.vessel, kind.axis)
        p95 = spread(some, PROJECTION).percentile_95 if len(some) == seeds else (np.nan, np.nan)
        name = f"self-oscillation of {kind.vessel} in {kind.axis}"
        found.append(Goal(f"{name}: inertia, 95th percentile of {seeds} seeds", 4.0, p95[0]))
        found.append(Goal(f"{name}: drag, 95th percentile of {seeds} seeds", 5.0, p95[1]))
        found.append(Goal(f"{name}: longest run", 90.0, _largest([r.duration_s for r in some]), "s"))
    return found


def equality(runs: list[Run]) -> dict[str, tuple[float, float]]:
    """Return (difference in %, in standard deviations) of surge and sway by the fit: what pladypos leaves to do."""
    both = [together([r for r in runs if r.kind == "step" and r.axis == axis]) for axis in ("surge", "sway")]
    return {name: equal(both[0], both[1], name) for name in NAMES}


def together(runs: list[Run]) -> Identified:
    """Return mean and standard deviation (ddof = 1) over the fits of step runs, in SI."""
    values = {name: mean_and_std(np.array([r.methods[FIT].parameters[name] for r in runs])) for name in NAMES}
    return Identified(
        method=FIT,
        model="linear drag",
        parameters=parameters(
            "angular" if runs[0].axis == "yaw" else "linear",
            {name: mean for name, (mean, _) in values.items()},
            {name: std for name, (_, std) in values.items()},
        ),
        data=DataUsed(sum(len(r.t_s) for r in runs), sum(r.duration_s for r in runs), len(runs), "runs"),
        citation=CITED[FIT],
    )


def in_printed_units(runs: list[Run], vessel: Vessel) -> tuple[float, float]:
    """Return (alpha, beta) of step runs by the fit, in pladypos' units."""
    found = in_paper_units(together(runs), vessel.units)
    return found["alpha"], found["beta_quadratic"]


def _pair(values: Iterable[float]) -> tuple[float, float]:
    first, second = (float(v) for v in values)
    return first, second


def _largest(values: list[float]) -> float:
    """Return the largest value; nan, which passes nothing, when there is none or one is nan."""
    return float(np.max(values)) if values else float("nan")


def _shares() -> str:
    return ", ".join(f"{100 * share:.0f}" for share in SHARES) + " %"
