"""The papers' tables computed again: ours beside theirs, for tests and `starboard identify --paper-tables`.

Everything is computed from other columns of a table (or simulated from the parameters printed with it); nothing is
echoed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import log, pi, radians

import numpy as np

from marine.identification import paper_tables as printed
from marine.identification.model_choice import CRITERIA, count, spread_percent
from marine.identification.oscillation import Oscillation, measure
from marine.identification.relay_loop import RelayLoop
from marine.identification.self_oscillation import marine_parameters
from marine.identification.step import from_type_1
from marine.vessel import DegreeOfFreedom

NOT_COMPUTABLE = {
    "pladypos 2": "only means and spreads are printed, not the runs",
    "7.13": "the relays are printed, the oscillations only drawn",
    "7.6 (surge)": "C is not printed; per unit C see docs/errata.md",
}
"""Tables and sections from which nothing can be computed, and why."""


@dataclass(frozen=True)
class Row:
    """One row of a table: label, our values and the printed ones in the same order."""

    label: str
    ours: tuple[float, ...]
    theirs: tuple[float, ...]

    @property
    def relative_error(self) -> float:
        """Return the largest relative difference of the row."""
        return max(abs(o - t) / abs(t) if t else abs(o) for o, t in zip(self.ours, self.theirs, strict=True))


@dataclass(frozen=True)
class Table:
    """A table of a paper, computed again."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    @property
    def max_relative_error(self) -> float:
        """Return the largest relative difference of the table."""
        return max(row.relative_error for row in self.rows)


@cache
def tables() -> tuple[Table, ...]:
    """Return all tables that can be computed from what is printed."""
    return (
        *_delay_and_sampling(),
        *_examples(),
        _least_squares("7.7", printed.TABLE_7_7, "beta_r"),
        _least_squares("7.8", printed.TABLE_7_8, "beta_rr"),
        self_oscillations("7.9", printed.TABLE_7_9, printed.TABLE_7_9_DELAY_S),
        _spread("7.9", printed.TABLE_7_9, printed.TABLE_7_9_DELAY_S, (), printed.TABLE_7_9_SIGMA_PERCENT),
        step_responses(),
        _step_spread(),
        self_oscillations("7.11", printed.TABLE_7_11, 0.0),
        _spread("7.11", printed.TABLE_7_11, 0.0, printed.TABLE_7_11_MEAN, printed.TABLE_7_11_SIGMA_PERCENT),
        _decisions("section 7.1 VideoRay", printed.TABLE_7_9, printed.DECISIONS_VIDEORAY),
        _decisions("section 7.1 AutoMarine", printed.TABLE_7_11, printed.DECISIONS_AUTOMARINE),
        _charlie(),
    )


def self_oscillations(name: str, rows: Sequence[printed.IsoRow], delay_s: float) -> Table:
    """Return Table 7.9 or 7.11: alpha_r, beta_r, beta_rr from X_m, omega, x_a*, x_0 by Table 6.3 and (6.31)."""
    done = tuple(
        Row(f"C {r.C:g}, X_m {r.X_m:g}", yaw_parameters(r, delay_s), (r.alpha, r.beta, r.beta_quadratic)) for r in rows
    )
    return Table(name, f"self-oscillations in yaw, T_d = {delay_s:g} s", ("alpha_r", "beta_r", "beta_rr"), done)


def yaw_parameters(r: printed.IsoRow, delay_s: float) -> tuple[float, float, float]:
    """Return (alpha_r, beta_r, beta_rr) of a row in the units of the thesis' tables (see `paper_tables`)."""
    p = marine_parameters(Oscillation(1e-2 * r.C, r.x_a, r.X_m, r.omega, r.x_0), delay_s)
    return 1e4 * p["alpha"], 1e4 * p["beta"], 1e6 * p["beta_quadratic"]


def step_responses() -> Table:
    """Return Table 7.10 from N, k_ss, eps_v by Table 4.1; alpha from the printed beta_rr (docs/errata.md).

    N is printed with two decimals, its twelve sizes are equal steps: the line through them has N to more digits.
    """
    done = []
    sizes = np.unique([abs(r.N) for r in printed.TABLE_7_10])
    equal_steps = np.polyval(np.polyfit(np.arange(len(sizes)), sizes, 1), np.arange(len(sizes)))
    for r in printed.TABLE_7_10:
        N = 1e-2 * float(np.copysign(np.interp(abs(r.N), sizes, equal_steps), r.N))
        _, beta = from_type_1(N, r.k_ss, 0.0, 0.0, "constant")
        _, quadratic = from_type_1(N, r.k_ss, 0.0, 0.0, "linear")
        alpha = r.beta_quadratic * r.eps_v / log(2.0) * 1e-2
        ours = (1e4 * beta, 1e6 * quadratic, alpha)
        done.append(Row(f"N {r.N:g}", ours, (r.beta, r.beta_quadratic, r.alpha)))
    return Table("7.10", "step responses of AutoMarine's yaw", ("beta_r", "beta_rr", "alpha_r"), tuple(done))


def _delay_and_sampling() -> Iterator[Table]:
    """Yield Tables 6.1 and 6.2: Examples 6.2 (delay) and 6.3 (sampling), simulated; K and T of 50/(s (0.3 s + 1))."""
    dof = DegreeOfFreedom(0.3 / 50.0, 1.0 / 50.0, 0.0)
    delayed = RelayLoop(dof, 1.0, 10.0, delay_s=0.1, sample_time_s=0.0025)
    found = _settled(delayed, 24.0)
    without, corrected = _gain_and_time(found), _gain_and_time(found, 0.1)
    yield Table(
        "6.1",
        "Example 6.2, a delay of 0.1 s, simulated",
        ("K", "T"),
        (Row("delay ignored", without, (76.98, 0.6037)), Row("delay corrected", corrected, (55.14, 0.346))),
    )
    rows = []
    for x_a, theirs in ((16.0, (67.43, 0.526)), (20.0, (53.94, 0.325)), (None, (53.2, 0.311))):
        found = _settled(RelayLoop(dof, 1.0, x_a or 16.0, sample_time_s=0.1), 60.0)
        used = found if x_a is None else Oscillation(found.C, x_a, found.X_m, found.omega)
        rows.append(Row("x_a* as switched" if x_a is None else f"x_a {x_a:g}", _gain_and_time(used), theirs))
    yield Table("6.2", "Example 6.3, sampled at 0.1 s, simulated", ("K", "T"), tuple(rows))
    oscillation = (found.X_m, 2.0 * pi / found.omega, found.x_a)
    yield Table(
        "Example 6.3",
        "the oscillation itself, simulated (X_m corrected, see errata)",
        ("X_m", "T", "x_a*"),
        (Row("sampled at 0.1 s", oscillation, (24.74, 2.8, 20.28)),),
    )


def _gain_and_time(o: Oscillation, delay_s: float = 0.0) -> tuple[float, float]:
    p = marine_parameters(o, delay_s)
    return 1.0 / p["beta"], p["alpha"] / p["beta"]


def _settled(loop: RelayLoop, duration_s: float) -> Oscillation:
    """Return the oscillation in the second half of a simulated experiment."""
    t, eta, tau = loop.run(duration_s, steps=1)
    half = len(t) // 2
    return measure(t[half:], eta[half:, 0], tau[half:, 0], axis="linear")[0]


def _examples() -> Iterator[Table]:
    """Yield Tables 7.2, 7.4, 7.6 by formula, and 7.1, 7.3, 7.5 by simulating the experiments on their parameters."""
    for e in printed.EXAMPLES:
        unit = radians(1.0) if e.angle else 1.0
        formula, simulated = [], []
        for r in e.runs:
            p = marine_parameters(Oscillation(r.C, unit * r.x_a, unit * r.X_m, r.omega))
            label = f"C {r.C:g}, x_a {r.x_a:g}"
            formula.append(Row(label, tuple(p.values()), (r.alpha, r.beta, r.beta_quadratic)))
            dof = DegreeOfFreedom(e.alpha, e.beta, e.beta_quadratic)
            o = _settled(RelayLoop(dof, r.C, unit * r.x_a, e.delta, sample_time_s=0.01 / r.omega), 60.0 / r.omega)
            simulated.append(Row(label, (o.X_m / unit, o.omega), (r.X_m, r.omega)))
        before = f"7.{int(e.table[2:]) - 1}"
        yield Table(
            before, f"its vessel simulated, against the oscillation in {e.table}", ("X_m", "omega"), tuple(simulated)
        )
        yield Table(
            e.table, "Table 6.3 on the printed oscillation", ("alpha", "beta", "beta_quadratic"), tuple(formula)
        )
        one, other = ((r.alpha, r.beta, r.beta_quadratic) for r in e.runs)
        sigma = tuple(e.sigma_factor * spread_percent(a, b) for a, b in zip(one, other, strict=True))
        yield Table(
            f"{e.table} spread",
            "(7.1) on the printed parameters",
            ("alpha %", "beta %", "beta_quadratic %"),
            (Row("sigma", sigma, e.sigma_percent),),
        )


def _least_squares(name: str, t: printed.LeastSquaresTable, drag: str) -> Table:
    """Return Table 7.7 or 7.8: means of the groups, and mean and spread of those (the raw data are not printed)."""
    alpha, beta = ([float(np.mean(g)) for g in groups] for groups in (t.alpha, t.drag))
    groups = zip(alpha, beta, t.alpha_means, t.drag_means, strict=True)
    rows = [Row(f"group {i}", (a, b), (a_t, b_t)) for i, (a, b, a_t, b_t) in enumerate(groups, 1)]
    drag_mean = float(np.mean(beta[1:] if t.drag_mean_skips_first else beta))
    rows.append(Row("mean", (float(np.mean(alpha[1:])), drag_mean), (t.alpha_mean, t.drag_mean)))
    spread = (_percent(alpha[1:]), 100.0 * float(np.std(beta, ddof=1)) / drag_mean)
    rows.append(Row("spread %", spread, (t.alpha_sigma_percent, t.drag_sigma_percent)))
    return Table(name, "least squares of VideoRay's yaw: means of groups", ("alpha_r", drag), tuple(rows))


def _spread(
    of: str,
    rows: Sequence[printed.IsoRow],
    delay_s: float,
    means: tuple[float, ...],
    sigmas: tuple[float, float, float],
) -> Table:
    """Return mean (if printed) and spread (ddof = 1) of the parameters that we compute."""
    columns = list(zip(*(yaw_parameters(r, delay_s) for r in rows), strict=True))
    done = [Row("spread %", tuple(_percent(c) for c in columns), sigmas)]
    if means:
        done.insert(0, Row("mean", tuple(float(np.mean(c)) for c in columns), means))
    return Table(
        f"{of} spread", f"over the rows of {of} as we compute them", ("alpha_r", "beta_r", "beta_rr"), tuple(done)
    )


def _step_spread() -> Table:
    columns = list(zip(*((r.ours[2], r.ours[0], r.ours[1]) for r in step_responses().rows), strict=True))
    rows = (
        Row("mean", tuple(float(np.mean(c)) for c in columns), printed.TABLE_7_10_MEAN),
        Row("spread %", tuple(_percent(c) for c in columns), printed.TABLE_7_10_SIGMA_PERCENT),
    )
    return Table("7.10 spread", "over the rows of 7.10 as we compute them", ("alpha_r", "beta_r", "beta_rr"), rows)


def _percent(values: Sequence[float]) -> float:
    return 100.0 * float(np.std(values, ddof=1) / np.mean(values))


def _decisions(name: str, rows: Sequence[printed.IsoRow], theirs: Sequence[tuple[int, int, int]]) -> Table:
    """Return the decisions of all pairs by (7.2) on the printed parameters; errors count in parts of all pairs."""
    experiments = [(r.C, {"alpha": r.alpha, "beta": r.beta, "beta_quadratic": r.beta_quadratic}) for r in rows]
    done = tuple(
        Row(f"criterion {c}", count(experiments, c), expected) for c, expected in zip(CRITERIA, theirs, strict=True)
    )
    return Table(name, "pairs that decide for each model, (7.2)", ("linear drag", "constant drag", "none"), done)


def _charlie() -> Table:
    """Return the time of five oscillations of Charlie (C = 25, x_a = 10 degrees) with Table 7.12, against 8.1.5."""
    times = []
    for r in printed.TABLE_7_12:
        loop = RelayLoop(DegreeOfFreedom(r.alpha_linear, r.beta, 0.0), radians(25.0), radians(10.0), sample_time_s=0.05)
        times.append(5.0 * 2.0 * pi / _settled(loop, 120.0).omega)
    row = Row("mean of ten settings", (float(np.mean(times)),), (80.0,))
    return Table("7.12", 'five oscillations with C 25, x_a 10 degrees; "about 80 s" in 8.1.5', ("time_s",), (row,))
