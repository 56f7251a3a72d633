"""The hub's memory: last value, source, time, count and rate of every key, in bounds that no client can exceed."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bus.clock import NS
from bus.keys import is_pattern

MAX_KEYS = 10_000
MAX_VALUE_BYTES = 2_000_000
MAX_TOTAL_BYTES = 64_000_000
MAX_SOURCES = 500
OTHERS = "(others)"
QUIET_NS = 3 * NS
"""A key that was silent for so long will not soon be published again."""

_SOURCE = re.compile(rb'"source"\s*:\s*"([^"\\]{0,64})"')
_HEADER_BYTES = 300
"""Every message begins with its header (bus.messages.Message): the source stands within so many bytes."""


class Counter:
    """Messages and bytes, and their rates over the time between two calls of `renew`."""

    __slots__ = ("_bytes", "_count", "bytes", "bytes_s", "count", "rate_hz")

    def __init__(self, count: int = 0) -> None:
        self.count = self._count = count
        self.bytes = self._bytes = 0
        self.rate_hz = 0.0
        self.bytes_s = 0.0

    def add(self, size: int) -> None:
        """Count one message."""
        self.count += 1
        self.bytes += size

    def renew(self, seconds: float) -> None:
        """Work out the rates since the last call."""
        self.rate_hz = (self.count - self._count) / seconds
        self.bytes_s = (self.bytes - self._bytes) / seconds
        self._count, self._bytes = self.count, self.bytes


@dataclass
class Entry:
    """What the hub knows of one key; `payload` is None where it must not come back from the past."""

    latched: bool
    traffic: Counter
    payload: bytes | None = None
    received_ns: int = 0
    source: str = ""


class Store:
    """Last values by key (without the vessel). Its methods may be called from any thread.

    Commands and requests are counted but not kept (`latched` tells which): they must never come back from the past.
    """

    def __init__(self, latched: Callable[[str], bool]) -> None:
        self.refused = 0
        """Messages not kept: too many keys, too many bytes, a wildcard as key, or none ("") that could be trusted."""
        self.news = False
        """Whether something came on a key that was new, or quiet: for whoever resets it."""
        self.total = Counter()
        self.entries: dict[str, Entry] = {}
        self.sources: dict[str, Counter] = {}
        self._latched = latched
        self._bytes = 0
        self._renewed_ns = 0
        self._lock = threading.Lock()
        self._changed = False

    def keep(self, key: str, payload: bytes, now_ns: int) -> None:
        """Take in a message that was published."""
        with self._lock:
            size = len(payload)
            self.total.add(size)
            source = _source(payload)
            self._counter(source).add(size)
            entry = self._entry(key)
            if entry is None or size > MAX_VALUE_BYTES:
                self.refused += 1
                return
            entry.traffic.add(size)
            self.news |= entry.latched and now_ns - entry.received_ns > QUIET_NS
            entry.received_ns, entry.source = now_ns, source
            self._changed = True
            if entry.latched:
                self._put(entry, payload)

    def forget(self, key: str) -> None:
        """Drop a key that its owner has deleted."""
        with self._lock:
            entry = self.entries.pop(key, None)
            if entry is not None:
                self._bytes -= len(entry.payload or b"")

    def renew_rates(self, now_ns: int) -> None:
        """Work out all rates since the last call."""
        with self._lock:
            seconds = max(now_ns - self._renewed_ns, 1) / NS
            for counter in (self.total, *self.sources.values(), *(e.traffic for e in self.entries.values())):
                counter.renew(seconds)
            self._renewed_ns = now_ns

    @property
    def newest_ns(self) -> int:
        """When the newest value came, 0 without any."""
        with self._lock:
            return max((e.received_ns for e in self.entries.values()), default=0)

    def items(self) -> list[tuple[str, Entry]]:
        """Return all keys with what is known of them."""
        with self._lock:
            return list(self.entries.items())

    def dump(self, since_ns: int = 0) -> bytes:
        """Return what came since a time as bytes: one line of JSON, then the payloads one after the other."""
        with self._lock:
            items = [(key, e, e.payload) for key, e in self.entries.items() if e.received_ns >= since_ns]
        index = [
            {
                "key": key,
                "size": None if payload is None else len(payload),
                "received_ns": e.received_ns,
                "count": e.traffic.count,
                "source": e.source,
            }
            for key, e, payload in items
        ]
        return b"\n".join([json.dumps(index).encode(), b"".join(payload or b"" for _, _, payload in items)])

    def merge(self, dumped: bytes) -> int:
        """Take over what is newer in another store's dump; return how many keys. Raises ValueError for nonsense."""
        head, _, rest = dumped.partition(b"\n")
        try:
            with self._lock:
                return sum(self._merge_one(about, payload) for about, payload in _parts(json.loads(head), rest))
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"no dump of a store: {error}") from None

    def save(self, path: Path) -> None:
        """Write the dump to a file, whole or not at all, if anything changed; raise OSError when the disk refuses."""
        if self._changed:
            self._changed = False
            temporary = path.with_suffix(".tmp")
            temporary.write_bytes(self.dump())
            temporary.replace(path)

    def _merge_one(self, about: dict[str, Any], payload: bytes | None) -> bool:
        entry = self._entry(str(about["key"]))
        if entry is None or int(about["received_ns"]) <= entry.received_ns:
            return False
        if entry.received_ns:  # its rate goes on
            entry.traffic.count = max(entry.traffic.count, int(about["count"]))
        else:
            entry.traffic = Counter(int(about["count"]))
        entry.received_ns, entry.source = int(about["received_ns"]), str(about["source"])
        if entry.latched and payload is not None and len(payload) <= MAX_VALUE_BYTES:
            self._put(entry, payload)
        self._changed = True
        return True

    def _entry(self, key: str) -> Entry | None:
        entry = self.entries.get(key)
        if entry is None and key and len(self.entries) < MAX_KEYS and not is_pattern(key):
            entry = self.entries[key] = Entry(self._latched(key), Counter())
        return entry

    def _put(self, entry: Entry, payload: bytes) -> None:
        grown = self._bytes + len(payload) - len(entry.payload or b"")
        if grown > MAX_TOTAL_BYTES:
            self.refused += 1
            return
        self._bytes = grown
        entry.payload = payload

    def _counter(self, source: str) -> Counter:
        known = self.sources.get(source)
        if known is None:
            name = source if len(self.sources) < MAX_SOURCES else OTHERS
            known = self.sources.setdefault(name, Counter())
        return known


def _source(payload: bytes) -> str:
    found = _SOURCE.search(payload, 0, _HEADER_BYTES)
    return found.group(1).decode(errors="replace") if found else ""


def _parts(index: Any, rest: bytes) -> Iterable[tuple[dict[str, Any], bytes | None]]:
    begin = 0
    for about in index:
        size = about["size"]
        if size is not None and not 0 <= size <= len(rest) - begin:
            raise ValueError("no dump of a store: it is cut off")
        yield about, None if size is None else rest[begin : begin + size]
        begin += size or 0
