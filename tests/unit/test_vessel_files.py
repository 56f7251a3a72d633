"""Vessel files: what the papers print is in them, every number has its source, and nonsense is refused."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bus.config import ConfigError
from marine import vessel as v
from services.cli.main import _register, app
from services.vessels import VESSELS_DIR, controllable, known_vessels, load_vessel

ROOT = Path(__file__).parents[2]
DEGREE = math.pi / 180.0
COUPLED = """kind = "coupled"
mass_kg = 10.0
inertia_kg_m2 = 1.0
added_surge_kg = 1.0
added_sway_kg = 4.0
added_yaw_kg_m2 = 0.2
drag = [1.0, 2.0, 0.3]
drag_quadratic = [4.0, 5.0, 0.6]
x_g_m = 0.1
"""
SIX_DOF = """kind = "six_dof"
mass_kg = 10.0
inertia_kg_m2 = [0.4, 0.8, 1.0, 0.0, 0.1, 0.0]
added = [1.0, 4.0, 5.0, 0.1, 0.2, 0.2]
drag = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
drag_quadratic = [4.0, 5.0, 6.0, 0.1, 0.2, 0.6]
weight_n = 98.1
buoyancy_n = 99.0
r_g_m = [0.0, 0.0, 0.02]
"""


def test_all_vessels_of_the_papers_are_there() -> None:
    assert known_vessels() == [
        "automarine", "charlie", "falcon", "nonlinear_yaw", "pladypos", "pladypos_metric", "telemetron", "videoray",
    ]  # fmt: skip


@pytest.mark.parametrize("name", known_vessels())
def test_every_number_has_its_source(name: str) -> None:
    covered = False
    for line in (VESSELS_DIR / f"{name}.toml").read_text().splitlines():
        told = "#" in line
        if line.startswith("["):
            covered = told
        elif not line.strip():
            covered = False
        elif re.match(r'[\w"]+ = [-\[\d]', line) and not line.startswith(("controlled", "sources")):
            assert told or covered, f"{name}: no source for: {line}"
        for source in re.findall(r"#.*?\[(\d)\]", line):
            assert any(s.startswith(f"[{source}]") for s in load_vessel(name).sources), f"{name}: no source [{source}]"


@pytest.mark.parametrize(
    ("name", "axis", "alpha", "beta", "beta_quadratic"),
    [
        ("pladypos", "yaw", 87.68 * 0.006, 0.0, 48.83 * 0.006),  # Table 2
        ("pladypos_metric", "surge", 1.24, 0.0, 3.27),
        ("pladypos_metric", "yaw", 0.4965, 0.0, 0.3),
        ("videoray", "yaw", 5.26e-4 / DEGREE, 0.0, 25.95e-6 / DEGREE**2),  # Table 7.8
        ("automarine", "yaw", 7.11e-4 / DEGREE, 0.0, 22.55e-6 / DEGREE**2),  # Table 7.10
        ("falcon", "yaw", 80 * 0.1, 300 * 0.1, 10 * 0.1),  # Table 7.1
        ("falcon", "heave", 130.0, 200.0, 20.0),  # Table 7.3
        ("nonlinear_yaw", "yaw", 1.018, 0.0, 1.257),  # Table 7.5
    ],
)
def test_parameters_are_the_printed_ones_in_si(
    name: str, axis: str, alpha: float, beta: float, beta_quadratic: float
) -> None:
    dof = getattr(load_vessel(name).model, axis)
    assert (dof.alpha, dof.beta, dof.beta_quadratic) == pytest.approx((alpha, beta, beta_quadratic))


def test_surge_of_videoray_oscillates_as_printed_in_7_6() -> None:
    # Table 6.3 with (6.31): C is one unit of force; X_m = 16.22 cm, w = 0.393 1/s, x_a* = 12.33 cm, Td = 0.2 s.
    vessel = load_vessel("videoray")
    C, X_m, w, x_a = vessel.units.force_n, 0.1622, 0.393, 0.1233
    phase = math.asin(x_a / X_m) + 0.2 * w
    amplitude = 4.0 * C / math.pi
    assert vessel.model.surge.alpha == pytest.approx(amplitude * math.cos(phase) / (X_m * w * w), rel=0.02)
    drag = amplitude * math.sin(phase) * 3.0 * math.pi / (8.0 * X_m * X_m * w * w)
    assert vessel.model.surge.beta_quadratic == pytest.approx(drag, rel=0.02)


@pytest.mark.parametrize("name", known_vessels())
def test_a_vessel_controls_what_it_says(name: str) -> None:
    vessel = load_vessel(name)
    assert controllable(vessel.actuators, vessel.controlled) == len(vessel.controlled)
    assert len({a.name for a in vessel.actuators}) == len(vessel.actuators)
    assert vessel.radius_m < 0.5 * min(vessel.pool.length_x_m, vessel.pool.length_y_m)
    assert vessel.camera.width_px / vessel.camera.scale_px_per_m == pytest.approx(vessel.pool.length_x_m)


def test_the_allocation_of_videoray_is_3_1() -> None:
    columns = np.array([a.column for a in load_vessel("videoray").actuators]).T
    expected = np.array([[1, 1, 0], [0, 0, 1], [0.07, -0.07, 0]])
    np.testing.assert_allclose(columns[[0, 2, 5]], expected, atol=1e-12)


def test_delays_and_sensors_are_in_si() -> None:
    videoray = load_vessel("videoray")
    compass = next(s for s in videoray.sensors if s.kind == "compass")
    assert (videoray.command_delay_s, compass.delay_s, compass.quantisation) == pytest.approx((0.1, 0.1, 2 * DEGREE))
    assert videoray.bias[0] == pytest.approx(-0.3 * 0.16)
    assert videoray.validity.distance_s == 7.5
    rudder = next(a for a in load_vessel("charlie").actuators if isinstance(a, v.Rudder))
    assert rudder.n_max == pytest.approx(30 * DEGREE)
    assert rudder.lowest == -rudder.n_max


def with_model(model: str) -> str:
    text = (VESSELS_DIR / "pladypos.toml").read_text()
    return text[: text.index("\n[model]")] + "\n[model]\n" + model + text[text.index("# X configuration") :]


def test_every_kind_of_model_and_actuator_can_be_written(tmp_path: Path) -> None:
    file = tmp_path / "coupled.toml"
    file.write_text(with_model(COUPLED))
    vessel = load_vessel(str(file))
    assert isinstance(vessel.dynamics, v.CoupledModel)
    assert vessel.model.sway == v.DegreeOfFreedom(14.0, 2.0, 5.0)
    kinds = [
        ('kind = "affine"\na = 0.2\nb = 0.1\n', v.AffineThrust(0.2 * 0.02, 0.1 * 0.02)),
        ('kind = "bilinear"\nt_nn = 0.2\nt_nu = 0.1\nwake = 0.3\n', v.BilinearThrust(0.2 * 0.02, 0.1 * 0.02, wake=0.3)),
    ]
    for written, expected in kinds:
        text = with_model(SIX_DOF).replace('kind = "quadratic"              # [1] (1)\n', written, 1)
        file.write_text(text.replace("k_t = 0.2                       # chosen; [1] (1), ", "# ", 1))
        vessel = load_vessel(str(file))
        assert vessel.thrusters[0].characteristic == expected
        with pytest.raises(TypeError, match="not purely quadratic"):
            _ = vessel.thrusters[0].k_t
    assert isinstance(vessel.dynamics, v.SixDofModel)
    assert vessel.model.heave == v.DegreeOfFreedom(15.0, 3.0, 6.0)
    assert vessel.model.net_weight_n == pytest.approx(-0.9)


REFUSED = [
    ("pladypos", "alpha = 8.252 ", "alpha = 0.0 ", r": model\.surge\.alpha: .*greater than 0"),
    (
        "pladypos",
        "beta_quadratic = 48.83 ",
        "beta_quadratic = -48.83 ",
        r"yaw\.beta_quadratic: .*greater than or equal",
    ),
    ("pladypos", "alpha = 87.68 ", "alpha = nan ", r"yaw\.alpha: .*finite"),
    ("pladypos", "radius_m = 0.30 ", "radius_m = inf ", r"radius_m: .*finite"),
    ("pladypos", 'kind = "quadratic" ', 'kind = "jet" ', r"actuator\.0: .*'jet'"),
    ("pladypos", "angle_deg = 45.0", "angle_deg = -45.0", "controlled: the allocation is singular"),
    ("pladypos", '"X", "Y", "N"]', '"X", "Y", "Z", "N"]', "set 3 of X, Y, Z, N"),
    ("pladypos", 'name = "front_port"', 'name = "front_starboard"', "same name"),
    ("pladypos", 'kind = "uncoupled" ', 'kind = "neural" ', r"model: .*'neural'"),
    (
        "pladypos",
        "k_t = 0.2 ",
        "thrust = 0.2 ",
        r": actuator\.0\.k_t: Field required|: actuator\.0\.thrust: no such key",
    ),
    ("pladypos", "[camera] ", "[seen_from] ", r"seen_from: no such key"),
    ("videoray", 'kind = "compass"\nunit = "deg"', 'kind = "compass"\nunit = "m"', "compass measures in rad, not in m"),
    ("videoray", "dropout = 0.1 ", "dropout = 1.0 ", r"sensor\.2\.dropout"),
    ("videoray", "dead_zone = 3.0 ", "dead_zone = 50.0 ", r"actuator\.0\.dead_zone"),
    ("charlie", 'behind = "port" ', 'behind = "bow" ', r"actuator\.2\.behind: no thruster is called 'bow'"),
    ("charlie", "k_r2 = 0.46 ", "k_r2 = 0.0 ", "model: a small_vessel needs rudders"),
    ("telemetron", '"1" = 0.14', '"1" = 0.01', r"model: inertia is not positive at U = 0\.0"),
    ("telemetron", '"Ur2" = 0.10', '"U5" = 0.10', "no such term 'U5'"),
]


@pytest.mark.parametrize(("name", "old", "new", "reason"), REFUSED)
def test_nonsense_is_refused_with_file_key_and_reason(
    tmp_path: Path, name: str, old: str, new: str, reason: str
) -> None:
    text = (VESSELS_DIR / f"{name}.toml").read_text()
    assert old in text
    file = tmp_path / f"{name}.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=reason) as error:
        load_vessel(str(file))
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "model", [COUPLED.replace("x_g_m = 0.1", "x_g_m = 0.5"), SIX_DOF.replace("0.0, 0.1, 0.0]", "0.0, 2.0, 0.0]")]
)
def test_an_inertia_matrix_that_is_none_is_refused(tmp_path: Path, model: str) -> None:
    file = tmp_path / "v.toml"
    file.write_text(with_model(model))
    with pytest.raises(ConfigError, match="not positive definite"):
        load_vessel(str(file))


def test_a_vessel_that_does_not_exist_is_told_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no such vessel; known: automarine, charlie"):
        load_vessel("titanic")


def test_starboard_vessels_prints_all_of_them() -> None:
    _register("vessels")
    _register("status")  # typer with a single command drops its name
    runner = CliRunner()
    documents = json.loads(runner.invoke(app, ["vessels", "--json"]).stdout)["vessels"]
    found = {d["name"]: (d["controlled"], d["rank"]) for d in documents}
    assert found["pladypos"] == (["X", "Y", "N"], 3)
    assert found["videoray"] == (["X", "Z", "N"], 3)
    assert found["telemetron"] == (["X", "N"], 2)
    assert sorted(found) == known_vessels()
    assert all(d["sources"] and d["sensors"] and d["actuators"] for d in documents)
    text = runner.invoke(app, ["vessels", "charlie"]).stdout
    assert "controls   X N" in text
    assert "rudder_port (rudder)" in text
    assert "position 0.5 s" in text


def test_every_test_that_the_page_of_models_names_exists() -> None:
    page = (ROOT / "docs" / "models.md").read_text()
    named = re.findall(r"`(test_\w+)`", page)
    assert len(named) > 15
    text = "\n".join(p.read_text() for p in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name in named if f"def {name}(" not in text] == []


@pytest.mark.parametrize("missing", ["model", "model.surge"])
def test_a_vessel_without_a_model_is_told_what_to_do(tmp_path: Path, missing: str) -> None:
    text = (VESSELS_DIR / "pladypos.toml").read_text(encoding="utf-8")
    begin = text.index(f"\n[{missing}]") + 1
    (tmp_path / "mine.toml").write_text(text[:begin] + text[text.index("[[actuator]]") :], encoding="utf-8")
    says = rf" {missing}: Field required: not known\? Guess inertia and drag .*tuning.md"
    with pytest.raises(ConfigError, match=says):
        load_vessel(str(tmp_path / "mine.toml"))
