"""A star on a Zenoh router that is none of ours: on `zenohd`, started as the deployment guide says."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.running_star import RunningStar, free_port, wait_for
from bus.hub import HubConfig
from bus.messages import HubStatistics
from bus.security import client_settings
from bus.service import RawSample
from bus.topics import ACTUATOR_COMMAND, HEARTBEAT, HELM_STATE, HUB_STATISTICS, SIMULATION_TRUTH
from bus.zenoh_bus import HubUnreachableError, ZenohBus

BEAT = HEARTBEAT.of("camera_tracker")
pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

IN_PYTHON = (
    "import sys, threading, zenoh; s = zenoh.open(zenoh.Config.from_file(sys.argv[1])); threading.Event().wait()"
)
ROUTERS = [
    pytest.param(
        ["zenohd", "-c"],
        marks=pytest.mark.skipif(shutil.which("zenohd") is None, reason="the program zenohd is not installed"),
        id="zenohd",
    ),
    pytest.param(
        [
            sys.executable,
            "-c",
            IN_PYTHON,
        ],
        id="the-same-file-in-the-wheels-router",
    ),
]


@contextlib.contextmanager
def started(command: list[str], config: Path) -> Iterator[None]:
    router = subprocess.Popen([*command, str(config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        router.kill()
        router.wait(5.0)


@pytest.mark.parametrize("command", ROUTERS)
def test_a_vessel_holds_over_zenohd_with_passwords_and_rules(command: list[str]) -> None:
    star = RunningStar(router=f"tls/127.0.0.1:{free_port()}", secured=True)
    keys = star.folder / "keys"
    with started(command, keys / "hub" / "zenohd.json5"), star:
        star.hold(2.6, 1.9, 0.1, timeout_s=60.0)
        star.wait(
            SIMULATION_TRUTH,
            lambda t: abs(t.x_m - 2.6) < 0.01 and abs(t.y_m - 1.9) < 0.01 and abs(t.psi_rad - 0.1) < 0.02,
            60.0,
            "the vessel holds",
        )
        (known,) = star.bus.last_values(HELM_STATE.key)
        assert known.payload is not None
        assert HELM_STATE.message.decode(known.payload).mode == "hold"
        assert known.source == "helm"

        def told() -> HubStatistics | None:
            now = star.last(HUB_STATISTICS)
            return now if now and "camera/pose" in now.by_key else None

        assert wait_for(told, 5.0, "statistics").messages_hz > 50.0
        assert "hub_standby" not in star.states()
        shown = json.loads(star.cli("get", "helm/state", "--json").stdout)
        assert shown["value"]["mode"] == "hold"
        refuses_strangers(star, keys)


def refuses_strangers(star: RunningStar, keys: Path) -> None:
    tracker = dict(client_settings(keys, "camera_tracker"))
    for user in ({}, {"user": "camera_tracker", "password": "guess"}):
        with pytest.raises(HubUnreachableError, match="refuses our password"):
            ZenohBus.connect(star.vessel, (star.hub,), 0.1, tracker | {"transport/auth/usrpwd": user})
    heard: list[RawSample] = []
    star.bus.subscribe("**", heard.append)
    bus = ZenohBus.connect(star.vessel, (star.hub,), 5.0, tracker)
    with contextlib.closing(bus):

        def passes() -> bool:
            bus.put(ACTUATOR_COMMAND.key, b"from the tracker")
            bus.put("service/camera_tracker/heartbeat", b"from the tracker")
            return [s.payload for s in heard if s.key == "service/camera_tracker/heartbeat"].count(
                b"from the tracker"
            ) > 5

        wait_for(passes, 10.0, "what the tracker may publish")
    assert b"from the tracker" not in {s.payload for s in heard if s.key == ACTUATOR_COMMAND.key}


def test_no_standby_beside_a_router() -> None:
    assert HubConfig(router="tcp/127.0.0.1:7447").addresses == ("tcp/127.0.0.1:7447",)
    with pytest.raises(ValueError, match="standby: with `router` there is none"):
        HubConfig(router="tcp/127.0.0.1:7447", standby="tcp/127.0.0.1:7448")
