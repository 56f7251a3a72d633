"""Tuning on the whole star as real processes: the one command, and what a killed controller comes back with."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator

import pytest

from benchmarks.running_star import RunningStar
from bus import topics
from services.vessels import load_vessel
from tests.system.heavy_simulator import HEAVY, heavier

pytestmark = [pytest.mark.system, pytest.mark.soak, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def star() -> Iterator[RunningStar]:
    with RunningStar("[estimator]\nfault_detection = false\n", system=HEAVY) as star:
        star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 30.0, "a pose")
        yield star


def test_autotune_identifies_designs_and_engages(star: RunningStar) -> None:
    nothing = star.cli("autotune", "--back")
    assert (nothing.returncode, "nothing was engaged" in nothing.stderr) == (2, True)
    done = star.cli("autotune", "yaw", "--oscillations", "2", "--w0", "0.8", "--yes", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    yaw, true = document["axes"]["yaw"], heavier(load_vessel("pladypos").model).yaw
    assert yaw["proposed"]["model"]["alpha"] == pytest.approx(true.alpha, rel=0.05)
    assert yaw["present"]["step"]["overshoot_percent"] > 15.0
    told = star.wait(topics.CONTROL_GAINS, lambda g: g.engaged, 5.0, "engaged")
    assert told.tuning.parameters["yaw_w0_rad_s"] == 0.8
    assert told.tuning.models["yaw"].alpha == yaw["proposed"]["model"]["alpha"]
    assert list((star.recordings / "identified").glob("pladypos-engaged-*.toml"))


def test_a_killed_controller_comes_back_with_what_was_engaged(star: RunningStar) -> None:
    assert star.cli("poke", "operator/tuning", '{"request_id": "1", "client": "me", "tuning": {"law": "lqr"}}')
    before = star.wait(topics.CONTROL_GAINS, lambda g: g.by == "me", 5.0, "engaged")
    pid = star.pid("controller")
    os.kill(pid, signal.SIGKILL)
    after = star.wait(
        topics.CONTROL_GAINS, lambda g: g.seq < before.seq or g.stamp_ns > before.stamp_ns + 3e9, 20.0, "told again"
    )
    assert star.pid("controller") != pid
    assert (after.engaged, after.tuning, after.since_ns) == (True, before.tuning, before.since_ns)
    assert star.cli("autotune", "--back").returncode == 0
    star.wait(topics.CONTROL_GAINS, lambda g: g.tuning.law == "ipd", 5.0, "what ran before")
