"""docs/chapter-8.md: the tests, runs and pages that it names are there, and a run can be recorded and drawn."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scipy import signal

from benchmarks.chapter_8.__main__ import figure
from benchmarks.chapter_8.drawing import FIGURES, Log
from benchmarks.chapter_8.runs import RUNS
from logs.reader import Recording
from marine.control.model_function import bessel
from services.catalog import ROOT

PAGE = (ROOT / "docs/chapter-8.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and "::" in line
]
ALGORITHMS = [f"Algorithm 8.{k}" for k in range(4, 9)]
TABLES = ["Table 8.1", "Table 8.2", "Table 7.13"]
EXAMPLES = [f"Example 8.{k}" for k in range(1, 4)]
DRAWN = ["8.4", "8.9", "8.16", "8.17", "8.20", "8.21", "8.22", "8.23", "8.27"]


@pytest.mark.parametrize("what", [*ALGORITHMS, *TABLES, *EXAMPLES, *(f"Fig. {n}" for n in DRAWN), "Fig. 8.24-8.26"])
def test_everything_of_the_chapter_has_a_row(what: str) -> None:
    names = " ".join(row[0].replace(", 8.", ", Fig. 8.") for row in ROWS)
    assert what in names


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_what_a_row_names_is_there(row: list[str]) -> None:
    _, tests, runs, page = row
    text = ""
    for name in re.findall(r"`([^`]+)`", tests):
        file, _, function = name.partition("::")
        if file:
            (path,) = ROOT.glob(f"tests/*/{file}")
            text = path.read_text(encoding="utf-8")
        assert f"def {function}(" in text, name
    commands = re.findall(r"`([^`]+)`", runs)
    assert commands
    assert all(command in FIGURES or command.startswith("starboard ") for command in commands)
    assert all((ROOT / "docs" / link).is_file() for link in re.findall(r"\]\(([^)]+)\)", page))


def test_every_figure_is_drawn_on_the_page() -> None:
    shown = re.findall(r"\]\(chapter-8/(.+)\.svg\)", PAGE)
    assert set(shown) == FIGURES.keys()
    for name in shown:
        assert (ROOT / "docs/chapter-8" / f"{name}.svg").read_text(encoding="utf-8").count("<path") > 10


def test_example_8_3_recorded_on_the_star_is_its_model_function(tmp_path: Path) -> None:
    """Within 2 % of the closed loop as designed, with sensor, estimator and thrusters in it; and it is drawn."""
    made = figure(FIGURES["8.8"], tmp_path)
    assert "Overshoot 0.0 %" in made.caption
    log = Log(Recording(next(tmp_path.glob("8.8/*.mcap"))))
    t, psi = log.truth("psi_rad")
    here = t >= log.begun(1)
    _, expected = signal.step(([1.0], [*bessel(3, 1.5)[::-1], 1.0]), T=t[here] - t[here][0])
    step = psi[here][-1] - psi[here][0]
    assert abs((psi[here] - psi[here][0]) / step - expected).max() < 0.02


def test_every_run_is_drawn() -> None:
    assert {run for drawing in FIGURES.values() for run in drawing.runs} == RUNS.keys()
