"""One time for the whole star: faster than real time, and the same on machines whose clocks differ."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from benchmarks.hub_pair import VESSEL, HubPair
from benchmarks.running_star import ROOT, RunningStar, wait_for
from bus.clock import NS, StarClock, Warp
from bus.messages import HelmState, SimulationTruth
from bus.topics import ACTUATOR_COMMAND, CAMERA_STATUS, HEARTBEAT, HELM_STATE, HUB_STATISTICS, SIMULATION_TRUTH
from bus.zenoh_bus import ZenohBus

pytestmark = pytest.mark.system

FACTOR = 4.0
SHIFT_NS = -3_200_000_000


class ShiftedClock:
    """The clock of a machine that is 3.2 s behind."""

    def now_ns(self) -> int:
        return time.time_ns() + SHIFT_NS


def test_only_what_passed_since_the_epoch_is_multiplied() -> None:
    epoch_ns = 1_800_000_000 * NS
    assert Warp(5.0, epoch_ns).of(epoch_ns) == epoch_ns
    assert Warp(5.0, epoch_ns).of(epoch_ns + 2 * NS) == epoch_ns + 10 * NS
    assert Warp().of(epoch_ns + 1) == epoch_ns + 1


def test_the_offset_is_that_of_the_shortest_round_trip() -> None:
    clock = StarClock(ShiftedClock())
    asked_ns = clock.machine_ns()

    def told(hub_ns: int) -> bytes:
        return json.dumps({"real_ns": hub_ns, "factor": 1.0, "epoch_ns": 0}).encode()

    clock.hear(asked_ns, told(asked_ns - SHIFT_NS + 9_000_000), asked_ns + 10_000_000)  # 9 ms there, 1 ms back
    assert clock.offset_ns == pytest.approx(-SHIFT_NS + 4_000_000)
    assert clock.uncertainty_ns == 5_000_000, "it says by how much it may be wrong"
    clock.hear(asked_ns, told(asked_ns - SHIFT_NS + 100_000), asked_ns + 200_000)
    assert clock.offset_ns == -SHIFT_NS
    assert clock.uncertainty_ns == 100_000
    for nonsense in (b"", b"[]", b"{}", told(0)):
        with pytest.raises(ValueError, match=r"hub's time|Expecting|char"):
            clock.hear(asked_ns, nonsense, asked_ns - 1)
    assert clock.offset_ns == -SHIFT_NS


def test_a_clock_within_the_uncertainty_is_left_alone() -> None:
    clock = StarClock()
    asked_ns = clock.machine_ns()
    clock.hear(asked_ns, StarClock().tell(), clock.machine_ns())
    assert clock.offset_ns == 0


@pytest.fixture(scope="module")
def pair() -> Iterator[HubPair]:
    with HubPair() as running:
        yield running


def test_two_machines_with_different_clocks_have_one_time(pair: HubPair) -> None:
    clock = StarClock(ShiftedClock())
    bus = ZenohBus.connect(VESSEL, pair.endpoints, 5.0, clock=clock)
    try:

        def measured() -> bool:
            bus.ask_time()
            return (clock.uncertainty_ns or NS) < 1_000_000

        wait_for(measured, 10.0, "a round trip below 2 ms")
        before_ns = time.time_ns()
        star_ns = clock.now_ns()
        assert -1_000_000 < star_ns - before_ns < 1_000_000 + (time.time_ns() - before_ns)
        assert abs(clock.offset_ns + SHIFT_NS) < 1_000_000
    finally:
        bus.close()


def test_a_process_with_a_wrong_clock_stamps_right_and_tells_its_offset(pair: HubPair) -> None:
    """The far machine, as a process of its own: the allocator with a clock 3.2 s behind."""
    program = (
        "import sys, bus.clock; from tests.system.test_warp import ShiftedClock;"
        "bus.clock.CLOCK._machine = ShiftedClock(); from services.cli.main import main; main()"
    )
    client = pair.client()
    beats: list[tuple[int, float, float]] = []
    topic = HEARTBEAT.of("allocator")

    def hear(payload: bytes, received_ns: int) -> None:
        beat = topic.message.decode(payload)
        beats.append((received_ns - beat.stamp_ns, beat.clock_offset_s, beat.clock_uncertainty_s or 1.0))

    client.subscribe(topic.key, lambda sample: hear(sample.payload, sample.received_ns))
    arguments = ["run", "allocator", "--config", f"{pair.folder}/config.toml"]
    process = subprocess.Popen([sys.executable, "-c", program, *arguments], cwd=ROOT, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: any(beat[2] < 1e-3 for beat in beats), 15.0, "a good measurement")
        status = subprocess.run(
            [sys.executable, "-m", "services.cli.main", "status", "--json", "--hub", pair.hub],
            cwd=ROOT, env=os.environ | {"STARBOARD_RUN_DIR": f"{pair.folder}/none"}, capture_output=True, text=True,
            timeout=30, check=True,
        )  # fmt: skip
        (shown,) = (s for s in json.loads(status.stdout)["services"] if s["name"] == "allocator")
        assert shown["clock_offset_ms"] == pytest.approx(-SHIFT_NS / 1e6, abs=shown["clock_uncertainty_ms"] + 0.5)
    finally:
        process.terminate()
        process.wait(5.0)
    late_ns, offset_s, _ = beats[-1]
    assert offset_s == pytest.approx(-SHIFT_NS / NS, abs=1e-3)
    assert -1_000_000 < late_ns < 500_000_000


@pytest.fixture(scope="module")
def star() -> Iterator[RunningStar]:
    with RunningStar(arguments=("--warp", f"{FACTOR:g}")) as running:
        yield running


def test_the_whole_star_runs_faster(star: RunningStar) -> None:
    star.hold(1.2, 0.8, 0.0)
    assert star.wait(CAMERA_STATUS, lambda s: s.state == "tracking", 5.0, "poses").camera == "stand-in"
    first, begin_s = star.wait(SIMULATION_TRUTH, lambda t: True, 5.0, "the world"), time.monotonic()

    def there(truth: SimulationTruth) -> bool:
        return abs(truth.x_m - 1.2) < 0.02 and abs(truth.y_m - 0.8) < 0.02 and truth.stamp_ns - first.stamp_ns > 12 * NS

    last = star.wait(SIMULATION_TRUTH, there, 15.0, "the vessel is there")
    real_s = time.monotonic() - begin_s
    assert (last.stamp_ns - first.stamp_ns) / NS == pytest.approx(FACTOR * real_s, rel=0.1)
    assert real_s < 10.0, "20 s of the thesis' step response in less than 10"


def test_all_processes_tell_the_same_factor_and_what_is_reached(star: RunningStar) -> None:
    def told() -> dict[str, object] | None:
        status = json.loads(star.cli("status", "--json").stdout)
        services = status["services"]
        if all(s["warp"] == FACTOR and s["warp_reached"] > 0 for s in services):
            assert {s["clock_offset_ms"] for s in services} == {0.0}, "on one machine there is one clock"
            assert max(t["age_s"] for t in status["topics"] if t["key"] == "navigation/state") < 2.0
            warp: dict[str, object] = status["warp"]
            return warp
        return None

    warp = wait_for(told, 15.0, "every heartbeat")
    assert warp["factor"] == FACTOR
    assert 0.3 * FACTOR < warp["reached"] <= FACTOR
    assert warp["slowest"]


def test_leases_last_in_real_time(star: RunningStar) -> None:
    assert star.request(mode="hold", x_m=1.2, y_m=0.8, psi_rad=0.0, attended=True, lease_s=2.0).accepted
    begin_s = time.monotonic()

    def lost(state: HelmState) -> bool:
        return state.holder == ""

    star.wait(HELM_STATE, lambda s: s.holder == "test", 2.0, "the lease is held")
    star.wait(HELM_STATE, lost, 5.0, "the lease ends")
    assert 1.8 < time.monotonic() - begin_s < 3.0


def test_dead_men_act_in_the_stars_time(star: RunningStar) -> None:
    star.hold(1.2, 0.8, 0.0)
    star.wait(ACTUATOR_COMMAND, lambda c: any(c.commands.values()), 5.0, "the thrusters work")
    os.kill(star.pid("helm"), signal.SIGSTOP)
    begin_s = time.monotonic()
    star.wait(ACTUATOR_COMMAND, lambda c: not any(c.commands.values()), 2.0, "the allocator's dead-man")
    os.kill(star.pid("helm"), signal.SIGCONT)
    assert time.monotonic() - begin_s < 0.5, "0.25 s of the star's time, a quarter of that for us"


def test_a_hub_that_comes_back_goes_on_in_the_same_time(star: RunningStar) -> None:
    os.kill(star.pid("hub"), signal.SIGKILL)
    wait_for(lambda: star.states()["hub"]["restarts"] == 1 and star.states()["hub"]["state"] == "running", 20.0, "back")
    here_ns = star.bus.clock.now_ns()
    star.wait(HUB_STATISTICS, lambda s: s.source == "hub" and s.stamp_ns > here_ns, 10.0, "the hub tells again")
    told_ns, truth = star.bus.clock.now_ns(), star.last(SIMULATION_TRUTH)
    assert truth is not None
    assert abs(truth.stamp_ns - told_ns) < 2 * NS


def test_the_real_pool_has_no_other_time() -> None:
    refused = subprocess.run(
        [sys.executable, "-m", "services.cli.main", "up", "config/pool.toml", "--warp", "3"],
        cwd=ROOT, capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert refused.returncode == 2
    assert refused.stderr.startswith("starboard: --warp 3: only a simulated world")
    assert refused.stderr.count("\n") == 1
