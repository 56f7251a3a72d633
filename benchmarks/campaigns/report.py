"""The campaigns' report: one HTML page, one JSON document, one picture for the documentation."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.campaigns import figures as f
from benchmarks.campaigns.jobs import LEVELS, MOMENT, SELF_OSCILLATIONS, SHARES, STEP_AXES, Run
from services.cli.svg import Chart, write
from services.vessels import load_vessel

_STYLE = (
    "body{font:15px system-ui,sans-serif;margin:2em auto;max-width:1150px;padding:0 1em}table{border-collapse:collapse}"
    "td,th{padding:.2em .6em;text-align:right;border-bottom:1px solid #ddd}td{white-space:nowrap}"
    "td:first-child,th:first-child{text-align:left}.missed{color:#a33;font-weight:bold}"
)
_LED_IN = (
    "Rendered pictures, tracker, estimator, controller, helm, experiment, allocator, radio protocol and simulator; "
    "every number is identified from the MCAP recording alone. The simulator obeys the model that is fitted: this "
    "shows what pictures, rounding, delay, the control of the other axes and the methods do, not how well the model "
    "fits a real vessel."
)
_CAPTION = (
    "PlaDyPos in surge through pictures, tracker and radio, by force (points: seen by the camera, lines: the fitted "
    "model); the force of every step in surge and sway over its steady speed by (9), and the simulator's drag; errors "
    "of inertia and drag in self-oscillations, sorted."
)


def document(runs: list[Run], seeds: int, failures: dict[str, str], about: dict[str, Any]) -> dict[str, Any]:
    """Return everything as one JSON document; numbers that could not be measured are null."""
    found: dict[str, Any] = _finite(
        {
            **about,
            "goals": [{**g._asdict(), "passed": g.passed} for g in f.goals(runs, seeds)],
            "steps": {axis: [row._asdict() for row in f.table(runs, axis)] for axis in STEP_AXES},
            "self_oscillations": [
                {
                    "vessel": k.vessel,
                    "axis": k.axis,
                    **f.spread(f.oscillations(runs, k.vessel, k.axis), method)._asdict(),
                }
                for k in SELF_OSCILLATIONS
                for method in f.METHODS
            ],
            "failures": failures,
            "runs": [json.loads(run.model_dump_json()) for run in runs],
        }
    )
    return found


def page(runs: list[Run], seeds: int, failures: dict[str, str], about: dict[str, Any]) -> str:
    """Return the report as a page that needs no other file."""
    goals = f.goals(runs, seeds)
    failed = "".join(f"<li>{escape(name)}: {escape(why)}" for name, why in failures.items())
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>Campaigns</title><style>{_STYLE}</style>"
        f"<h1>Identification through the whole system</h1><p>{escape(', '.join(f'{k} {v}' for k, v in about.items()))}"
        f"<p>{_LED_IN}<h2>Goals: {sum(g.passed for g in goals)} of {len(goals)} reached</h2>{_goals(goals)}"
        f"{f'<h2>Runs that failed</h2><ul>{failed}</ul>' if failures else ''}"
        f"{''.join(_axis(runs, axis) for axis in STEP_AXES)}{_equality(runs)}{_self_oscillations(runs)}"
        f"<h2>Pictures</h2><p>{_CAPTION}<p>{''.join(_svg(chart) for chart in charts(runs))}</html>"
    )


def _goals(goals: Sequence[f.Goal]) -> str:
    return _table(
        ("goal", "at most", "measured", ""),
        [(g.name, f"{g.limit:g} {g.unit}", _number(g.reached, g.unit), verdict(g)) for g in goals],
    ).replace("<td>missed", "<td class=missed>missed")


def _axis(runs: list[Run], axis: str) -> str:
    own = [r for r in runs if r.kind == "step" and r.axis == axis]
    if not own:
        return ""
    angular, rows = axis == "yaw", f.table(runs, axis)
    per = "rad" if angular else "pix"
    alpha, alpha_std, beta, beta_std = f.PRINTED[axis]
    ours, total = f.in_printed_units(own, load_vessel("pladypos")), next(r for r in rows if not r.level)
    beside = _table(
        ("", f"alpha, s²/{per}", "st. dev.", f"beta, s²/{per}²", "st. dev."),
        [
            ("pladypos Table 2", f"{alpha:g}", f"{alpha_std} %", f"{beta:g}", f"{beta_std} %"),
            ("here, whole fit", f"{ours[0]:.4g}", _number(total.std_percent[0]), f"{ours[1]:.4g}",
             _number(total.std_percent[1])),
        ],
    )  # fmt: skip
    levels = _table(
        ("force", "method", "runs", "marked", "alpha", "beta", *(f"way to {100 * share:.0f} %" for share in SHARES)),
        [_level(row, *(("rad", "Nm") if angular else ("m", "N"))) for row in rows],
    )
    nearest_m = min((r.wall_m for r in own if r.wall_m is not None), default=math.nan)
    return (
        f"<h2>Steps in {axis}: {len(own)} runs</h2><p>The simulator's truth are the paper's means; standard deviations "
        f"are those of runs.{beside}<p>Error of the mean and (standard deviation), in %:{levels}"
        f"<p>Marked: ended below 98 % of the fitted steady state. The hull was never nearer to a wall than "
        f"{nearest_m:.2f} m."
    )


def _level(row: f.Row, length: str, force: str) -> tuple[str, ...]:
    level = f"{100 * row.level:.0f} %, {row.force:.3g} {force}" if row.level else "all"
    pairs = (f"{e:+.2f} ({s:.2f})" for e, s in zip(row.error_percent, row.std_percent, strict=True))
    ways = (_number(w, length) if row.method == f.FIT else "" for w in row.ways)
    return (level, f.CITED[row.method], f"{row.runs}", f"{row.marked}", *pairs, *ways)


def _equality(runs: list[Run]) -> str:
    if not {"surge", "sway"} <= {r.axis for r in runs if r.kind == "step"}:
        return ""
    said = "; ".join(
        f"{name} differs by {off:+.3f} % ({apart:.1f} standard deviations of the means)"
        for name, (off, apart) in f.equality(runs).items()
    )
    return f"<h2>Are surge and sway equal?</h2><p>{said}. Below 2 they may be taken as equal (pladypos section 6)."


def _self_oscillations(runs: list[Run]) -> str:
    rows = []
    for kind in SELF_OSCILLATIONS:
        some = f.oscillations(runs, kind.vessel, kind.axis)
        longest_s = max((r.duration_s for r in some), default=math.nan)
        for method in f.METHODS:
            s = f.spread(some, method)
            each = (_number(v, "") for pair in (s.bias, s.percentile_95, s.worst) for v in pair)
            rows.append((f"{kind.vessel}, {kind.axis}", f.CITED[method], f"{s.runs}", _number(longest_s, "s"), *each))
    head = (
        "run",
        "method",
        "runs",
        "longest",
        "mean alpha",
        "beta",
        "95th percentile alpha",
        "beta",
        "worst alpha",
        "beta",
    )
    return (
        f"<h2>Self-oscillations</h2><p>In yaw against an unknown constant moment of {100 * MOMENT:.0f} % of C. "
        f"Errors in %:{_table(head, rows)}"
    )


def charts(runs: list[Run]) -> list[Chart]:
    """Return the pictures that there are runs for."""
    drawn = [_responses(runs), _drag(runs), *(_errors(runs, number) for number in range(2))]
    return [chart for chart in drawn if chart is not None]


def draw(path: Path, runs: list[Run]) -> None:
    """Write the picture for the documentation."""
    write(path, charts(runs), _CAPTION)


def _responses(runs: list[Run]) -> Chart | None:
    chart = Chart("Steps in surge", "time, s", "way, m")
    there = [r for r in runs if (r.kind, r.axis, r.direction) == ("step", "surge", 1)]
    shown = {level: run for level in LEVELS[::2] for run in there if run.amplitude == level}
    for level, run in shown.items():
        chart.line(run.t_s, run.simulated, f"{100 * level:.0f} %")
    for run in shown.values():
        chart.points(run.t_s[::6], run.measured[::6])
    return chart if shown else None


def _drag(runs: list[Run]) -> Chart | None:
    """Return force over steady speed as pladypos Fig. 6(a), with the speed that the paper's formula (9) takes."""
    own = [r for r in runs if r.kind == "step" and r.axis != "yaw"]
    if not own:
        return None
    chart = Chart("Drag in surge and sway", "steady speed, m/s", "force, N")
    speeds = [math.sqrt(r.force / r.methods[f.PAPER].parameters["beta_quadratic"]) for r in own]
    grid = np.linspace(0.0, 1.05 * max(speeds), 60)
    beta = f.true(own[0]).beta_quadratic
    chart.line(grid.tolist(), (beta * grid**2).tolist(), "the simulator's")
    chart.points(speeds, [r.force for r in own], "runs, by (9)")
    return chart


def _errors(runs: list[Run], number: int) -> Chart | None:
    """Return the sorted errors of alpha or beta over the seeds, projection against Table 6.3."""
    chart = Chart(f"Self-oscillations: {('inertia', 'drag')[number]}", "share of runs, %", "error below, %")
    some = False
    for kind in SELF_OSCILLATIONS:
        own = f.oscillations(runs, kind.vessel, kind.axis)
        for method in (f.PROJECTION, f.DESCRIBING):
            off = np.sort(np.abs(f.errors(own, method)[:, number]))
            if len(off):
                some = True
                share = 100.0 * (np.arange(len(off)) + 1.0) / len(off)
                name = "" if method == f.PROJECTION else ", Table 6.3"
                chart.line(share.tolist(), off.tolist(), f"{kind.vessel} {kind.axis}{name}")
    return chart if some else None


def _svg(chart: Chart) -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="460" height="360" font-family="sans-serif" font-size="12">'
        f"{chart.svg()}</svg>"
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}' for cell in row)}" for row in rows)
    return f"<table><tr>{''.join(f'<th>{escape(name)}' for name in head)}{body}</table>"


def verdict(goal: f.Goal) -> str:
    """Return reached, missed, or that there was nothing to judge."""
    return "reached" if goal.passed else "missed" if math.isfinite(goal.reached) else "no runs"


def _number(value: float, unit: str = "%") -> str:
    return f"{value:.3g} {unit}".rstrip() if math.isfinite(value) else "not measured"


def _finite(value: Any) -> Any:
    """Return the same with null for numbers that are none."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
