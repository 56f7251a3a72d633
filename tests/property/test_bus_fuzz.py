"""Whatever bytes come on whatever key: ports, store and wildcards neither raise nor lose count."""

import zenoh
from hypothesis import example, given
from hypothesis import strategies as st

from bus import topics
from bus.hub import is_latched
from bus.keys import matches
from bus.memory_bus import MemoryBus
from bus.messages import NavigationState, Wrench
from bus.service import Input
from bus.store import Store
from tests.unit.test_inputs import Reader

TOPICS = [t for t in topics.all_topics() if "{" not in t.key]
GOOD = Wrench(stamp_ns=1, source="controller", surge_n=1.0).encode()

damaged = st.tuples(
    st.sampled_from([GOOD, NavigationState.__name__.encode()]), st.integers(0, 200), st.binary(max_size=4)
).map(lambda parts: parts[0][: parts[1]] + parts[2] + parts[0][parts[1] + len(parts[2]) :])
json_like = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["surge_n", "seq", "source", "stamp_ns", "x"]), inner, max_size=4)
    ),
    max_leaves=8,
).map(lambda value: str(value).replace("'", '"').encode())
payloads = st.binary(max_size=200) | damaged | json_like
chunks = st.sampled_from(["a", "b", "ab", "@a", "x.y"])
keys = st.lists(chunks, min_size=1, max_size=4).map("/".join)
patterns = st.lists(chunks | st.sampled_from(["*", "**", "a$*"]), min_size=1, max_size=4).map("/".join)


@given(st.sampled_from(TOPICS), st.lists(payloads, max_size=8))
def test_an_input_counts_each_sample_as_good_or_malformed(topic: topics.Topic[Wrench], offered: list[bytes]) -> None:
    port = Input(topic, queue=100)
    for payload in offered:
        port.offer(payload)
    port.refresh()
    assert len(port.take()) + port.malformed == len(offered)


@given(st.lists(st.tuples(keys | patterns, payloads), max_size=20))
def test_the_store_counts_everything_and_its_dump_comes_back(published: list[tuple[str, bytes]]) -> None:
    kept, again = Store(is_latched), Store(is_latched)
    for i, (key, payload) in enumerate(published, 1):
        kept.keep(key, payload, i)
    assert kept.total.count == len(published)
    assert sum(e.traffic.count for e in kept.entries.values()) + kept.refused == len(published)
    again.merge(kept.dump())
    assert {k: e.payload for k, e in again.items()} == {k: e.payload for k, e in kept.items()}


@given(st.binary(max_size=300))
def test_a_store_takes_a_dump_or_refuses_it(nonsense: bytes) -> None:
    store = Store(is_latched)
    try:
        store.merge(nonsense)
    except ValueError:
        assert all(e.payload is None or e.latched for _, e in store.items())


@given(patterns, keys)
@example("a/**/b", "a/b")
@example("**", "@a")
@example("a/*", "a/@a")
def test_patterns_fit_what_zenohs_fit(pattern: str, key: str) -> None:
    assert matches(pattern, key) == zenoh.KeyExpr.autocanonize(pattern).intersects(zenoh.KeyExpr(key))


@given(st.lists(st.tuples(st.sampled_from([t.key for t in TOPICS]), payloads), max_size=10))
def test_services_on_the_bus_go_on(published: list[tuple[str, bytes]]) -> None:
    bus, reader = MemoryBus(json=True), Reader()
    bus.add(reader)
    for key, payload in published:
        bus.publish_bytes(key, payload)
        bus.run_for(0.6)
    bus.publish(topics.CONTROL_WRENCH, Wrench(surge_n=5.0))
    bus.run_for(0.6)
    assert reader.got[-1][1] == 5.0
