"""How a loop is best woken by another thread: eventfd in a selector, as bus.run does, against a Condition."""

from __future__ import annotations

import os
import selectors
import threading
import time
from collections.abc import Callable

from benchmarks.result import Result, percentile

ROUNDS = 600
PERIOD_S = 0.005


def measure() -> list[Result]:
    """Return the time from the wake to the woken loop, median and 99th percentile, for both ways."""
    eventfd = _latencies_us(*_eventfd())
    condition = _latencies_us(*_condition())
    return [
        Result(f"eventfd_wake_p{p}_us", percentile(eventfd, p), {f"condition_wake_p{p}_us": percentile(condition, p)})
        for p in (50, 99)
    ]


def _latencies_us(wake: Callable[[], None], wait: Callable[[], None]) -> list[float]:
    sent_ns = 0
    done = threading.Event()

    def work() -> None:
        nonlocal sent_ns
        for _ in range(ROUNDS):
            done.wait(PERIOD_S)
            sent_ns = time.perf_counter_ns()
            wake()

    thread = threading.Thread(target=work)
    thread.start()
    latencies = []
    for _ in range(ROUNDS):
        wait()
        latencies.append((time.perf_counter_ns() - sent_ns) * 1e-3)
    thread.join()
    return latencies


def _eventfd() -> tuple[Callable[[], None], Callable[[], None]]:
    fd = os.eventfd(0, os.EFD_NONBLOCK)
    selector = selectors.PollSelector()
    selector.register(fd, selectors.EVENT_READ)

    def wait() -> None:
        selector.select()
        os.eventfd_read(fd)

    return lambda: os.eventfd_write(fd, 1), wait


def _condition() -> tuple[Callable[[], None], Callable[[], None]]:
    condition = threading.Condition()
    pending = 0

    def wake() -> None:
        nonlocal pending
        with condition:
            pending += 1
            condition.notify()

    def wait() -> None:
        nonlocal pending
        with condition:
            while not pending:
                condition.wait()
            pending -= 1

    return wake, wait
