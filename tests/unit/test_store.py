"""The hub's memory: what it keeps, what it refuses, and that it comes back from disk and from the other hub."""

import itertools
import sys
import threading
from pathlib import Path

import pytest

from bus import store as store_module
from bus.clock import NS
from bus.hub import is_latched
from bus.messages import NavigationState, Wrench
from bus.store import MAX_VALUE_BYTES, OTHERS, Store


def store() -> Store:
    return Store(is_latched)


def state(seq: int = 0) -> bytes:
    message = NavigationState(
        status="tracking", x_m=1.0, y_m=2.0, psi_rad=0.0, surge_m_s=0.0, sway_m_s=0.0, yaw_rad_s=0.0,
        measurement_age_s=0.0, seq=seq, source="estimator", stamp_ns=7,
    )  # fmt: skip
    return message.encode()


def test_last_value_source_time_count_and_rate() -> None:
    kept = store()
    kept.renew_rates(0)
    for i in range(10):
        kept.keep("navigation/state", state(i), i * NS // 10)
    kept.renew_rates(NS)
    entry = kept.entries["navigation/state"]
    assert entry.payload == state(9)
    assert entry.source == "estimator"
    assert entry.received_ns == 9 * NS // 10
    assert entry.traffic.count == 10
    assert entry.traffic.rate_hz == pytest.approx(10.0)
    assert kept.sources["estimator"].bytes_s == pytest.approx(10 * len(state()))


def test_commands_are_counted_but_never_kept() -> None:
    kept = store()
    kept.keep("control/wrench", Wrench(source="controller").encode(), 1)
    assert kept.entries["control/wrench"].payload is None
    assert kept.entries["control/wrench"].traffic.count == 1
    again = store()
    again.merge(kept.dump())
    assert again.entries["control/wrench"].payload is None


def test_nothing_that_a_client_sends_makes_it_grow_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "MAX_KEYS", 20)
    monkeypatch.setattr(store_module, "MAX_SOURCES", 5)
    monkeypatch.setattr(store_module, "MAX_TOTAL_BYTES", 10_000)
    kept = store()
    for i in range(100):
        kept.keep(f"noise/{i}", b'{"source":"s%d"}' % i + b" " * 1000, i)
    kept.keep("noise/**", b"x", 1)
    kept.keep("noise/0", b"x" * (MAX_VALUE_BYTES + 1), 1)
    assert len(kept.entries) == 20
    assert len(kept.sources) == 6
    assert OTHERS in kept.sources
    assert sum(len(e.payload or b"") for e in kept.entries.values()) <= 10_000
    assert kept.refused >= 80 + 2


def test_it_comes_back_from_disk_and_the_newer_value_wins(tmp_path: Path) -> None:
    path = tmp_path / "hub.snapshot"
    kept = store()
    kept.keep("navigation/state", state(1), 10)
    kept.keep("camera/image", bytes(range(256)), 11)
    kept.save(path)
    again = store()
    again.keep("camera/image", b"newer", 12)
    assert again.merge(path.read_bytes()) == 1
    assert again.entries["navigation/state"].payload == state(1)
    assert again.entries["navigation/state"].source == "estimator"
    assert again.entries["camera/image"].payload == b"newer"
    assert list(tmp_path.iterdir()) == [path], "no temporary file is left"
    before = path.stat().st_mtime_ns
    kept.save(path)
    assert path.stat().st_mtime_ns == before, "nothing changed, nothing written"


@pytest.mark.parametrize("damage", [b"", b"[", b"\x00\xff", b"{}", b'[{"key": 1}]', b"[1]", b'"text"', b"[" * 9999])
def test_a_damaged_dump_is_refused_and_changes_nothing(damage: bytes) -> None:
    kept = store()
    if damage == b"{}":
        assert kept.merge(damage) == 0
    else:
        with pytest.raises(ValueError, match=r"."):
            kept.merge(damage)
    assert kept.entries == {}


def test_a_dump_that_is_cut_off_is_refused() -> None:
    kept = store()
    kept.keep("camera/image", b"x" * 100, 1)
    with pytest.raises(ValueError, match="cut off"):
        store().merge(kept.dump()[:-1])


def test_a_dump_is_whole_while_values_change() -> None:
    """The other hub asks, and the snapshot is written, while messages come in."""
    kept, over = store(), threading.Event()

    def change() -> None:
        for size in itertools.count():
            for key in range(50):
                kept.keep(f"a/{key}", f"<{key}>".encode() * (size % 7), size + 1)
            if over.is_set():
                return

    changing = threading.Thread(target=change)
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    changing.start()
    try:
        for _ in range(1000):
            other = store()
            other.merge(kept.dump())
            for key, entry in other.items():
                assert (entry.payload or b"").replace(f"<{key[2:]}>".encode(), b"") == b""
    finally:
        over.set()
        changing.join()
        sys.setswitchinterval(before_s)


def test_a_deleted_key_is_forgotten() -> None:
    kept = store()
    kept.keep("a/b", b"{}", 1)
    kept.forget("a/b")
    kept.forget("never/known")
    assert kept.entries == {}
