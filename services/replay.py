"""A recording through one service, offline on `MemoryBus`: what it would have published, beside what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from bus.clock import NS
from bus.memory_bus import MemoryBus
from bus.messages import Message
from bus.service import RawSample, Service
from logs.reader import Recording

_NEAR_NS = NS // 50


@dataclass
class Comparison:
    """One key that a service publishes: how many messages then and now, and how far the numbers are apart."""

    key: str
    recorded: int = 0
    replayed: int = 0
    compared: int = 0
    """Replayed messages that were compared with the recorded one of the nearest stamp, within 20 ms."""
    largest: dict[str, float] = field(default_factory=dict)
    """Field -> largest difference."""


@dataclass
class Replay:
    """What came out."""

    samples: list[RawSample]
    comparisons: list[Comparison]


def replay(recording: Recording, service: Service) -> Replay:
    """Return what a service publishes when it is fed with the recorded messages at the times they came."""
    bus = MemoryBus()
    bus.clock.advance_to(max(recording.start_ns, bus.clock.now_ns()))
    now: dict[str, list[Message]] = {port.topic.key: [] for port in service.outputs}
    samples: list[RawSample] = []

    def taker(key: str) -> Callable[[Message], None]:
        def take(message: Message) -> None:
            now[key].append(message)
            samples.append(RawSample(key, message.encode(), bus.clock.now_ns()))

        return take

    for port in service.outputs:
        bus.tap(port.topic, taker(port.topic.key))
    read = {port.topic.key for port in service.inputs} - now.keys()  # what it says itself it hears from itself
    wanted = [key for key in recording.topics if key in read]
    bus.add(service)
    for entry in recording.messages(*wanted) if wanted else ():
        if entry.log_ns > bus.clock.now_ns():
            bus.run_for((entry.log_ns - bus.clock.now_ns()) / NS)
        if isinstance(entry.message, Message):
            bus.publish_bytes(entry.key, entry.message.encode())
    bus.run_for(0.0)
    bus.stop(service.name)
    return Replay(samples, [_compare(recording, key, messages) for key, messages in now.items()])


def _compare(recording: Recording, key: str, replayed: list[Message]) -> Comparison:
    found = Comparison(key, replayed=len(replayed))
    if key not in recording.topics:
        return found
    recorded = [e.message for e in recording.messages(key) if isinstance(e.message, Message)]
    found.recorded = len(recorded)
    at = 0  # each recorded message is compared once
    for message in replayed:
        while at + 1 < len(recorded) and _apart_ns(message, recorded[at + 1]) < _apart_ns(message, recorded[at]):
            at += 1
        if at == len(recorded) or _apart_ns(message, recorded[at]) > _NEAR_NS:
            continue
        found.compared += 1
        for name, difference in _differences(message, recorded[at]):
            found.largest[name] = max(found.largest.get(name, 0.0), difference)
        at += 1
    return found


def _apart_ns(a: Message, b: Message) -> int:
    return abs(a.stamp_ns - b.stamp_ns)


def _differences(a: Message, b: Message) -> Iterator[tuple[str, float]]:
    for name in type(a).model_fields.keys() - Message.model_fields.keys():
        one, other = getattr(a, name), getattr(b, name, None)
        if _number(one) and _number(other):
            yield name, abs(one - other)
        elif isinstance(one, dict) and isinstance(other, dict):
            both = [k for k in one if _number(one[k]) and _number(other.get(k))]
            yield from ((f"{name}.{k}", abs(one[k] - other[k])) for k in both)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
