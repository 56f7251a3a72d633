"""Ports, the stepper and the in-memory bus: what every service stands on."""

import itertools

import pytest

from bus import topics
from bus.clock import NS, SimulatedClock
from bus.memory_bus import MemoryBus
from bus.messages import Heartbeat, HelmState, HelmWrench, OperatorRequest, Wrench
from bus.service import Input, Output, RawInput, Service
from bus.topics import HEARTBEAT


class Talker(Service):
    """Publish a growing force."""

    name = "controller"
    rate_hz = 10.0
    wrench = Output(topics.CONTROL_WRENCH)

    def __init__(self) -> None:
        self.count = 0

    def step(self, now_s: float) -> None:
        self.count += 1
        self.wrench.publish(Wrench(surge_n=float(self.count)))


class Listener(Service):
    """Remember what was fresh at each step."""

    name = "helm"
    rate_hz = 50.0
    wrench = Input(topics.CONTROL_WRENCH, max_age_s=0.25, wakes=True)
    requests = Input(topics.OPERATOR_REQUEST, queue=3)
    everything = RawInput("**", queue=5)

    def __init__(self) -> None:
        self.seen: list[tuple[float, float | None]] = []
        self.asked: list[str] = []

    def step(self, now_s: float) -> None:
        fresh = self.wrench.fresh(now_s)
        self.seen.append((now_s, None if fresh is None else fresh.surge_n))
        self.asked += [r.request_id for r in self.requests.take()]


def star(json: bool = False) -> tuple[MemoryBus, Talker, Listener]:
    bus = MemoryBus(json=json)
    talker, listener = Talker(), Listener()
    bus.add(talker)
    bus.add(listener)
    return bus, talker, listener


def test_ports_belong_to_the_object_not_the_class() -> None:
    first, second = Listener(), Listener()
    first.wrench.offer(Wrench(surge_n=1.0))
    first.wrench.refresh()
    second.wrench.refresh()
    assert first.wrench.latest is not None
    assert second.wrench.latest is None


def test_a_service_steps_at_least_at_its_rate_and_is_woken_at_once() -> None:
    bus, talker, listener = star()
    bus.run_for(1.0)
    assert talker.count == 11  # at 0.0, 0.1 ... 1.0
    times = [t for t, _ in listener.seen]
    assert max(b - a for a, b in itertools.pairwise(times)) <= 1 / 50 + 1e-9
    values = [v for _, v in listener.seen if v is not None]
    assert values == sorted(values)
    assert values[-1] == 11.0


def test_freshness_is_judged_by_the_stamp() -> None:
    bus, _, listener = star()
    bus.run_for(0.35)
    bus.kill("controller")
    bus.run_for(0.2)
    assert listener.seen[-1][1] is not None
    bus.run_for(0.2)
    assert listener.seen[-1][1] is None
    old = Wrench(surge_n=9.0, stamp_ns=round((bus.now_s - 1.0) * NS))
    bus.publish(topics.CONTROL_WRENCH, old)
    bus.run_for(0.05)
    assert listener.seen[-1][1] is None, "an old wrench stays old however late it arrives"
    future = Wrench(surge_n=9.0, stamp_ns=round((bus.now_s + 5.0) * NS))
    bus.publish(topics.CONTROL_WRENCH, future)
    bus.run_for(0.05)
    assert listener.seen[-1][1] is None, "a stamp from the future is absurd"


def test_malformed_messages_are_dropped_counted_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    bus, _, listener = star(json=True)
    bus.run_for(0.1)
    for payload in (b"\x00", b"{}}", b'{"surge_n": NaN}', b'{"torque": 1}'):
        bus.publish_bytes("control/wrench", payload)
        bus.run_for(0.02)
    bus.run_for(1.2)
    beat = bus.last(HEARTBEAT.of("helm"))
    assert isinstance(beat, Heartbeat)
    assert beat.malformed == 4
    assert "control/wrench" in beat.note
    assert len([r for r in caplog.records if "malformed" in r.message]) == 1
    assert listener.seen[-1][1] is not None, "the good ones still arrive"


def test_a_message_of_the_wrong_type_is_malformed_too() -> None:
    port = Input(topics.HELM_WRENCH)
    port.offer(Heartbeat(state="running", pid=1, rate_hz=0, late_steps=0, step_mean_ms=0, step_max_ms=0))
    port.refresh()
    assert port.malformed == 1
    port.offer(HelmWrench(mode="stop"))
    port.refresh()
    assert port.updated


def test_a_malformed_message_does_not_hide_the_good_one_before_it() -> None:
    port = Input(topics.CONTROL_WRENCH)
    port.offer(Wrench(surge_n=1.0).encode())
    port.offer(b"nonsense")
    port.refresh()
    assert port.latest is not None
    assert port.latest.surge_n == 1.0
    assert port.malformed == 1


def test_gaps_in_the_sequence_are_counted_but_not_overwritten_values() -> None:
    port = Input(topics.CONTROL_WRENCH)
    for seq in (0, 1, 2):
        port.offer(Wrench(seq=seq, source="controller"))
    port.refresh()
    assert port.gaps == 0
    port.offer(Wrench(seq=6, source="controller"))
    port.refresh()
    assert port.gaps == 3
    port.offer(Wrench(seq=0, source="controller"))
    port.refresh()
    assert port.gaps == 3, "a publisher that started again is no loss"
    port.offer(Wrench(seq=10**30, source="controller"))
    port.refresh()
    assert port.gaps == 3, "nor is nonsense"


def test_what_was_sent_between_the_kept_value_and_the_first_live_one_is_no_gap() -> None:
    port = Input(topics.HELM_STATE)
    port.offer(HelmState(mode="stop", status="armed", seq=4, source="helm"), retained=True)
    port.refresh()
    assert port.latest is not None
    for seq in (9, 10, 12):
        port.offer(HelmState(mode="stop", status="armed", seq=seq, source="helm"))
        port.refresh()
    assert port.gaps == 1
    port.offer(HelmState(mode="stop", status="armed", seq=3, source="helm"), retained=True)
    port.refresh()
    assert port.latest.seq == 12, "newer came already"


def test_a_queue_keeps_all_in_order_up_to_its_bound() -> None:
    bus, _, listener = star()
    bus.run_for(0.1)
    for i in range(5):
        bus.publish(topics.OPERATOR_REQUEST, OperatorRequest(request_id=str(i), client="test"))
    bus.run_for(0.05)
    assert listener.asked == ["2", "3", "4"]
    assert listener.everything.dropped > 0


def test_late_joiners_get_states_but_never_commands() -> None:
    bus = MemoryBus()
    bus.add(Talker())
    bus.run_for(0.5)
    bus.kill("controller")
    listener = Listener()
    bus.add(listener)
    bus.run_for(0.1)
    assert all(value is None for _, value in listener.seen)


def test_a_paused_service_steps_no_more_and_goes_on_later() -> None:
    bus, talker, _ = star()
    bus.run_for(0.5)
    before = talker.count
    bus.pause("controller")
    bus.run_for(1.0)
    assert talker.count == before
    bus.resume("controller")
    bus.run_for(0.5)
    assert talker.count > before


def test_waking_without_end_is_found() -> None:
    class Echo(Service):
        name = "echo"
        inp = Input(topics.CONTROL_WRENCH, wakes=True)
        out = Output(topics.CONTROL_WRENCH)

        def step(self, now_s: float) -> None:
            self.out.publish(Wrench())

    bus = MemoryBus()
    bus.add(Echo())
    with pytest.raises(RuntimeError, match="without end"):
        bus.run_for(1.0)


def test_run_until_says_when_the_condition_is_not_met() -> None:
    bus, talker, _ = star()
    bus.run_until(lambda: talker.count >= 5, timeout_s=2.0)
    assert talker.count == 5
    with pytest.raises(TimeoutError):
        bus.run_until(lambda: False, timeout_s=0.5)


def test_an_output_off_the_bus_says_so() -> None:
    with pytest.raises(RuntimeError, match="on no bus"):
        Talker().step(0.0)


def test_time_runs_forward_only() -> None:
    clock = SimulatedClock()
    with pytest.raises(ValueError, match="forward"):
        clock.advance_to(clock.now_ns() - 1)


def test_the_heartbeat_tells_rate_and_state() -> None:
    bus, _, _ = star()
    bus.run_for(3.0)
    beat = bus.last(HEARTBEAT.of("controller"))
    assert beat is not None
    assert beat.state == "running"
    assert beat.rate_hz == pytest.approx(10.0, rel=0.2)
