"""`starboard experiment campaign` on a running system: broken off, taken up again, ended by another client."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.running_star import ROOT, RunningStar, wait_for
from bus import topics

pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]

CAMPAIGN = """\
name = "step"
axis = "yaw"
amplitudes = [1.0]
repeats = 1
tries = 5
start = { x_m = 2.5, y_m = 1.9 }
calm_m_s = 0.03
calm_s = 0.5
"""


def started(star: RunningStar, file: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "services.cli.main", "experiment", "campaign", "--file", str(file), *more],
        cwd=ROOT, env=star.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.soak
def test_a_campaign_is_broken_off_goes_on_and_gives_way(tmp_path: Path) -> None:
    file = tmp_path / "yaw.toml"
    file.write_text(CAMPAIGN)
    results = tmp_path / "yaw.results.jsonl"
    with RunningStar("[simulator]\ncurrent_x_m_s = 0.0\ncurrent_std_m_s = 0.0\n") as star:
        star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 30.0, "a pose")

        first = started(star, file)
        wait_for(results.exists, 90.0, "the first run")
        star.wait(topics.EXPERIMENT_STATUS, lambda s: s.state == "running" and s.elapsed_s > 0.5, 60.0, "another run")
        first.send_signal(signal.SIGINT)
        out, errors = first.communicate(timeout=20)
        assert first.returncode == 2
        assert "1 of 2, 1 +1 1: alpha " in out
        assert "1 runs are in " in errors
        assert "the same command goes on" in errors
        assert "Traceback" not in errors
        star.wait(topics.HELM_STATE, lambda h: h.mode == "hold", 5.0, "hold after Ctrl-C")
        kept = results.read_text()

        with results.open("a") as end:
            end.write('{"run": "1 -1 1", "resu')  # as if it had been killed while it wrote
        second = started(star, file, "--json")
        out, errors = second.communicate(timeout=120)
        assert second.returncode == 0, errors
        assert results.read_text().startswith(kept)
        rows = json.loads(out.splitlines()[-1])["results"]
        (alpha,) = (r for r in rows if (r["method"], r["parameter"]) == ("response fit", "alpha"))
        assert alpha["runs"] == 2
        assert alpha["mean"] == pytest.approx(0.52608, rel=0.05)
        assert alpha["std"] < 0.03 * alpha["mean"]

        file.write_text(CAMPAIGN.replace("repeats = 1", "repeats = 3"))
        third = started(star, file)
        star.wait(topics.HELM_STATE, lambda h: h.mode == "experiment", 60.0, "the third pair")
        assert star.request(mode="stop").accepted
        _, errors = third.communicate(timeout=20)
        assert third.returncode == 2
        assert "the helm has stopped (stopped by test)" in errors
        star.wait(topics.HELM_STATE, lambda h: h.mode == "stop", 5.0, "still stopped")
