"""`starboard figures`: every figure is drawn, with units on its axes and a caption."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from services.cli.errors import CliError
from services.cli.figures import FIGURES, draw, figures
from services.cli.figures_ship import DATA

app = typer.Typer()
app.command()(figures)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_can_be_drawn(name: str) -> None:
    if FIGURES[name].group == "ship" and not DATA.is_dir():
        pytest.skip(f"no ship data in {DATA}")
    figure = draw(name)
    assert len(figure.caption) > 60
    assert figure.caption.endswith(".")
    for chart in figure.charts:
        assert chart.title
        assert chart.x_label
        assert chart.y_label
        ET.fromstring(chart.svg())
        assert "nan" not in chart.svg()


def test_all_figures_of_chapter_7_that_the_issue_names_are_there() -> None:
    missing = {f"7.{k}" for k in range(1, 32)} | {"6.3", "example-6.1"} | {f"example-7.{k}" for k in (1, 2, 3)}
    assert not missing - set(FIGURES)
    assert {f"8.{k}" for k in (16, 17, 20, 21, 22, 23, 24, 25, 26, 27)} <= set(FIGURES)


def test_the_limit_of_8_3_3_ends_the_spirals() -> None:
    for without, limited in (("8.20", "8.21"), ("8.22", "8.23")):
        assert "falls not all the way" in draw(without).caption
        assert "0.1 turns in all; its distance falls all the way, and ends at 0.00 m" in draw(limited).caption


def test_files_and_captions_are_written(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["7.6", "7.12", "--out", str(tmp_path / "new")])
    assert result.exit_code == 0
    assert "Table 7.9" in result.stdout
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["7.12.svg", "7.6.svg"]
    text = " ".join(t.text or "" for t in ET.parse(tmp_path / "new/7.6.svg").getroot().iter() if t.tag.endswith("text"))
    assert "difference of steady states (7.7), deg/s" in text
    assert "Largest: 17.1 printed" in text


def test_list_names_groups_and_titles() -> None:
    out = CliRunner().invoke(app, ["--list"]).stdout
    assert len(out.splitlines()) == len(FIGURES)
    assert "7.26         charlie" in out


def test_what_is_unknown_or_missing_is_one_line(tmp_path: Path) -> None:
    unknown = CliRunner().invoke(app, ["7.99", "--out", str(tmp_path)])
    assert isinstance(unknown.exception, CliError)
    assert "7.99" in str(unknown.exception)
    missing = CliRunner().invoke(app, ["ship", "--out", str(tmp_path), "--data", str(tmp_path)])
    assert isinstance(missing.exception, CliError)
    assert "--data" in str(missing.exception)
    assert not list(tmp_path.iterdir())


def test_spirals_read_the_folds_and_slopes_of_the_equation() -> None:
    """delta = a r + 400 r^3: slope 1/a at zero; for a = -2 folds at r = sqrt(1/600), 6.24 degrees apart."""
    from services.cli import figures_manoeuvres as spirals

    assert spirals.direct(2.0).loop_width_rad == 0.0
    assert spirals.reverse(2.0).slope_per_s == pytest.approx(0.5, rel=0.06)
    assert spirals.reverse(-2.0).slope_per_s == pytest.approx(-0.5, rel=0.06)
    folds = 2.0 * (2.0 * 600.0**-0.5 - 400.0 * 600.0**-1.5)
    assert spirals.reverse(-2.0).loop_width_rad == pytest.approx(folds, rel=0.02)
    assert spirals.direct(-2.0).loop_width_rad == pytest.approx(folds, abs=np.radians(1.0))  # steps of one degree
