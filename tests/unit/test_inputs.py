"""What an input promises: interval, last of a burst, on change, bounded queue, many keys, losses counted."""

from bus import topics
from bus.clock import NS
from bus.memory_bus import MemoryBus
from bus.messages import Heartbeat, LinkStatus, Message, OperatorRequest, Wrench
from bus.service import MAX_PAYLOAD_BYTES, Input, RawInput, Service
from bus.topics import HEARTBEAT


class Reader(Service):
    """Remember when what arrived."""

    name = "reader"
    rate_hz = 0.1
    paced = Input(topics.CONTROL_WRENCH, wakes=True, min_interval_s=0.5)
    changes = Input(topics.LINK_STATUS, wakes=True, changed_only=True)
    beats = Input(HEARTBEAT)
    camera = RawInput("camera/*", wakes=True)

    def __init__(self) -> None:
        self.steps: list[float] = []
        self.got: list[tuple[float, float | None]] = []
        self.states: list[str] = []
        self.raw: list[str] = []

    def step(self, now_s: float) -> None:
        self.steps.append(now_s)
        if self.paced.updated and self.paced.latest is not None:
            self.got.append((now_s, self.paced.latest.surge_n))
        if self.changes.updated and self.changes.latest is not None:
            self.states.append(self.changes.latest.state)
        self.raw += [sample.key for sample in self.camera.take()]


def on_bus(json: bool = False) -> tuple[MemoryBus, Reader]:
    bus, reader = MemoryBus(json=json), Reader()
    bus.add(reader)
    bus.run_for(0.1)
    return bus, reader


def test_at_most_one_in_an_interval_and_the_last_of_a_burst_arrives() -> None:
    bus, reader = on_bus()
    begin_s = bus.now_s
    for i in range(20):
        bus.publish(topics.CONTROL_WRENCH, Wrench(surge_n=float(i)))
        bus.run_for(0.04)
    bus.run_for(2.0)
    times = [t - begin_s for t, _ in reader.got]
    assert times == [0.0, 0.5, 1.0]
    assert reader.got[0][1] == 0.0
    assert reader.got[-1][1] == 19.0, "the last value of the burst"
    assert reader.paced.overwritten == 20 - 3
    assert reader.paced.gaps == 0
    assert len(reader.steps) == 1 + 3, "no step for what is held back"


def test_on_change_only_the_content_counts_and_stays_fresh() -> None:
    bus, reader = on_bus(json=True)
    for state in ("connected", "connected", "disconnected", "disconnected", "connected"):
        bus.publish(topics.LINK_STATUS, LinkStatus(state=state))
        bus.run_for(0.1)
    assert reader.states == ["connected", "disconnected", "connected"]
    assert len(reader.steps) == 1 + 3
    assert reader.changes.latest is not None
    assert reader.changes.latest.seq == 4, "the newest stamp, though nothing changed"


def test_one_input_reads_all_keys_of_a_template() -> None:
    bus, reader = on_bus()
    other = Reader()
    for name in ("one", "two"):
        beat = Heartbeat(state="running", pid=1, rate_hz=1, late_steps=0, step_mean_ms=0, step_max_ms=0)
        for _ in range(3):
            bus.publish(HEARTBEAT.of(name), beat, source=name)
    bus.run_for(11.0)
    assert reader.beats.by_key["service/two/heartbeat"].source == "two"
    assert reader.beats.gaps == 0
    bus.add(other)
    bus.run_for(0.01)
    assert set(other.beats.by_key) >= {"service/one/heartbeat", "service/two/heartbeat"}, "late joiners too"


def test_a_raw_input_gets_what_fits_its_pattern_and_wakes() -> None:
    bus, reader = on_bus()
    bus.publish(topics.CAMERA_STATUS, topics.CAMERA_STATUS.message(state="searching"))
    bus.publish(topics.LINK_STATUS, LinkStatus(state="connected"))
    bus.run_for(0.01)
    assert reader.raw == ["camera/status"]


def test_a_full_queue_counts_what_it_drops() -> None:
    port = Input(topics.OPERATOR_REQUEST, queue=3)
    for seq in range(10):
        port.offer(OperatorRequest(request_id=str(seq), client="test", seq=seq, source="page").encode())
    port.refresh()
    assert [r.request_id for r in port.take()] == ["7", "8", "9"]
    assert port.dropped == 7
    assert port.gaps == 0, "they did arrive"


def test_an_interval_with_a_queue_gives_the_newest_and_counts_the_rest() -> None:
    port = Input(topics.OPERATOR_REQUEST, queue=2, min_interval_s=1.0)
    now_ns = NS
    taken: list[str] = []
    for step in range(30):
        port.offer(OperatorRequest(request_id=str(step), client="test", seq=step, source="page"))
        now_ns += NS // 10
        port.refresh(now_ns)
        taken += [r.request_id for r in port.take()]
    assert len(taken) + port.dropped + len(port._pending) == 30
    assert taken[0] == "0"
    assert len(taken) <= 1 + 2 * 2


def test_a_clock_set_back_does_not_hold_an_input_for_ever() -> None:
    port: Input[Wrench] = Input(topics.CONTROL_WRENCH, min_interval_s=1.0)
    port.offer(Wrench(surge_n=1.0))
    port.refresh(100 * NS)
    port.offer(Wrench(surge_n=2.0))
    port.refresh(50 * NS)
    assert port.latest is not None
    assert port.latest.surge_n == 2.0


def test_what_is_too_large_is_malformed_without_being_parsed() -> None:
    port: Input[Message] = Input(topics.CONTROL_WRENCH)
    port.offer(b" " * MAX_PAYLOAD_BYTES + b"{}")
    port.refresh()
    assert port.malformed == 1
    assert "bytes" in port.problem
