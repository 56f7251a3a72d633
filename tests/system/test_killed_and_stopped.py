"""Every process is killed, then held, in random order while the vessel holds: still thrusters, and back again."""

import math
import os
import random
import re
import signal
import time

import pytest

from benchmarks.running_star import RunningStar, wait_for
from services.catalog import PROCESSES
from services.vessels import load_vessel
from tests.system.noting_simulator import read_notes

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

PLACE = (1.5, 1.2, 0.5)
CHAIN = {"camera_tracker", "estimator", "controller", "helm", "allocator", "platform_link"}
"""Without one of these no command may reach the thrusters. (The simulator is the world itself,
and the hub has a standby.)"""
STILL_WITHIN_S = 0.5
BACK_WITHIN_S = 3.0
HUNG_AFTER_S = 3.0

_NAMES = [p.name for p in PROCESSES if p.fits(load_vessel("pladypos"))]
_ORDER = random.Random(20101).sample(_NAMES, len(_NAMES)), random.Random(20102).sample(_NAMES, len(_NAMES))


def error_m(star: RunningStar, seconds: float) -> float:
    """Return the largest true distance from the place during the last seconds; infinite without notes."""
    notes = read_notes(star.folder, time.time() - seconds)
    if len(notes) < 50 * seconds:
        return math.inf
    return max(math.hypot(n.x_m - PLACE[0], n.y_m - PLACE[1]) for n in notes)


def holding(star: RunningStar, timeout_s: float) -> None:
    wait_for(lambda: error_m(star, 1.0) < 0.010, timeout_s, "within 10 mm for a second")


def first_still_s(star: RunningStar, since_s: float) -> float:
    """Return how long after a time the firmware first ran nothing."""
    return min((n.stamp_s - since_s for n in read_notes(star.folder, since_s) if not n.moving), default=math.inf)


@pytest.fixture(scope="module", autouse=True)
def held(star: RunningStar) -> None:
    star.hold(*PLACE)
    holding(star, 40.0)


@pytest.mark.parametrize("name", _ORDER[0])
def test_killed(star: RunningStar, name: str) -> None:
    holding(star, 30.0)
    pid = star.pid(name)
    begin_s = time.time()
    os.kill(pid, signal.SIGKILL)
    wait_for(
        lambda: star.states()[name]["pid"] != pid and star.states()[name]["state"] == "running", 10.0, "it is back"
    )
    assert time.time() - begin_s < BACK_WITHIN_S
    if name in CHAIN:
        assert first_still_s(star, begin_s) < STILL_WITHIN_S
    holding(star, 20.0)


@pytest.mark.parametrize("name", _ORDER[1])
def test_held_by_sigstop(star: RunningStar, name: str) -> None:
    holding(star, 30.0)
    pid = star.pid(name)
    begin_s = time.time()
    os.kill(pid, signal.SIGSTOP)
    try:
        wait_for(
            lambda: star.states()[name]["pid"] != pid and star.states()[name]["state"] == "running",
            HUNG_AFTER_S + 2 * BACK_WITHIN_S,
            "the supervisor finds it hung and starts it again",
        )
    finally:
        if star.states()[name]["pid"] == pid:
            os.kill(pid, signal.SIGCONT)
    if name in CHAIN:
        assert first_still_s(star, begin_s) < STILL_WITHIN_S
        notes = read_notes(star.folder, begin_s + STILL_WITHIN_S)
        moving = [n.moving for n in notes if n.stamp_s < begin_s + 0.5 * HUNG_AFTER_S]
        assert moving, "the simulator lives"
        assert not any(moving), "still from the first half second on, long before it is found"
    assert re.search(rf"{name} +gave no sign of life", star.log)
    holding(star, 20.0)


def test_no_process_was_left_over(star: RunningStar) -> None:
    states = star.states()
    assert {s["state"] for s in states.values()} == {"running"}
    assert all(s["restarts"] >= 2 for s in states.values()), states
