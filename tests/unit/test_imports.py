"""What every process imports stays light: scipy costs 0.5 s and 20 MB each time."""

import subprocess
import sys

import pytest

from services.catalog import PROCESSES

HEAVY = ("scipy", "cv2", "rich", "matplotlib", "playwright")
ALLOWED = {
    "camera_tracker": {"cv2"},
    "laser_tracker": {"cv2"},
    "experiment": {"scipy"},  # it identifies in the step that ends an experiment: no time to import then
}


@pytest.mark.parametrize("process", PROCESSES, ids=lambda p: p.name)
def test_a_process_imports_nothing_heavy_that_it_does_not_need(process: object) -> None:
    target = process.target.split(":")[0]  # type: ignore[attr-defined]
    code = f"import sys, services.vessels, {target}; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = set(eval(done.stdout))
    assert found <= ALLOWED.get(process.name, set())  # type: ignore[attr-defined]
