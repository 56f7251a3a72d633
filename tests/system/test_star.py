"""The whole star as real processes: hold by command line, faults, bad input, Ctrl-C, what the recording says."""

import json
import math
import os
import subprocess
import sys
import time
from functools import partial

import psutil
import pytest
from mcap.reader import make_reader

from benchmarks.running_star import ROOT, RunningStar, wait_for
from bus import topics
from bus.topics import HEARTBEAT
from services.catalog import load_settings
from tests.system.noting_simulator import NOTING, read_notes

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

PLACE = (1.5, 1.2, math.radians(30))


def hold(star: RunningStar) -> None:
    star.hold(*PLACE)
    settle(star)


def settle(star: RunningStar, timeout_s: float = 40.0) -> None:
    """Wait until the true vessel has been within 10 mm and 1 degree for two seconds."""

    def calm() -> bool:
        notes = read_notes(star.folder, time.time() - 2.0)
        return len(notes) > 60 and all(
            math.hypot(n.x_m - PLACE[0], n.y_m - PLACE[1]) < 0.010 and abs(n.psi_rad - PLACE[2]) < math.radians(1)
            for n in notes
        )

    wait_for(calm, timeout_s, "within 10 mm and 1 degree")


def test_hold_by_command_line_reaches_the_true_place(star: RunningStar) -> None:
    star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 20.0, "a pose")
    answer = star.cli("mode", "hold", "--x-m", "1.5", "--y-m", "1.2", "--psi-deg", "30")
    assert answer.returncode == 0, answer.stderr
    assert "accepted" in answer.stdout
    settle(star)
    refusal = star.cli("mode", "hold", "--x-m", "9")
    assert refusal.returncode == 1
    assert "pool" in refusal.stdout


def test_status_lists_every_process_and_topic(star: RunningStar) -> None:
    document = json.loads(star.cli("status", "--json").stdout)
    assert {s["name"] for s in document["services"]} >= {"hub", "helm", "estimator", "simulator", "ui", "recorder"}
    assert all(s["state"] == "running" for s in document["services"]), document["services"]
    rates = {t["key"]: t["rate_hz"] for t in document["topics"]}
    assert rates["camera/pose"] == pytest.approx(30.0, abs=5.0)
    ages = {t["key"]: t["age_s"] for t in document["topics"]}
    assert ages["navigation/state"] < 1.0


def test_get_prints_a_state_and_awaits_a_command(star: RunningStar) -> None:
    state = json.loads(star.cli("get", "navigation/state", "--json").stdout)
    assert state["key"] == "navigation/state"
    assert 0 <= state["age_s"] < 1.0
    assert state["value"]["status"] == "tracking"
    command = json.loads(star.cli("get", "actuator/command", "--json").stdout)
    assert len(command["value"]["commands"]) == 4
    missing = star.cli("get", "no/such")
    assert missing.returncode == 2
    assert len(missing.stderr.strip().splitlines()) == 1


def test_a_shifted_camera_moves_the_vessel_by_what_the_pixels_mean(star: RunningStar) -> None:
    hold(star)
    fault = star.cli("poke", "simulation/fault", '{"kind": "camera_shift", "x_px": 10}')
    assert fault.returncode == 0, fault.stderr

    def shifted() -> bool:
        notes = read_notes(star.folder, time.time() - 2.0)
        return len(notes) > 60 and all(abs(PLACE[0] - n.x_m - 10 / 160) < 0.006 for n in notes)

    wait_for(shifted, 40.0, "62 mm of true error from 10 px")
    star.cli("poke", "simulation/fault", '{"kind": "clear"}')
    settle(star)


def test_black_frames_end_the_poses_and_the_thrust_and_holding_comes_back(star: RunningStar) -> None:
    hold(star)
    begin_s = time.time()
    star.cli("poke", "simulation/fault", '{"kind": "camera_black"}')
    star.wait(topics.CAMERA_STATUS, lambda s: s.state == "searching", 5.0, "the tracker says it has lost the marker")
    star.wait(topics.HELM_STATE, lambda s: s.suspended and "pose" in s.reason, 3.0, "the helm suspends")
    wait_for(lambda: not any(n.moving for n in read_notes(star.folder, time.time() - 0.3)), 3.0, "still thrusters")
    pose = star.last(topics.CAMERA_POSE)
    assert pose is not None
    assert pose.stamp_ns * 1e-9 < time.time() - 0.2
    assert pose.stamp_ns * 1e-9 > begin_s - 1.0
    star.cli("poke", "simulation/fault", '{"kind": "camera_black", "active": false}')
    star.wait(topics.HELM_STATE, lambda s: s.mode == "hold" and not s.suspended, 5.0, "holding resumes")
    settle(star)


def test_a_flipped_byte_raises_the_crc_count_and_nothing_else(star: RunningStar) -> None:
    before = star.wait(topics.LINK_STATUS, lambda s: s.state == "connected", 5.0, "a link")
    for _ in range(3):
        star.cli("poke", "simulation/fault", '{"kind": "flip_byte"}')
    after = star.wait(topics.LINK_STATUS, lambda s: s.crc_errors >= before.crc_errors + 3, 5.0, "CRC errors")
    assert after.state == "connected"
    settle(star)


def test_malformed_messages_are_counted_and_change_nothing(star: RunningStar) -> None:
    hold(star)
    beat = star.wait(HEARTBEAT.of("allocator"), lambda _: True, 5.0, "a heartbeat")
    for payload in (
        b"",
        b"\x00\xff",
        b'{"surge_n": NaN}',
        b'{"mode": "hold", "surge_n": 1e9, "extra": 1}',
        b"[1]" * 1000,
    ):
        star.bus.put("helm/wrench", payload)
    star.wait(HEARTBEAT.of("allocator"), lambda b: b.malformed >= beat.malformed + 5, 5.0, "five malformed, counted")
    wait_for(lambda: "malformed" in star.log, 3.0, "one line about it")
    told = [line for line in star.log.splitlines() if "allocator" in line and "malformed" in line]
    assert len(told) == 1
    settle(star, 10.0)


def test_a_poke_is_checked_before_it_is_sent(star: RunningStar) -> None:
    for arguments, reason in (
        (("simulation/fault", '{"kind": "earthquake"}'), "kind"),
        (("simulation/fault", "{"), "JSON"),
        (("simulation/fault", '{"kind": "clear", "x": 1}'), "x"),
        (("helm/wrench", '{"mode": "hold"}'), "--force"),
        (("no/such", "{}"), "no such variable"),
    ):
        refused = star.cli("poke", *arguments)
        assert refused.returncode == 2
        assert len(refused.stderr.strip().splitlines()) == 1
        assert reason.lower() in refused.stderr.lower()


def test_a_second_system_and_a_second_hub_are_refused_in_one_line(star: RunningStar) -> None:
    second = star.cli("up", str(star.config))
    assert second.returncode == 2
    assert "runs already" in second.stderr
    hub = star.cli("run", "hub", "--config", str(star.config))
    assert hub.returncode == 2
    assert "another hub" in hub.stderr
    assert len(hub.stderr.strip().splitlines()) == 1


def test_a_helm_left_alone_stops_on_request(star: RunningStar) -> None:
    hold(star)
    assert star.cli("mode", "stop").returncode == 0
    wait_for(lambda: not any(n.moving for n in read_notes(star.folder, time.time() - 0.3)), 3.0, "still thrusters")


def test_ctrl_c_stops_everything_and_leaves_a_whole_recording() -> None:
    with RunningStar(system=NOTING) as star:
        star.hold(*PLACE)
        names = {p.name for p in load_settings(star.config).processes}
        assert set(star.states()) == names
        pids = [star.pid(name) for name in names]
        took_s = star.interrupt()
        assert took_s < 5.0
        assert not [pid for pid in pids if psutil.pid_exists(pid)]
        assert not (star.run_dir / "current.json").exists()
        (recording,) = star.recordings.glob("*.mcap")
        with recording.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        recorded = {channel.topic for channel in summary.channels.values()}
        assert {"pladypos/camera/image", "pladypos/navigation/state", "pladypos/helm/answer"} <= recorded
        last = max(n.stamp_s for n in read_notes(star.folder))
        assert last - summary.statistics.message_end_time * 1e-9 < 2.0
        assert "Starboard: everything has stopped" in star.log


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[estimator]\nlost_afer_s = 1\n", "estimator.lost_afer_s"),
        ("[estimatr]\n", "no such section"),
        ("[helm]\nresume_within_s = -1\n", "helm.resume_within_s"),
        ('[system]\nvessel = "titanic"\n', "no such vessel"),
        ("[system\n", "TOML"),
        ('[system]\nservices = { mine = "no.such:Thing" }\n', "no.such"),
    ],
)
def test_a_wrong_configuration_is_one_line_and_starts_nothing(tmp_path: object, text: str, reason: str) -> None:
    path = f"{tmp_path}/wrong.toml"
    with open(path, "w") as file:
        file.write(text)
    done = subprocess.run(
        [sys.executable, "-m", "services.cli.main", "up", path],
        cwd=ROOT, env=os.environ | {"STARBOARD_RUN_DIR": f"{tmp_path}/run"},
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert reason in done.stderr
    assert "wrong.toml" in done.stderr or "titanic" in done.stderr or "no.such" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_without_a_system_the_tools_say_so_in_one_line(tmp_path: object) -> None:
    environment = os.environ | {"STARBOARD_RUN_DIR": f"{tmp_path}/run"}
    done = subprocess.run(
        [sys.executable, "-m", "services.cli.main", "status", "--hub", "tcp/127.0.0.1:9"],
        cwd=ROOT, env=environment, capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "starboard up" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_missing_camera_and_port_stop_nothing_else() -> None:
    sections = (
        '[camera_tracker]\nsource = "/dev/video97"\n[platform_link]\nuri = "serial:///dev/ttyUSB97?baud=115200"\n'
    )
    with RunningStar(sections, system="simulation = false") as star:
        camera = star.wait(topics.CAMERA_STATUS, lambda s: s.state == "no_camera", 20.0, "no camera")
        link = star.wait(topics.LINK_STATUS, lambda s: s.state == "disconnected", 20.0, "no port")
        assert "video97" in camera.error
        assert "ttyUSB97" in link.error
        assert "\n" not in camera.error + link.error
        refusal = star.request(mode="hold")
        assert not refusal.accepted
        assert "pose" in refusal.reason
        first = star.wait(HEARTBEAT.of("camera_tracker"), lambda _: True, 5.0, "a heartbeat")
        star.wait(HEARTBEAT.of("camera_tracker"), lambda b: b.seq >= first.seq + 3, 8.0, "the tracker lives on")
        assert all(s["restarts"] == 0 for s in star.states().values()), star.states()

        def told(what: str) -> list[str]:
            return [line for line in star.log.splitlines() if what in line]

        for missing in ("video97", "ttyUSB97"):
            wait_for(partial(told, missing), 10.0, f"{missing} is told to be missing")
            assert len(told(missing)) == 1, "one line in the terminal, however often it is tried again"
