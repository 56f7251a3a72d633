import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from marine.identification.result import FloatArray, IdentificationError
from marine.identification.thruster_map import dead_zone_of, fit_thruster
from services.cli.errors import CliError
from services.cli.identify import app

N = np.array([x for x in np.linspace(-40.0, 40.0, 33) if x])


def asymmetric(n: FloatArray) -> FloatArray:
    """Thesis (2.8) with a_f = 0.004, b_f = 0.02, a_b = 0.003, b_b = 0.01."""
    forward = 0.004 * n * n + 0.02 * n
    return np.where(n > 0.0, forward, -(0.003 * n * n) + 0.01 * n)


def test_exact_data_give_the_exact_coefficients_of_2_8() -> None:
    found = fit_thruster(N, asymmetric(N))
    assert found.identified.model == "asymmetric"
    assert [p.name for p in found.identified.parameters] == ["a_f", "b_f", "a_b", "b_b"]
    assert [p.value for p in found.identified.parameters] == pytest.approx([0.004, 0.02, 0.003, 0.01])
    for n in (-33.0, -1.0, 0.5, 40.0):
        assert found.curve.command(found.curve.thrust(n)) == pytest.approx(n)


def test_standard_deviations_are_those_of_repeated_experiments() -> None:
    rng = np.random.default_rng(5)
    runs = [fit_thruster(N, asymmetric(N) + rng.normal(0.0, 0.05, N.size), "asymmetric").identified for _ in range(300)]
    for index in range(4):
        spread = np.std([run.parameters[index].value for run in runs], ddof=1)
        told = np.mean([run.parameters[index].std for run in runs])
        assert told == pytest.approx(spread, rel=0.12)


def test_the_model_without_needless_parameters_is_chosen() -> None:
    rng = np.random.default_rng(6)
    chosen = [
        fit_thruster(N, 0.004 * np.abs(N) * N + rng.normal(0.0, 0.05, N.size)).identified.model for _ in range(40)
    ]
    assert chosen.count("quadratic") > 30


def test_quadratic_then_straight_is_found_with_its_knee() -> None:
    # the map of the later PlaDyPos: 1.894 n^2 below 0.23, straight above with the slope chosen in pladypos_metric.toml
    n = np.array([x for x in np.linspace(-1.0, 1.0, 41) if x])
    tau = np.sign(n) * np.where(np.abs(n) < 0.23, 1.894 * n * n, 1.894 * 0.23**2 + 0.87124 * (np.abs(n) - 0.23))
    found = fit_thruster(n, tau)
    assert found.identified.model == "quadratic_linear"
    assert found.identified["knee"] == pytest.approx(0.23, abs=1e-5)
    assert found.identified["k_t"] == pytest.approx(1.894, rel=1e-4)
    assert found.identified["slope"] == pytest.approx(0.87124, rel=1e-4)
    assert found.curve.command(0.5) == pytest.approx(0.23 + (0.5 - 1.894 * 0.0529) / 0.87124, rel=1e-5)


def test_a_dead_zone_is_seen_and_left_out() -> None:
    tau = np.where(np.abs(N) <= 5.0, 0.001, 0.004 * np.abs(N) * N)
    assert dead_zone_of(N, tau) == 5.0
    assert fit_thruster(N, tau, "quadratic", 5.0).identified["k_t"] == pytest.approx(0.004)
    assert dead_zone_of(N, asymmetric(N)) == 0.0


@pytest.mark.parametrize(
    ("n", "tau", "reason"),
    [
        (N, -asymmetric(N), "turn the sign"),
        (N[N > 0], asymmetric(N[N > 0]), "0 commands backward"),
        (np.append(N, math.nan), np.append(asymmetric(N), 1.0), "1 rows are not numbers"),
        (N, asymmetric(N)[:-1], "one thrust for each command"),
    ],
)
def test_data_that_do_not_suffice_are_refused_with_the_reason(n: FloatArray, tau: FloatArray, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        fit_thruster(n, tau)


def test_a_fit_without_inverse_is_refused() -> None:
    falling = np.sign(N) * (np.abs(N) - 0.02 * N * N)  # rises, then falls: a < 0
    with pytest.raises(IdentificationError, match="no inverse"):
        fit_thruster(N, falling + 0.3 * N, "affine")


def write(path: Path, n: FloatArray, tau: FloatArray, head: str = "command,thrust_n") -> Path:
    path.write_text(head + "\n" + "".join(f"{a:.6g},{b:.9g}\n" for a, b in zip(n, tau, strict=True)))
    return path


def test_the_command_prints_lines_that_a_vessel_file_takes(tmp_path: Path) -> None:
    data = write(tmp_path / "bench.csv", N, asymmetric(N))
    plot = tmp_path / "bench.svg"
    result = CliRunner().invoke(app, ["thruster", str(data), "--json", "--plot", str(plot)])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert {p["name"]: round(p["value"], 6) for p in document["parameters"]}["a_b"] == 0.003
    assert all(p["std"] is not None for p in document["parameters"])

    vessel = Path("config/vessels/pladypos.toml").read_text()
    begin = vessel.index("[[actuator]]")
    block = vessel[begin : vessel.index("[[actuator]]", begin + 1)]
    kept = [line for line in block.splitlines() if not line.startswith(("kind", "k_t", "n_max"))]
    pasted = tmp_path / "pasted.toml"
    pasted.write_text(vessel.replace(block, "\n".join([*kept, *document["vessel_file"], "", ""])))
    from marine.actuators import Drive
    from services.vessels import load_vessel

    loaded = load_vessel(str(pasted))
    assert Drive(loaded.thrusters[0]).curve.thrust(10.0) / loaded.units.force_n == pytest.approx(0.6)
    assert plot.read_text().count("<circle") == N.size


def test_the_table_tells_values_with_their_standard_deviation(tmp_path: Path) -> None:
    data = write(tmp_path / "bench.csv", N, asymmetric(N))
    result = CliRunner().invoke(app, ["thruster", str(data), "--model", "asymmetric"])
    assert "a_f               0.004 +- " in result.stdout
    assert 'kind = "asymmetric"' in result.stdout


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("n,force\n1,2\n", "no column command"),
        ("command,thrust_n\n1,2\n3,much\n", "line 3: not two numbers"),
        ("command,thrust_n\n", "no measurement"),
        ("command,thrust_n\n1,2\n", "measure at least 4"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    result = CliRunner().invoke(app, ["thruster", str(path)])
    assert isinstance(result.exception, CliError)
    assert reason in str(result.exception)
    assert "\n" not in str(result.exception)


def test_a_missing_file_is_one_line() -> None:
    result = CliRunner().invoke(app, ["thruster", "nowhere.csv"])
    assert "cannot be read" in str(result.exception)
