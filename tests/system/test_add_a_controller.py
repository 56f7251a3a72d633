"""docs/how-to/add-a-controller.md does what it says: its law is put beside the others in a process of its own."""

import re
import subprocess
import sys
from pathlib import Path

from services.catalog import ROOT

PAGE = (ROOT / "docs/how-to/add-a-controller.md").read_text()

SCRIPT = """
import sys, math, tomllib
import marine.control
marine.control.__path__.append(sys.argv[1])
from bus.config import ConfigError, parse
from pathlib import Path
from services.cli.tune import tune
from services.controller import ControllerConfig
from services.generate import law_table
from services.tuning import horizontal_limits, preview
from services.vessels import load_vessel
from bus.messages import Tuning
from ui.server import system_document
from tests.star import build_star
import pytest

section = tomllib.loads(Path(sys.argv[1], "own.toml").read_text())["controller"]
config = parse(ControllerConfig, section, Path("own.toml"), "controller")
assert config.laws["spring"].period_s == 6.0
try:
    parse(ControllerConfig, {"laws": {"spring": {"period": 6.0}}}, Path("own.toml"), "controller")
except ConfigError as error:
    print(error)
tune(show_list=True)
print(law_table())
vessel = load_vessel("pladypos")
print("MENU", *(law["name"] for law in system_document(vessel)["laws"]))
found = preview(Tuning(law="spring", parameters={"period_s": 6.0}), vessel, horizontal_limits(vessel), None)
print("PREVIEW", *(found[axis]["step"]["settling_s"] for axis in found))
star = build_star(controller=section, simulator={"current_x_m_s": 0.05, "current_std_m_s": 0.0})
star.hold(2.0, 1.5, 0.5)
star.bus.run_for(25.0)
since_s = star.bus.now_s
star.bus.run_for(10.0)
print("RMS_M", *star.rms_error(2.0, 1.5, 0.5, since_s))
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", "tests/property/test_control_laws.py", "-k", "spring"]))
"""


def block(language: str) -> str:
    found = re.search(rf"( *)```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return "\n".join(line.removeprefix(found[1]) for line in found[2].splitlines()) + "\n"


def test_the_law_of_the_page_is_everywhere_it_says(tmp_path: Path) -> None:
    (tmp_path / "spring.py").write_text(block("python"))
    (tmp_path / "own.toml").write_text(block("toml"))
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "spring.period: no such key; known: period_s" in done.stdout
    assert "spring  serves positioning; disturbance from the estimator" in done.stdout
    assert (
        "| `spring` | A critically damped spring from the vessel to the reference. | `period_s` = `8.0`" in done.stdout
    )
    assert "MENU ipd lqr p_d spring" in done.stdout, "the page's menu"
    preview = re.search(r"PREVIEW (\S+) (\S+) (\S+)", done.stdout)
    assert preview is not None, "what the page shows before it is engaged"
    assert all(2.0 < float(seconds) < 10.0 for seconds in preview.groups())
    rms = re.search(r"RMS_M (\S+) (\S+)", done.stdout)
    assert rms is not None
    assert float(rms[1]) < 3e-3
    passed = re.search(r"(\d+) passed", done.stdout)
    assert passed is not None
    assert int(passed[1]) >= 8
    ruff = [sys.executable, "-m", "ruff", "check", "--stdin-filename", "marine/control/spring.py", "-"]
    checked = subprocess.run(ruff, cwd=ROOT, input=block("python"), capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout
