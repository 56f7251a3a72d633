"""`starboard hz`: how regularly variables arrive."""

from __future__ import annotations

import contextlib
import itertools
import json
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bus.clock import NS
from services.cli.options import Hub, Json, Pattern, Vessel, key_of_vessel
from services.cli.system import client

if TYPE_CHECKING:
    from bus.service import RawSample


@dataclass
class Arrivals:
    """When the messages of one key came, and what their sequence numbers say is missing."""

    received_ns: list[int] = field(default_factory=list)
    payload_bytes: int = 0
    gaps: int = 0
    out_of_order: int = 0
    _sequences: dict[str, int] = field(default_factory=dict)

    def add(self, sample: RawSample) -> None:
        """Count one message."""
        from bus.service import MAX_GAP
        from services.cli.board import fields_of

        self.received_ns.append(sample.received_ns)
        self.payload_bytes += len(sample.payload)
        values = fields_of(sample.payload)
        seq, source = values.get("seq"), str(values.get("source", ""))
        if isinstance(seq, int):
            last = self._sequences.get(source)
            if last is not None and last + 1 < seq <= last + MAX_GAP:
                self.gaps += seq - last - 1
            elif last is not None and 0 < seq <= last:  # 0: the publisher has started anew
                self.out_of_order += 1
            self._sequences[source] = seq

    def summary(self, key: str, duration_s: float) -> dict[str, Any]:
        """Return rate, spread and extremes of the intervals in ms, losses and bytes; null where too few came."""
        from statistics import pstdev

        from bus.topics import find

        times = self.received_ns
        intervals_ms = [(b - a) / 1e6 for a, b in itertools.pairwise(times)]
        span_s = (times[-1] - times[0]) / NS if len(times) > 1 else 0.0
        topic = find(key)
        regular = len(intervals_ms) > 1
        return {
            "key": key,
            "messages": len(times),
            "rate_hz": round(len(intervals_ms) / span_s, 3) if span_s > 0 else None,
            "declared_hz": topic.rate_hz if topic else None,
            "jitter_ms": round(pstdev(intervals_ms), 3) if regular else None,
            "interval_min_ms": round(min(intervals_ms), 3) if regular else None,
            "interval_max_ms": round(max(intervals_ms), 3) if regular else None,
            "gaps": self.gaps,
            "out_of_order": self.out_of_order,
            "bytes_s": round(self.payload_bytes / duration_s),
        }


def hz(
    pattern: Pattern = "**",
    seconds: Annotated[float, typer.Option(min=0.1, help="How long to listen; Ctrl-C ends it earlier.")] = 5.0,
    hub: Hub = None,
    vessel: Vessel = None,
    as_json: Json = False,
) -> None:
    """Measure rate, jitter (standard deviation of the intervals), gaps in the sequence and bytes of variables."""
    wanted, vessel = key_of_vessel(pattern, vessel)
    heard: deque[RawSample] = deque()
    with client(hub, vessel=vessel) as bus:
        begin_s = time.monotonic()
        bus.subscribe(wanted, heard.append)
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(seconds)
        duration_s = time.monotonic() - begin_s
    arrivals: dict[str, Arrivals] = {}
    for sample in heard:
        arrivals.setdefault(sample.key, Arrivals()).add(sample)
    rows = [arrivals[key].summary(key, duration_s) for key in sorted(arrivals)]
    if as_json:
        print(json.dumps({"seconds": round(duration_s, 3), "keys": rows}))
    elif rows:
        _print(rows)
    else:
        print(f"{pattern}: nothing came within {duration_s:.1f} s")


def _print(rows: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table()
    table.add_column("key", no_wrap=True)
    for name in ("messages", "rate Hz", "declared", "jitter ms", "shortest ms", "longest ms", "gaps", "kB/s"):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = ["rate_hz", "declared_hz", "jitter_ms", "interval_min_ms", "interval_max_ms"]
        cells = ["" if row[name] is None else f"{row[name]:.2f}" for name in numbers]
        style = "yellow" if row["gaps"] or row["out_of_order"] else ""
        kilobytes = f"{row['bytes_s'] / 1000:.1f}"
        table.add_row(row["key"], str(row["messages"]), *cells, str(row["gaps"]), kilobytes, style=style)
    console = Console()
    console.width = max(console.width, 130)
    console.print(table)
