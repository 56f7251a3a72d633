"""`starboard mode`: way-points from options and files; what is refused before anything is asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.cli.errors import CliError
from services.cli.mode import _line, _path, mode


def test_way_points_come_from_a_file_then_from_options(tmp_path: Path) -> None:
    file = tmp_path / "square.csv"
    file.write_text("# a square\nx_m,y_m\n1.5, 0.8\n\n3.5,0.8\n")
    assert _path(file, ["3.5,2.8", "-1, 2e-1"]) == [(1.5, 0.8), (3.5, 0.8), (3.5, 2.8), (-1.0, 0.2)]


def test_a_line_has_an_end_and_perhaps_a_beginning() -> None:
    assert _line((None, None), (2.0, 3.0)) == [(2.0, 3.0)]
    assert _line((1.0, 1.0), (2.0, 3.0)) == [(1.0, 1.0), (2.0, 3.0)]
    with pytest.raises(CliError, match="--from-x-m and --from-y-m belong together"):
        _line((1.0, None), (2.0, 3.0))


def test_what_is_no_way_point_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.csv"
    file.write_text("1,1\n2\n")
    with pytest.raises(CliError, match=r"bad\.csv, line 2: a way-point is x,y in metres, not '2'"):
        _path(file, [])
    with pytest.raises(CliError, match="--point 1;2"):
        _path(None, ["1;2"])
    with pytest.raises(CliError, match="cannot be read"):
        _path(tmp_path / "none.csv", [])


def test_mistakes_are_told_before_a_system_is_looked_for() -> None:
    with pytest.raises(CliError, match="no mode is called 'pth'; known: stop, manual"):
        mode("pth")
    with pytest.raises(CliError, match="speed_m_s"):
        mode("speed", speed_m_s=float("nan"))
    with pytest.raises(CliError, match="points"):
        mode("path", point=["1,1"] * 101)
