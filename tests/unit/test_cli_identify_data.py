"""`starboard identify METHOD data.csv`: mapping, units, signs, resampling, report, vessel file; bad data refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from marine.allocation import axis_limits
from marine.identification.validation import simulate
from marine.vessel import DegreeOfFreedom
from services.cli.errors import CliError
from services.cli.identify import app
from services.vessels import load_vessel, vessel_path

TRUE = DegreeOfFreedom(0.5, 0.0, 0.3)


def relay(dt: float = 0.1, duration_s: float = 60.0) -> np.ndarray:
    """Return columns time, heading in rad, moment in Nm of a relay experiment."""
    rows, psi, r, tau = [], 0.0, 0.0, 0.4
    for k in range(int(duration_s / dt)):
        tau = -0.4 if psi >= 0.3 else 0.4 if psi <= -0.3 else tau
        rows.append((k * dt, psi, tau))
        for _ in range(20):
            after = float(simulate(TRUE, np.array([0.0, dt / 20]), np.array([tau, tau]), nu_0=r)[1])
            psi, r = psi + 0.5 * dt / 20 * (r + after), after
    return np.array(rows)


DATA = relay()


def write(path: Path, data: np.ndarray, header: str = "time,eta,tau") -> str:
    np.savetxt(path, data, delimiter=",", header=header, comments="")
    return str(path)


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(app, arguments, catch_exceptions=True)
    if isinstance(result.exception, CliError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.parametrize("method", ["projection", "least-squares", "response-fit"])
def test_a_csv_file_is_identified(tmp_path: Path, method: str) -> None:
    out = json.loads(invoke(method, write(tmp_path / "a.csv", DATA), "--axis", "yaw", "--json"))
    found = {p["name"]: p["value"] for p in out["parameters"]}
    assert found["alpha"] == pytest.approx(TRUE.alpha, rel=0.01)
    assert found["beta_quadratic"] == pytest.approx(TRUE.beta_quadratic, rel=0.02)
    assert "600 samples at 10 Hz" in out["data"]
    assert out["mean_absolute_error"] < 0.05


def test_columns_degrees_and_signs_are_what_the_user_says(tmp_path: Path) -> None:
    table = np.column_stack([DATA[:, 0], -DATA[:, 2], np.degrees(DATA[:, 1])])
    path = write(tmp_path / "b.csv", table, "t,N,heading")
    mapping = ("--columns", "time=t,eta=heading,tau=N", "--degrees", "--flip", "tau", "--sample-s", "0.05")
    out = json.loads(invoke("projection", path, "--axis", "yaw", *mapping, "--json"))
    assert out["parameters"][0]["value"] == pytest.approx(TRUE.alpha, rel=0.02)
    assert "resampled to 0.05 s" in out["data"]
    assert "turned: tau" in out["data"]


def test_report_and_vessel_file(tmp_path: Path) -> None:
    report, saved = tmp_path / "out.html", tmp_path / "new.toml"
    path = write(tmp_path / "a.csv", DATA)
    invoke("projection", path, "--axis", "yaw", "--report", str(report), "--vessel", "pladypos", "--save", str(saved))
    html = report.read_text()
    assert html.count("<svg") == 4
    assert "95 % interval" in html
    assert "describing function" in html
    assert "http" not in html.replace("http://www.w3.org/2000/svg", "")
    assert load_vessel(str(saved)).model.yaw.alpha == pytest.approx(TRUE.alpha, rel=0.01)


def step_run(duration_s: float = 60.0) -> np.ndarray:
    """Return columns time, heading in rad, moment in Nm of a step of 0.4 Nm."""
    t = np.arange(0.0, duration_s, 0.1)
    nu = simulate(TRUE, t, np.full(t.size, 0.4))
    return np.column_stack([t, np.concatenate([[0.0], np.cumsum(0.05 * (nu[1:] + nu[:-1]))]), np.full(t.size, 0.4)])


OSCILLATION = ("projection", "describing-function", "least-squares", "zig-zag-integrals", "response-fit")
STEP = ("step-fit", "step-formulas", "velocity-formulas", "response-fit")
EVERY = tuple((method, DATA) for method in OSCILLATION) + tuple((method, step_run()) for method in STEP)


@pytest.mark.parametrize("method", STEP)
def test_a_step_of_a_force_that_is_the_same_throughout_is_identified(tmp_path: Path, method: str) -> None:
    out = json.loads(invoke(method, write(tmp_path / "a.csv", step_run()), "--axis", "yaw", "--json"))
    found = {p["name"]: p["value"] for p in out["parameters"]}
    assert found["alpha"] == pytest.approx(TRUE.alpha, rel=0.03)
    assert found["beta_quadratic"] == pytest.approx(TRUE.beta_quadratic, rel=0.03)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda d: np.delete(d, slice(100, 110), axis=0), "gap of"),
        (lambda d: d[[*range(100), 50, *range(100, 200)]], "backward"),
        (lambda d: d[[*range(100), 99, *range(100, 200)]], "twice the same"),
        (lambda d: d * [1.0, 57.3, 1.0], "degrees"),
        (lambda d: d * [1.0, 1.0, 0.0], "constant|zero"),
        (lambda d: d * [1.0, 0.0, 1.0], "eta is constant"),
        (lambda d: d * [1.0, 1.0, -1.0], "sign"),
        (lambda d: d * [1.0, -1.0, 1.0], "sign"),
        (lambda d: d[:5], "too few"),
        (lambda d: np.where(d == d[50, 1], np.nan, d), "not a number"),
    ],
)
def test_bad_data_are_refused_by_every_method_with_one_line_that_says_why(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], reason: str
) -> None:
    for method, good in EVERY:
        with pytest.raises(CliError, match=reason) as refused:
            invoke(method, write(tmp_path / "bad.csv", change(good)), "--axis", "yaw")
        assert "\n" not in str(refused.value), method


@pytest.mark.parametrize("method", ["projection", "describing-function", "zig-zag-integrals"])
def test_too_few_oscillations_are_refused(tmp_path: Path, method: str) -> None:
    with pytest.raises(CliError, match="too few"):
        invoke(method, write(tmp_path / "bad.csv", DATA[:60]), "--axis", "yaw")


@pytest.mark.parametrize("method", ["step-fit", "step-formulas", "velocity-formulas"])
def test_a_step_without_a_steady_state_is_marked(tmp_path: Path, method: str) -> None:
    path = write(tmp_path / "short.csv", step_run(1.8))
    warnings = json.loads(invoke(method, path, "--axis", "yaw", "--json"))["warnings"]
    assert any("of its steady state" in w for w in warnings)


@pytest.mark.parametrize("method", OSCILLATION)
def test_a_saturated_actuator_is_named_when_the_vessel_is_known(tmp_path: Path, method: str) -> None:
    limit = float(axis_limits(load_vessel("pladypos"))[5])
    path = write(tmp_path / "full.csv", DATA * [1.0, 1.0, limit / 0.4])
    warnings = json.loads(invoke(method, path, "--axis", "yaw", "--vessel", "pladypos", "--json"))["warnings"]
    assert any("at their limit" in w for w in warnings)


@pytest.mark.parametrize(
    ("options", "reason"), [(["--flip", "x"], "--flip"), (["--columns", "eta=psi"], "there are time, eta, tau")]
)
def test_options_that_cannot_be_are_refused(tmp_path: Path, options: list[str], reason: str) -> None:
    with pytest.raises(CliError, match=reason):
        invoke("projection", write(tmp_path / "a.csv", DATA), "--axis", "yaw", *options)


def test_a_file_that_is_no_recording_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"nothing")
    with pytest.raises(CliError, match=r"x\.mcap"):
        invoke("projection", str(tmp_path / "x.mcap"))


def test_axes_of_several_experiments_become_one_vessel_file(tmp_path: Path) -> None:
    data, merged = write(tmp_path / "a.csv", DATA), tmp_path / "merged.toml"
    folder = tmp_path / "identified"
    for axis, day in (("yaw", 1), ("yaw", 2), ("surge", 1)):
        saved = folder / f"pladypos-{axis}-2026010{day}-120000.toml"
        scaled = ("--columns", "time=time,eta=eta,tau=tau", "--axis", axis)
        begin = ("--begin-s", "10") if day == 2 else ()
        invoke("least-squares", data, *scaled, *begin, "--vessel", "pladypos", "--save", str(saved))
    told = invoke("merge", "pladypos", "--save", str(merged), "--recordings", str(tmp_path))
    assert "yaw: " in told
    assert "20260102" in told, "the newest of an axis"
    newest, surge = (load_vessel(str(next(folder.glob(name)))) for name in ("*yaw*02-*", "*surge*"))
    found, file = load_vessel(str(merged)), load_vessel("pladypos")
    assert (found.model.yaw, found.model.surge) == (newest.model.yaw, surge.model.surge)
    assert found.model.sway == file.model.sway
    assert found.actuators == file.actuators
    with pytest.raises(CliError, match="none of these files has another model"):
        invoke("merge", "pladypos", str(vessel_path("pladypos")), "--save", str(merged))
    with pytest.raises(CliError, match="no vessel files of videoray"):
        invoke("merge", "videoray", "--recordings", str(tmp_path))
