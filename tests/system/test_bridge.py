"""Two communities on two machines (network namespaces), and the bridge between them."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.running_star import ROOT, secure, wait_for
from bus.bridge import BridgeConfig
from bus.keys import matches
from services.access import access_rules
from services.catalog import PROCESSES

pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]

POOL, LAKE = "10.213.7.1", "10.213.7.2"
HOME, GUARDED = "tcp/127.0.0.1:7447", "tls/127.0.0.1:7447"
CONNECT = """
import sys, time
from pathlib import Path
from bus.security import client_settings
from bus.zenoh_bus import ZenohBus
vessel, hub, *keys = sys.argv[1:]
bus = ZenohBus.connect(vessel, (hub,), 20.0, client_settings(Path(keys[0]), keys[1]) if keys else None)
"""
TALK = f"""{CONNECT}
while True:
    bus.put("navigation/state", b"here")
    bus.put("actuator/command", b"secret")
    time.sleep(0.02)
"""
LISTEN = f"""{CONNECT}
bus.subscribe("**", lambda sample: print(sample.key, sample.payload.decode(), flush=True))
print("listening", flush=True)
time.sleep(60)
"""


def ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


@pytest.fixture
def machines() -> Iterator[tuple[str, str]]:
    """Two network namespaces with a cable between them."""
    if shutil.which("ip") is None:
        pytest.skip("iproute2 is missing: apt-get install iproute2")
    pool, lake = f"sb{os.getpid()}p", f"sb{os.getpid()}l"
    with contextlib.ExitStack() as undo:
        try:
            for name in (pool, lake):
                ip("netns", "add", name)
                undo.callback(ip, "netns", "del", name)
            ip("link", "add", "sbv0", "netns", pool, "type", "veth", "peer", "name", "sbv0", "netns", lake)
            for name, address in ((pool, POOL), (lake, LAKE)):
                ip("-n", name, "addr", "add", f"{address}/24", "dev", "sbv0")
                ip("-n", name, "link", "set", "sbv0", "up")
                ip("-n", name, "link", "set", "lo", "up")
        except OSError as error:
            pytest.skip(f"no network namespaces here: {error}")
        yield pool, lake


class Machine:
    """Programs that run in one namespace."""

    def __init__(self, namespace: str, folder: Path) -> None:
        self.namespace, self.folder = namespace, folder
        self._running: list[subprocess.Popen[bytes]] = []

    def run(self, name: str, *arguments: str) -> Path:
        """Start a Python program; return the file with what it prints."""
        output = self.folder / f"{self.namespace}-{name}.txt"
        with output.open("wb") as out:
            command = ["ip", "netns", "exec", self.namespace, sys.executable, *arguments]
            environment = os.environ | {"STARBOARD_RUN_DIR": str(self.folder / self.namespace)}
            self._running.append(
                subprocess.Popen(command, cwd=ROOT, env=environment, stdout=out, stderr=subprocess.STDOUT)
            )
        return output

    def service(self, name: str, config: Path) -> Path:
        return self.run(name, "-m", "services.cli.main", "run", name, "--config", str(config))

    def stop(self) -> None:
        for process in self._running:
            process.kill()
            process.wait(5.0)


def test_chosen_variables_cross_over_tls_and_nothing_else(machines: tuple[str, str], tmp_path: Path) -> None:
    pool_config, lake_config, keys = (tmp_path / name for name in ("pool.toml", "lake.toml", "keys"))
    pool_config.write_text(
        '[system]\nservices = { bridge = "bus.bridge:Bridge" }\n'
        f'[hub]\nlisten = ["{GUARDED}", "tls/{POOL}:7447"]\nstandby = ""\nsecurity = "{keys}"\n'
        '[bridge]\nhub = []\nsend = ["navigation/state"]\nreceive = ["charlie/navigation/*"]\n'
    )
    secure(pool_config)
    for name in ("ca.pem", "users/bridge"):  # all that the others get
        (tmp_path / "of-the-pool" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(keys / name, tmp_path / "of-the-pool" / name)
    lake_config.write_text(
        f'[system]\nvessel = "charlie"\nservices = {{ bridge = "bus.bridge:Bridge" }}\n'
        f'[hub]\nlisten = ["{HOME}"]\nstandby = ""\n'
        f'[bridge]\nhub = ["tls/{POOL}:7447"]\nsecurity = "{tmp_path}/of-the-pool"\n'
        f'send = ["navigation/*", "actuator/command"]\nreceive = ["pladypos/navigation/state"]\n'
    )
    pool, lake = (Machine(name, tmp_path) for name in machines)
    try:
        lake.service("hub", lake_config)
        bridge = lake.service("bridge", lake_config)
        heard_at_lake = lake.run("listen", "-c", LISTEN, "pladypos", HOME)
        heard_at_pool = pool.run("listen", "-c", LISTEN, "charlie", GUARDED, str(keys), "operator")
        lake.run("talk", "-c", TALK, "charlie", HOME)
        pool.run("talk", "-c", TALK, "pladypos", GUARDED, str(keys), "estimator")
        pool.service("hub", pool_config)  # the far hub comes last: the bridge goes on trying
        for heard in (heard_at_lake, heard_at_pool):

            def heard_often(heard: Path = heard) -> bool:
                return heard.read_text().count("navigation/state here") > 20

            wait_for(heard_often, 25.0, f"{heard.name} hears the other's position; bridge: {bridge.read_text()}")
            assert "actuator/command" not in heard.read_text()
    finally:
        pool.stop()
        lake.stop()


def test_a_bridge_receives_from_named_other_vessels_only() -> None:
    for key in ("**", "*/navigation/state", "charlie", "charlie/@hub/store"):
        with pytest.raises(ValueError, match="begins with a vessel's name"):
            BridgeConfig(receive=(key,))


def test_its_access_is_what_it_passes_on() -> None:
    from services.catalog import Process

    processes = [*PROCESSES, Process("bridge", "bus.bridge:Bridge")]
    config = BridgeConfig(send=("navigation/*",), receive=("charlie/navigation/state",))
    rules = access_rules("pladypos", processes, {"bridge": config})
    keys = {rule["id"]: rule["key_exprs"] for rule in rules["rules"]}
    assert "charlie/navigation/state" in keys["bridge_writes"]
    assert not any(matches(key, "pladypos/actuator/command") for key in keys["bridge_writes"])
    assert keys["bridge_asks"] == keys["bridge_gets"] == ["pladypos/navigation/*"]
