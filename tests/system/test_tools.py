"""The tools against a running star: watch, get, hz, script, play, graph, a client in plain Zenoh, Ctrl-C."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from benchmarks.running_star import ROOT, RunningStar, wait_for
from bus import topics
from bus.clock import NS
from bus.messages import NavigationState
from bus.service import RawSample
from bus.zenoh_bus import ZenohBus
from logs.reader import Recording

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

STARBOARD = [sys.executable, "-m", "services.cli.main"]


@pytest.fixture(scope="module")
def star() -> Iterator[RunningStar]:
    with RunningStar() as running:
        running.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 30.0, "a pose")
        yield running


def started(star: RunningStar, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*STARBOARD, *arguments],
        cwd=ROOT, env=star.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_status_can_be_read_on_a_narrow_terminal(star: RunningStar) -> None:
    shown = star.cli("status").stdout
    for name in ("hub_standby", "camera_calibration", "platform_link", "navigation/state"):
        assert name in shown
    assert "…" not in shown
    assert "stamps are comparable to" in shown
    assert "pladypos.mcap" in star.cli("log", "list").stdout, "the running system's folder, wherever one stands"


def test_get_takes_key_expressions(star: RunningStar) -> None:
    rows = json.loads(star.cli("get", "navigation/*", "--json").stdout)
    assert [r["key"] for r in rows] == ["navigation/state"]
    rows = json.loads(star.cli("get", "actuator/**", "--json").stdout)
    assert {r["key"] for r in rows} >= {"actuator/attained", "actuator/command", "actuator/delivered"}
    assert all(r["key"].startswith("actuator/") for r in rows)
    assert all(r["age_s"] < 2.0 for r in rows)
    bad = star.cli("get", "navigation/*x")
    assert bad.returncode == 2
    assert "no key expression" in bad.stderr


def test_watch_into_a_pipe_is_a_line_a_message(star: RunningStar) -> None:
    lines = star.cli("watch", "camera/pose", "--json", "--count", "20").stdout.splitlines()
    seqs = [json.loads(line)["value"]["seq"] for line in lines]
    assert seqs == list(range(seqs[0], seqs[0] + 20))
    text = star.cli("watch", "navigation/state", "--count", "3", "--every-s", "0.2").stdout.splitlines()
    assert len(text) == 3
    assert all("navigation/state [estimator] status=tracking" in line and " rad/s" in line for line in text)


def test_ctrl_c_ends_a_tool_without_a_word_too_many(star: RunningStar) -> None:
    watch = started(star, "watch", "navigation/*")
    assert watch.stdout is not None
    assert "navigation/state" in watch.stdout.readline()
    watch.send_signal(signal.SIGINT)
    _, errors = watch.communicate(timeout=10)
    assert (watch.returncode, errors) == (0, "")


def test_watch_on_a_terminal_is_a_table_that_obeys_keys(star: RunningStar) -> None:
    terminal, its_end = pty.openpty()
    size = {"TERM": "xterm", "LINES": "30", "COLUMNS": "120"}
    watch = subprocess.Popen(
        [*STARBOARD, "watch"], cwd=ROOT, env=star.environment | size, stdin=its_end, stdout=its_end
    )
    shown = b""

    def until(text: bytes) -> None:
        nonlocal shown

        def read() -> bool:
            nonlocal shown
            if select.select([terminal], [], [], 0.1)[0]:
                shown += os.read(terminal, 65536)
            return text in shown

        wait_for(read, 10.0, f"{text!r} on the terminal")
        shown = b""

    until(b"variables, by key")
    os.write(terminal, b"/navig\r")
    until(b"filter: navig  ")
    os.write(terminal, b"\x1b[Bf")
    until(b"FROZEN")
    os.write(terminal, b"f\r")
    until(b"Esc back")
    os.write(terminal, b"q")
    assert watch.wait(10) == 0
    os.close(terminal)
    os.close(its_end)


def test_hz_measures_rate_and_gaps(star: RunningStar) -> None:
    found = json.loads(star.cli("hz", "camera/*", "--seconds", "2", "--json").stdout)
    rows = {r["key"]: r for r in found["keys"]}
    assert rows["camera/pose"]["rate_hz"] == pytest.approx(30.0, abs=3.0)
    assert rows["camera/pose"]["gaps"] == 0
    assert rows["camera/pose"]["jitter_ms"] < 30.0
    assert rows["camera/image"]["bytes_s"] > 50_000
    other = ZenohBus.connect(star.vessel, (star.hub,), 5.0)
    listener = started(star, "hz", "gappy", "--seconds", "1.5", "--json")
    seq = 0
    while listener.poll() is None:  # every third message is missing
        other.put("gappy", json.dumps({"seq": seq, "source": "t"}).encode())
        seq += 2 if seq % 3 else 1
        time.sleep(0.01)
    other.close()
    (row,) = json.loads(listener.communicate()[0])["keys"]
    assert row["gaps"] == pytest.approx(row["messages"] / 2, abs=2)


def test_poke_names_unknown_fields_and_needs_force_for_a_services_key(star: RunningStar) -> None:
    heard: list[RawSample] = []
    star.bus.subscribe("simulation/fault", heard.append)
    assert star.cli("poke", "simulation/fault", "kind=displace", "x_m=0").returncode == 0
    wait_for(lambda: heard, 5.0, "the fault")
    assert topics.SIMULATION_FAULT.message.decode(heard[0].payload).kind == "displace"
    unknown = star.cli("poke", "simulation/fault", '{"kind": "clear", "xm": 1, "ym": 2}')
    assert unknown.returncode == 2
    assert "no such field: xm, ym; fields:" in unknown.stderr
    for value in ('["kind"]', "7", "{", "kind"):
        wrong = star.cli("poke", "simulation/fault", value)
        assert wrong.returncode == 2
        assert len(wrong.stderr.strip().splitlines()) == 1
    assert "--force" in star.cli("poke", "helm/wrench", "mode=stop").stderr
    assert len(heard) == 1


SCRIPT = """
[script]
seed = 3
start_when = ["navigation/state.status == tracking"]
[draw]
x_m = { low = 1.0, high = 3.0, decimals = 2 }
[[poke]]
key = "operator/request"
fields = { request_id = "$id", client = "t", mode = "hold", x_m = "$x_m", y_m = 1.5, attended = false }
[[poke]]
at_s = 0.3
key = "operator/request"
fields = { request_id = "$id", client = "t", mode = "stop", attended = false }
when = ["helm/state.mode == hold"]
within_s = 5.0
"""


def test_a_script_drives_the_helm(star: RunningStar, tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text(SCRIPT)
    planned = [json.loads(line) for line in star.cli("script", str(path), "--dry-run", "--json").stdout.splitlines()]
    assert [p["at_s"] for p in planned] == [0.0, 0.3]
    done = star.cli("script", str(path), "--json")
    assert done.returncode == 0, done.stderr
    sent = [json.loads(line) for line in done.stdout.splitlines()]
    assert [p["fields"] for p in sent] == [p["fields"] for p in planned], "the dry run says what is sent"
    state = star.wait(topics.HELM_STATE, lambda s: s.mode == "stop", 5.0, "stopped by the script")
    assert state.refused == 0
    path.write_text(SCRIPT.replace("helm/state.mode == hold", "helm/state.mode == path").replace("5.0", "0.2"))
    failed = star.cli("script", str(path))
    assert failed.returncode == 1
    assert "helm/state.mode == path: not within 0.2 s" in failed.stderr
    assert star.cli("mode", "stop").returncode == 0


def test_a_script_is_paused_by_stopping_its_process(star: RunningStar, tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text('[[poke]]\nkey = "simulation/fault"\nfields = { kind = "clear" }\ntimes = 500\nevery_s = 0.02\n')
    script = started(star, "script", str(path), "--json")
    assert script.stdout is not None
    at_s = [json.loads(script.stdout.readline())["at_s"] for _ in range(10)]
    script.send_signal(signal.SIGSTOP)
    threading.Event().wait(1.2)  # time passes without the script: that is what is tested
    script.send_signal(signal.SIGCONT)
    at_s += [json.loads(script.stdout.readline())["at_s"] for _ in range(10)]
    script.send_signal(signal.SIGINT)
    _, errors = script.communicate(timeout=10)
    assert at_s == pytest.approx([i * 0.02 for i in range(20)])
    assert script.returncode == 130
    assert len(errors.strip().splitlines()) == 1
    assert "stopped in round 1" in errors


def test_a_log_is_played_beside_the_live_vessel(star: RunningStar) -> None:
    (log,) = star.recordings.glob("*.mcap")
    replayed: Counter[str] = Counter()
    states: list[NavigationState] = []
    played = ZenohBus.connect("replay/pladypos", (star.hub,), 5.0)

    def hear(sample: RawSample) -> None:
        replayed[sample.key] += 1
        if sample.key == "navigation/state":
            states.append(NavigationState.decode(sample.payload))

    played.subscribe("**", hear)
    recording = Recording(log)
    first_s = (next(recording.messages(topics.NAVIGATION_STATE)).log_ns - recording.start_ns) / NS
    span = ("--from", f"{first_s:.3f}", "--to", f"{first_s + 2.0:.3f}")
    begin_s = time.monotonic()
    done = star.cli("play", str(log), *span, "--speed", "2", "--topics", "navigation/*", "--json")
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - begin_s > 0.9
    told = json.loads(done.stdout)
    assert told["prefix"] == "replay/pladypos"
    assert told["complete"]
    wait_for(lambda: sum(replayed.values()) >= told["messages"], 5.0, "every message")
    assert set(replayed) == {"navigation/state"}
    assert [s.seq for s in states] == list(range(states[0].seq, states[0].seq + len(states)))
    assert states[-1].stamp_ns < time.time_ns() - 1e9, "with the stamps of the recording"
    live = star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 5.0, "the live state")
    assert live.stamp_ns > states[-1].stamp_ns
    played.close()
    nothing = star.cli("play", str(log), "--topics", "no/such")
    assert nothing.returncode == 2
    assert "log info" in nothing.stderr


def test_the_star_is_drawn_as_it_is_connected(star: RunningStar, tmp_path: Path) -> None:
    nodes = {n["name"]: n for n in json.loads(star.cli("graph", "--live", "--json").stdout)}
    assert nodes["estimator"]["state"] == "running"
    assert "navigation/state" in nodes["estimator"]["publishes"]
    assert "actuator/command" in nodes["allocator"]["publishes"], "not kept by the hub, but heard"
    assert nodes["recorder"]["reads"] is None
    done = star.cli("graph", "--svg", str(tmp_path / "star.svg"))
    assert done.returncode == 0, done.stderr
    assert "allocator" in "".join(ElementTree.parse(tmp_path / "star.svg").getroot().itertext())
    assert star.cli("graph").stdout.startswith("flowchart LR")


def test_the_example_in_plain_zenoh_does_what_it_says(star: RunningStar) -> None:
    example = ROOT / "docs" / "examples" / "plain_zenoh.py"
    assert "from bus" not in example.read_text()
    done = subprocess.run(
        [sys.executable, str(example), star.hub, star.vessel],
        cwd="/", capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "last value of pladypos/navigation/state: x" in done.stdout
    assert "begins ffd8" in done.stdout
    assert "helm: accepted" in done.stdout
    mine = json.loads(star.cli("get", "guest/distance", "--json").stdout)["value"]
    assert (mine["seq"], mine["source"]) == (9, "guest")
    beat = json.loads(star.cli("get", "service/guest/heartbeat", "--json").stdout)["value"]
    assert topics.HEARTBEAT.message.model_validate(beat).state == "running"


def test_every_message_has_its_schema_and_live_messages_fit(star: RunningStar, tmp_path: Path) -> None:
    assert star.cli("topics", "--schemas", str(tmp_path)).returncode == 0
    index = {t["key"]: t for t in json.loads((tmp_path / "topics.json").read_text())}
    assert set(index) == {t.key for t in topics.all_topics()}
    schema = json.loads((tmp_path / index["navigation/state"]["schema"]).read_text())
    assert schema["properties"]["surge_m_s"]["unit"] == "m/s"
    live = json.loads(star.cli("get", "navigation/state", "--json").stdout)["value"]
    assert set(live) <= set(schema["properties"])
    assert set(schema["required"]) <= set(live)


@pytest.mark.parametrize(
    ("shell", "words", "expected"),
    [
        ("bash", "starboard ", "watch"),
        ("bash", "starboard poke sim", "simulation/fault"),
        ("zsh", "starboard get navi", "navigation/state"),
        ("fish", "starboard mode ho", "hold"),
        ("fish", "starboard run esti", "estimator"),
    ],
)
def test_the_shell_completes_commands_keys_and_names(shell: str, words: str, expected: str) -> None:
    environment = os.environ | {
        "_STARBOARD_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
        "_TYPER_COMPLETE_ARGS": words,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    starboard = Path(sys.executable).with_name("starboard")
    done = subprocess.run([starboard], env=environment, capture_output=True, text=True, timeout=30, check=False)
    assert expected in done.stdout.replace('"', " ").replace(")", " ").split()


def test_the_completion_script_is_printed_for_bash() -> None:
    starboard = Path(sys.executable).with_name("starboard")
    done = subprocess.run(
        ["bash", "-c", f"{starboard} --show-completion; exit $?"],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "complete -o default -F _starboard_completion starboard" in done.stdout
