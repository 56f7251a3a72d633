import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from services.cli.errors import CliError
from services.cli.main import main

Capture = pytest.CaptureFixture[str]

LINEAR_YAW = """
[model.yaw]
alpha = 78.97
beta = 298.48
"""


@pytest.fixture
def tune(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> Any:
    """Return a function that runs `starboard tune ...` and returns (exit code, stdout, stderr)."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["starboard", "tune", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
        out = capsys.readouterr()
        return int(end.value.code or 0), out.out, out.err

    return run


def falcon_like(folder: Path) -> str:
    """Return a vessel whose yaw is that of thesis Example 8.1, at w0 = 1.5."""
    text = (Path(__file__).parents[2] / "config/vessels/pladypos.toml").read_text()
    head, rest = text.split("[model.yaw]")
    tail = rest.split("\n\n", 1)[1]
    text = head + LINEAR_YAW.strip() + "\n\n" + tail
    text = text.replace("moment_nm = 0.006", "moment_nm = 1.0").replace("w0_rad_s = 0.5", "w0_rad_s = 1.5")
    path = folder / "falcon_like.toml"
    path.write_text(text)
    return str(path)


def test_example_8_1(tune: Any, tmp_path: Path) -> None:
    code, out, _ = tune(falcon_like(tmp_path), "yaw", "--json")
    document = json.loads(out)
    assert code == 0
    assert (document["dof"], document["step"], document["step_unit"]) == ("yaw", 90.0, "deg")
    (present,) = document["designs"]
    assert present["name"] == "present"
    assert present["drag_over_inertia_1_s"] == pytest.approx(3.78, abs=0.005)
    assert present["bound_1_s"] == pytest.approx(17.84, abs=0.005)
    assert present["allowed"]
    assert present["speed_limit"] is None  # no drag that grows with speed


def test_a_design_that_8_23_forbids_is_said_so(tune: Any, tmp_path: Path) -> None:
    code, out, _ = tune(falcon_like(tmp_path), "yaw", "--w0", "0.3", "--json")
    proposed, present = json.loads(out)["designs"]
    assert code == 1
    assert not proposed["allowed"]
    assert proposed["drag_over_inertia_1_s"] > proposed["bound_1_s"]
    assert "(8.22)" in proposed["reason"]
    assert present["allowed"]
    code, out, _ = tune(falcon_like(tmp_path), "yaw", "--w0", "0.3")
    assert code == 1
    assert "proposed: NOT ALLOWED: not stable with drag 20 % too high" in out


def test_prediction_beside_the_present_gains(tune: Any) -> None:
    code, out, _ = tune("pladypos", "surge", "--w0", "1.5", "--model", "butterworth", "--json")
    proposed, present = json.loads(out)["designs"]
    assert code == 0
    fast, slow = proposed["predicted"], present["predicted"]
    assert fast["saturated_s"] > 0.0 == slow["saturated_s"]
    assert fast["largest_demand"] > fast["limit"] > slow["largest_demand"]
    assert fast["actuator_activity"] > slow["actuator_activity"]
    assert slow["overshoot_percent"] == pytest.approx(0.75, abs=0.1)  # Bessel's
    assert proposed["gains"]["k_p"] == pytest.approx(2.0 * 1.5**2 * 26.4064)


@pytest.mark.parametrize(("vessel", "dof", "w0"), [("pladypos", "yaw", "20"), ("videoray", "heave", "5")])
def test_what_the_controller_would_refuse_for_its_delay_is_not_allowed(
    tune: Any, vessel: str, dof: str, w0: str
) -> None:
    code, out, _ = tune(vessel, dof, "--w0", w0, "--json")
    proposed, present = json.loads(out)["designs"]
    assert code == 1
    assert "sensor and command take" in proposed["reason"]
    assert proposed["margins"]["delay_s"] < proposed["loop_delay_s"] < present["margins"]["delay_s"]


@pytest.mark.parametrize(
    ("name", "dof", "w0"),
    [
        ("charlie", "yaw", 0.3),  # heading_w0_rad_s of its [hold]
        ("telemetron", "yaw", 0.1953),  # (8.22) asks for a faster one than [hold] says
        ("videoray", "heave", 0.4),
        ("videoray", "surge", 0.4),  # mode distance
        ("falcon", "sway", 0.4),
        ("charlie", "surge", None),
        ("automarine", "surge", None),
    ],
)
def test_present_is_what_runs_by_the_vessel_file(tune: Any, name: str, dof: str, w0: float | None) -> None:
    """And it is allowed; what keeps a speed in an axis, and no place, has no present loop of this kind."""
    code, out, _ = tune(name, dof, "--json")
    last = json.loads(out)["designs"][-1]
    assert (code, last["allowed"]) == (0, True)
    assert last["name"] == ("present" if w0 else "proposed")
    assert w0 is None or last["w0_rad_s"] == pytest.approx(w0, abs=1e-4)
    assert w0 is not None or f"present: none; {name} keeps no place in {dof}" in tune(name, dof)[1]


def test_a_step_that_the_actuators_limit_is_predicted_to_its_end(tune: Any) -> None:
    predicted = json.loads(tune("pladypos", "surge", "--w0", "6", "--json")[1])["designs"][0]["predicted"]
    assert predicted["saturated_s"] > 20.0 / 6.0
    assert predicted["settling_s"] > predicted["saturated_s"] / 2.0


def test_given_coefficients_are_charlies(tune: Any) -> None:
    _, out, _ = tune("pladypos", "yaw", "--model", "5.48,12.01,10.97", "--json")
    assert json.loads(out)["designs"][0]["model_function"] == [5.48, 12.01, 10.97]


@pytest.mark.parametrize("suffix", [".svg", ".html"])
def test_plot(tune: Any, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"step{suffix}"
    assert tune("pladypos", "yaw", "--w0", "0.8", "--plot", str(path))[0] == 0
    text = path.read_text()
    svg = ElementTree.fromstring(text[text.index("<svg") :])
    curves = svg.findall("{http://www.w3.org/2000/svg}polyline")
    assert len(curves) == 4
    ends = [float(c.attrib["points"].split()[-1].split(",")[1]) for c in curves[:2]]
    assert ends[0] == pytest.approx(ends[1], abs=1.0)  # both at the reference


def test_list_names_every_law(tune: Any) -> None:
    _, out, _ = tune("--list", "--json")
    laws = {law["name"]: law for law in json.loads(out)["laws"]}
    assert {"ipd", "lqr", "p_d"} <= laws.keys()
    assert not laws["p_d"]["integral"]
    assert [p["name"] for p in laws["ipd"]["parameters"]] == ["model_function", "w0_rad_s", "yaw_w0_rad_s"]
    assert all(name in tune("--list")[1] for name in laws)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["pladypos"], "say which vessel"),
        (["pladypos", "roll"], "no degree of freedom"),
        (["pladypos", "heave"], "no model of heave"),
        (["nautilus", "yaw"], "no such vessel"),
        (["pladypos", "yaw", "--w0", "-1"], "w0 must be positive"),
        (["pladypos", "yaw", "--w0", "nan"], "w0 must be positive"),
        (["pladypos", "yaw", "--model", "1,1,2"], "not stable"),
        (["pladypos", "yaw", "--structure", "PDI"], "no structure"),
        (["pladypos", "yaw", "--step", "0"], "other than zero"),
        (["pladypos", "yaw", "--plot", "step.png"], "FILE.svg"),
    ],
)
def test_mistakes_of_use_are_one_line(tune: Any, arguments: list[str], says: str) -> None:
    code, _, err = tune(*arguments)
    assert code == 2
    assert says in err
    assert len(err.strip().splitlines()) == 1


def test_an_axis_without_actuators_is_refused() -> None:
    from services.cli.tune import _candidates
    from services.vessels import known_vessels, load_vessel

    steered = [load_vessel(name) for name in known_vessels() if "Y" not in load_vessel(name).controlled]
    for vessel in steered:
        with pytest.raises(CliError, match="nothing to tune"):
            _candidates(vessel, "sway", "I-PD", "bessel", None, 1.0)
