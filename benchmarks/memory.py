"""How much faster than real time the closed loop runs on MemoryBus, without pictures."""

from __future__ import annotations

import gc
import time

from benchmarks.result import Result
from tests.star import build_star

SECONDS = 60.0


def measure() -> list[Result]:
    """Return simulated seconds per second of the holding star, passing objects and through JSON."""
    return [Result("memory_bus_times_real_time", _factor(json=False), {"through_json": _factor(json=True)}, goal=100.0)]


def _factor(*, json: bool) -> float:
    star = build_star(json=json)
    star.bus.run_for(2.0)
    star.hold(1.5, 1.5, 0.0)
    gc.collect()
    gc.freeze()  # as `bus.run` does
    begin_s = time.perf_counter()
    star.bus.run_for(SECONDS)
    factor = SECONDS / (time.perf_counter() - begin_s)
    gc.unfreeze()
    return factor
