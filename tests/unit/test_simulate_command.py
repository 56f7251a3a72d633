"""`starboard simulate`."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from pathlib import Path
from typing import Any

import pytest

from marine.dynamics.step_response import steady_speed, time_constant
from services.cli.main import main
from services.simulator import manoeuvre
from services.vessels import load_vessel


@pytest.fixture
def starboard(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Return a function that runs the command line and returns (exit code, stdout, stderr)."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["starboard", "simulate", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return run


def test_a_step_ends_at_the_speed_of_the_paper_s_formula(starboard: Any) -> None:
    code, out, _ = starboard("pladypos", "--json", "--seconds", "90", "--size", "1")
    assert code == 0
    found = json.loads(out)["runs"][0]
    vessel = load_vessel("pladypos")
    series = found["series"]
    speed = found["figures"]["final_surge_m_s"]
    force = manoeuvre.reach(vessel, "surge", 1.0)
    assert speed == pytest.approx(steady_speed(vessel.model.surge, force), rel=0.002)
    T = time_constant(vessel.model.surge, vessel.model.surge.beta_quadratic * speed**2)
    assert found["figures"]["time_to_63_percent_s"] == pytest.approx(T * math.atanh(0.632), abs=0.1)  # (4.35)
    assert len(series["t_s"]) == 1801
    assert set(found["actuators"]) == {a.name for a in vessel.actuators}


def test_a_turning_circle_has_the_radius_its_path_shows(starboard: Any) -> None:
    _, out, _ = starboard("charlie", "--input", "turning-circle", "--seconds", "200", "--json", "--surge", "0.56")
    run = json.loads(out)["runs"][0]
    x, y = run["series"]["x_m"][-1500:], run["series"]["y_m"][-1500:]
    lap = round(math.tau / abs(run["figures"]["yaw_rad_s"]) / 0.05)
    width = max(x[-lap:]) - min(x[-lap:])
    assert width == pytest.approx(2.0 * run["figures"]["radius_m"], rel=0.02)
    assert max(y[-lap:]) - min(y[-lap:]) == pytest.approx(width, rel=0.02)


def test_a_zigzag_turns_back_at_its_angle_and_models_are_compared(starboard: Any, tmp_path: Path) -> None:
    code, out, _ = starboard(
        "charlie", "--input", "zigzag", "--angle-deg", "15", "--seconds", "120", "--json",
        "--against", "uncoupled", "--against", "falcon", "--plot", str(tmp_path / "z.svg"),
    )  # fmt: skip
    assert code == 0
    runs = json.loads(out)["runs"]
    assert [r["vessel"] for r in runs] == ["charlie", "charlie uncoupled", "falcon"]
    for run in runs:
        peak = max(map(abs, run["series"]["psi_rad"]))
        figures = run["figures"]
        overshoots = max(figures["first_overshoot_rad"], figures["second_overshoot_rad"])
        assert 0.0 < overshoots <= peak - math.radians(15.0) + 1e-9
        assert 1.0 < figures["period_s"] < 60.0
    assert runs[0]["figures"]["period_s"] != runs[1]["figures"]["period_s"]
    picture = (tmp_path / "z.svg").read_text()
    assert "psi, deg" in picture
    assert "charlie uncoupled" in picture


def test_inputs_from_a_file(starboard: Any, tmp_path: Path) -> None:
    file = tmp_path / "in.csv"
    file.write_text("t_s,throttle,rudder\n0,0.5,0\n5,0.5,0.3\n")
    code, out, _ = starboard("telemetron", "--input", str(file), "--seconds", "10", "--csv")
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(out)))
    assert all(float(r["psi_rad"]) == 0.0 for r in rows if float(r["t_s"]) < 5.0)
    assert float(rows[-1]["psi_rad"]) > 0.1
    assert float(rows[-1]["rudder"]) == pytest.approx(0.3)
    file.write_text("t_s,surge_n\n0,1.0\n")
    _, out, _ = starboard("pladypos_metric", "--input", str(file), "--json")
    surge = load_vessel("pladypos_metric").model.surge
    assert json.loads(out)["runs"][0]["series"]["surge_m_s"][-1] == pytest.approx(steady_speed(surge, 1.0), rel=1e-3)


def test_current_and_seed_come_from_a_configuration(starboard: Any, tmp_path: Path) -> None:
    file = tmp_path / "pool.toml"
    file.write_text("[simulator]\ncurrent_x_m_s = 0.0\ncurrent_y_m_s = 0.2\n")
    _, out, _ = starboard("pladypos", "--size", "0", "--around", str(file), "--json", "--seconds", "300")
    assert json.loads(out)["runs"][0]["series"]["y_m"][-1] > 40.0
    file.write_text("[simulator]\nstorm = 1\n")
    code, _, err = starboard("pladypos", "--around", str(file))
    assert code == 2
    assert "simulator.storm: no such key" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["pladypos", "--input", "loop"], "known: step, zigzag, turning-circle, or a file ending in .csv"),
        (["telemetron", "--axis", "sway"], "telemetron has no actuator for sway; it controls surge, yaw"),
        (["titanic"], "no such vessel; known: automarine"),
        (["pladypos", "--input", "none.csv"], "none.csv: cannot be read"),
        (["pladypos", "--plot", "picture.png"], "plots are written as SVG"),
    ],
)
def test_mistakes_of_use_are_one_line(starboard: Any, arguments: list[str], reason: str) -> None:
    code, _, err = starboard(*arguments)
    assert code == 2
    assert reason in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("t_s,bow\n0,1\n", "column bow: give either actuators of pladypos"),
        ("t_s,surge_n\n0,x\n", "line 2: not 2 numbers"),
        ("t_s,surge_n\n0,nan\n", "line 2: not a finite number"),
        ("t_s,surge_n\n1,1\n1,2\n", "line 3: time does not grow"),
        ("time,surge_n\n0,1\n", "the first line must name t_s"),
        ("t_s,surge_n\n", "no row in it"),
    ],
)
def test_bad_files_are_refused_with_the_line(starboard: Any, tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "in.csv"
    file.write_text(text)
    code, _, err = starboard("pladypos", "--input", str(file))
    assert code == 2
    assert reason in err
