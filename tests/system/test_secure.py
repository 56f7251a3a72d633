"""Who is let in on a network address, and what each may do: on real hubs with TLS, passwords and access rules."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.hub_pair import VESSEL, HubPair
from benchmarks.running_star import ROOT, RunningStar, wait_for
from bus.keys import matches
from bus.service import RawSample
from bus.topics import ACTUATOR_COMMAND, CAMERA_POSE, HELM_WRENCH, NAVIGATION_STATE, OPERATOR_REQUEST, all_topics
from bus.zenoh_bus import HubUnreachableError, ZenohBus
from services.access import access_rules
from services.catalog import PROCESSES

pytestmark = pytest.mark.system


def starboard(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "services.cli.main", *arguments],
        cwd=ROOT, capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("address", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.5:7447", "tls/pool.lab:7447"])
def test_a_network_address_without_authentication_is_refused_in_one_line(address: str, tmp_path: Path) -> None:
    config = tmp_path / "open.toml"
    config.write_text(f'[hub]\nlisten = ["{address}"]\n')
    for command in (["up", str(config)], ["run", "hub", "--config", str(config)]):
        refused = starboard(*command)
        assert refused.returncode == 2
        assert refused.stderr.count("\n") == 1
        assert address in refused.stderr
        assert "starboard secure init" in refused.stderr


def test_with_security_every_address_is_encrypted(tmp_path: Path) -> None:
    config = tmp_path / "mixed.toml"
    config.write_text('[hub]\nlisten = ["tls/0.0.0.0:7447"]\nstandby = "tcp/127.0.0.1:7448"\nsecurity = "keys"\n')
    refused = starboard("up", str(config))
    assert refused.returncode == 2
    assert "tcp/127.0.0.1:7448" in refused.stderr


def allowed(user: str, message: str, flow: str) -> list[str]:
    rules = access_rules(VESSEL, PROCESSES)
    subjects = {s["id"] for s in rules["subjects"] if user in s.get("usernames", ())}
    names = {name for p in rules["policies"] if subjects & set(p["subjects"]) for name in p["rules"]}
    return [
        key
        for rule in rules["rules"]
        if rule["id"] in names and message in rule["messages"] and flow in rule["flows"]
        for key in rule["key_exprs"]
    ]


def test_each_topic_may_be_published_by_its_owner_alone() -> None:
    users = [*(p.name for p in PROCESSES if p.name not in ("hub", "hub_standby")), "operator"]
    for topic in all_topics():
        key = f"{VESSEL}/{topic.key.format(name='helm')}"
        may = {user for user in users if any(matches(e, key) for e in allowed(user, "put", "ingress"))}
        declared = {
            p.name for p in PROCESSES for port in p.service.ports.values()
            if getattr(port, "topic", None) == topic and p.name in users and "Output" in type(port).__name__
        }  # fmt: skip
        owner = {"helm"} if topic.publisher == "*" else {topic.publisher}
        assert may - {"ui"} == (declared | owner) - {"ui", "hub"}, topic.key
        assert ("ui" in may) == ("ui" in declared), topic.key
    assert [
        u for u in users if any(matches(e, f"{VESSEL}/actuator/command") for e in allowed(u, "put", "ingress"))
    ] == ["allocator"]


def test_a_secured_folder_is_its_owners_alone_and_keeps_its_passwords(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    assert starboard("secure", "init", str(folder), "--host", "10.1.2.3").returncode == 0
    secret = [folder / "ca.key", folder / "hub" / "hub.key", folder / "hub" / "passwords", folder / "users" / "helm"]
    assert {path.stat().st_mode & 0o077 for path in [folder, *secret]} == {0}
    before = [path.read_text() for path in secret]
    assert "10.1.2.3" in starboard("secure", "init", str(folder), "--host", "10.1.2.3").stdout
    assert [path.read_text() for path in secret] == before


def test_a_star_whose_services_changed_does_not_start_with_old_rules(tmp_path: Path) -> None:
    config = tmp_path / "pool.toml"
    text = f'[hub]\nlisten = ["tls/127.0.0.1:7447"]\nstandby = ""\nsecurity = "{tmp_path}/keys"\n'
    config.write_text(text)
    assert starboard("secure", "init", f"{tmp_path}/keys", "--config", str(config)).returncode == 0
    config.write_text(text + '[system]\nservices = { watcher = "services.helm:Helm" }\n')
    refused = starboard("up", str(config))
    assert refused.returncode == 2
    assert "access rules are not those of these services" in refused.stderr


@pytest.fixture(scope="module")
def pair() -> Iterator[HubPair]:
    with HubPair(secured=True) as running:
        yield running


def listen(bus: ZenohBus, pattern: str) -> list[RawSample]:
    heard: list[RawSample] = []
    bus.subscribe(pattern, heard.append)
    return heard


def test_the_tracker_may_publish_its_pose_but_no_command(pair: HubPair) -> None:
    operator, tracker, allocator = (pair.client(user) for user in ("operator", "camera_tracker", "allocator"))
    heard = listen(operator, "**")
    seen_by_tracker = listen(pair.client("camera_tracker"), "**")

    def arrived() -> bool:
        tracker.put(ACTUATOR_COMMAND.key, b"from the tracker")
        tracker.put(OPERATOR_REQUEST.key, b"from the tracker")
        tracker.put(CAMERA_POSE.key, b"from the tracker")
        allocator.put(ACTUATOR_COMMAND.key, b"from the allocator")
        keys = [s.key for s in heard]
        return keys.count(CAMERA_POSE.key) >= 5 and keys.count(ACTUATOR_COMMAND.key) >= 5

    wait_for(arrived, 10.0, "what is allowed")
    assert {s.payload for s in heard if s.key == ACTUATOR_COMMAND.key} == {b"from the allocator"}
    assert OPERATOR_REQUEST.key not in {s.key for s in heard}
    assert not seen_by_tracker, "the tracker reads no more than its ports"


def test_what_a_user_may_not_read_it_cannot_ask_for(pair: HubPair) -> None:
    estimator, tracker, operator = (pair.client(user) for user in ("estimator", "camera_tracker", "operator"))
    estimator.put(NAVIGATION_STATE.key, b"kept")
    wait_for(lambda: operator.last_values(NAVIGATION_STATE.key), 5.0, "the hub keeps it")
    assert tracker.last_values() == []
    assert pair.client("controller").last_values(NAVIGATION_STATE.key)[0].payload == b"kept"
    assert list(operator.session.get(f"{VESSEL}/@hub/store", timeout=0.5)) == [], "between hubs only"


def test_without_the_right_password_nobody_is_let_in(pair: HubPair) -> None:
    tracker = dict(pair.secured_as("camera_tracker") or {})
    anonymous = tracker | {"transport/auth/usrpwd": {}}
    wrong = tracker | {"transport/auth/usrpwd": {"user": "camera_tracker", "password": "guess"}}
    other = tracker | {"transport/auth/usrpwd": {"user": "nobody", "password": "guess"}}
    for settings in (anonymous, wrong, other):
        with pytest.raises(HubUnreachableError, match="refuses our password"):
            ZenohBus.connect(VESSEL, (pair.hub,), 0.1, settings)


def test_a_star_with_security_holds() -> None:
    with RunningStar(secured=True) as star:
        star.hold(1.2, 0.8, 0.3)
        star.wait(HELM_WRENCH, lambda w: w.mode == "hold", 5.0, "the helm acts")
        assert star.cli("get", "helm/state", "--json").returncode == 0
        refused = subprocess.run(
            [sys.executable, "-m", "services.cli.main", "get", "helm/state", "--hub", star.hub],
            cwd=ROOT, env={"STARBOARD_RUN_DIR": "/nowhere"}, capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        assert refused.returncode == 2
        assert "asks for a password" in refused.stderr
