"""Campaigns through the whole system on MemoryBus, pictures to log: three seeds of what `make campaigns` runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.campaigns import figures, report
from benchmarks.campaigns.jobs import SELF_OSCILLATIONS, Found, Run, self_oscillation, steps

PLADYPOS_YAW, VIDEORAY_YAW = (k for k in SELF_OSCILLATIONS if k.axis == "yaw")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_yaw_by_camera_against_an_unknown_moment(tmp_path: Path, seed: int) -> None:
    (run,) = self_oscillation(PLADYPOS_YAW, seed, tmp_path)
    ((alpha, beta),) = figures.errors([run], figures.PROJECTION)
    assert abs(alpha) < 1.0
    assert abs(beta) < 1.0
    assert run.duration_s <= 90.0
    assert figures.errors([run], figures.DESCRIBING)[0, 1] > 5.0, "Table 6.3 replaces the wave by a sine"


def test_yaw_by_compass_against_an_unknown_moment(tmp_path: Path) -> None:
    (run,) = self_oscillation(VIDEORAY_YAW, 1, tmp_path)
    ((alpha, beta),) = figures.errors([run], figures.PROJECTION)
    assert abs(alpha) < 4.0
    assert abs(beta) < 5.0
    assert run.duration_s <= 90.0


def test_steps_of_yaw_there_and_back(tmp_path: Path) -> None:
    runs = steps("yaw", 0.82, 1, tmp_path, pairs=1)
    assert [run.direction for run in runs] == [1, -1]
    rows = {row.method: row for row in figures.table(runs, "yaw") if row.level}
    assert max(map(abs, rows[figures.FIT].error_percent)) < 1.0
    assert max(rows[figures.FIT].std_percent) < 3.0
    assert max(map(abs, rows[figures.PAPER].error_percent)) < 3.0
    assert rows[figures.FIT].marked == 0
    assert rows[figures.FIT].ways == pytest.approx((2.090, 2.898, 3.515), rel=0.02)  # alpha/beta ln(1/sqrt(1 - p^2))


def invented(alpha: float, seed: int) -> Run:
    """A run whose numbers are no result: for what a report says of them."""
    model = {"alpha": alpha, "beta_quadratic": 0.29298}
    methods = {name: Found(parameters=model) for name in (figures.PROJECTION, figures.LEAST_SQUARES)}
    methods[figures.DESCRIBING] = Found(failure="no relay")
    return Run(
        kind="self-oscillation", vessel="pladypos", axis="yaw", amplitude=0.5, direction=1, seed=seed, duration_s=50.0,
        methods=methods, force=0.5, t_s=(0.0, 1.0), measured=(0.0, 0.1), simulated=(0.0, 0.1),
    )  # fmt: skip


@pytest.mark.parametrize(("alpha", "passed"), [(0.52608 * 1.039, True), (0.52608 * 1.041, False)])
def test_the_report_judges_by_the_goals(alpha: float, passed: bool) -> None:
    runs = [invented(0.52608, 1), invented(alpha, 2), invented(alpha, 3)]
    judged = {goal.name: goal for goal in figures.goals(runs, 3)}
    assert judged["self-oscillation of pladypos in yaw: inertia, 95th percentile of 3 seeds"].passed is passed
    missing = [goal for name, goal in judged.items() if "videoray" in name or "steps" in name]
    assert missing
    assert not any(goal.passed for goal in missing), "what was not measured is not reached"
    document = report.document(runs, 3, {"a job": "its reason"}, {"seeds": 3})
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    page = report.page(runs, 3, {"a job": "its reason <"}, {"seeds": 3})
    assert "its reason &lt;" in page
    assert ("<td class=missed>missed" in page) is not passed
