import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from services.cli.attainable_plot import draw_attainable
from services.cli.errors import CliError
from services.cli.svg import Chart, write
from services.cli.vessels import vessels
from services.vessels import load_vessel

SVG = "{http://www.w3.org/2000/svg}"


def test_the_plot_shows_every_pair_of_axes_with_its_units(tmp_path: Path) -> None:
    path = tmp_path / "pladypos.svg"
    vessels("pladypos", plot=path)
    root = ET.parse(path).getroot()
    texts = [t.text for t in root.iter(f"{SVG}text")]
    assert [texts.count(label) for label in ("X, N", "Y, N", "N, Nm")] == [2, 2, 2]
    areas = [p.get("d", "") for p in root.iter(f"{SVG}path") if p.get("fill-opacity")]
    assert len(areas) == 6
    assert all(area.count("L") == 3 for area in areas)  # four thrusters in X: diamonds


def test_the_corners_lie_where_the_axes_say(tmp_path: Path) -> None:
    chart = Chart("t", "x, m", "y, m")
    chart.line([0.0, 10.0], [-1.0, 1.0])
    write(tmp_path / "line.svg", [chart])
    root = ET.parse(tmp_path / "line.svg").getroot()
    path = next(p.get("d", "") for p in root.iter(f"{SVG}path") if p.get("fill") == "none")
    ticks = {t.text: (t.get("x"), t.get("y")) for t in root.iter(f"{SVG}text")}
    start, end = (tuple(map(float, pair.split())) for pair in path[1:].split("L"))
    assert end[0] == pytest.approx(float(ticks["10"][0] or 0), abs=0.1)
    assert start[1] == pytest.approx(float(ticks["-1"][1] or 0) - 4, abs=0.1)
    assert end[1] == pytest.approx(float(ticks["1"][1] or 0) - 4, abs=0.1)


@pytest.mark.parametrize(
    ("vessel", "file", "reason"),
    [("charlie", "c.svg", "rudder"), ("pladypos", "p.png", "ending in .svg"), ("pladypos", "no/p.svg", "cannot be")],
)
def test_what_cannot_be_drawn_is_one_line(tmp_path: Path, vessel: str, file: str, reason: str) -> None:
    with pytest.raises(CliError, match=reason):
        draw_attainable(load_vessel(vessel), tmp_path / file)


def test_a_plot_of_all_vessels_is_refused() -> None:
    with pytest.raises(CliError, match="needs one vessel"):
        vessels(plot=Path("all.svg"))
