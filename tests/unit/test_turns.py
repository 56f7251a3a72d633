"""Who steps a quick service: the loop or the bus' thread that brings a message, never both."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import pytest

from bus.clock import SimulatedClock
from bus.run import _Turns, _Waker
from bus.service import Input, Service
from bus.stepper import Stepper
from bus.topics import HELM_STATE, HELM_WRENCH


class Quick(Service):
    """Notes the threads that step it; can be held in a step, and can fail."""

    name = "quick"
    quick = True
    wrench = Input(HELM_WRENCH, wakes=True)
    slow = Input(HELM_STATE, wakes=True, min_interval_s=10.0)

    def __init__(self) -> None:
        self.threads: list[str] = []
        self.entered, self.go_on = threading.Event(), threading.Event()
        self.go_on.set()
        self.failure: Exception | None = None

    def step(self, now_s: float) -> None:
        self.threads.append(threading.current_thread().name)
        self.entered.set()
        assert self.go_on.wait(10.0)
        if self.failure:
            raise self.failure


class Rig:
    """A quick service between its loop (this thread) and a bus' thread."""

    def __init__(self) -> None:
        self.service, self.waker = Quick(), _Waker()
        clock = SimulatedClock()
        self.stepper = Stepper(self.service, lambda *_: None, time.perf_counter)
        self.stepper.start(clock.now_ns())
        self.turns = _Turns(self.stepper, clock, self.waker)

    def bring(self) -> threading.Thread:
        thread = threading.Thread(target=self.turns.take, name="bus")
        thread.start()
        return thread

    def loop_is_woken(self) -> bool:
        try:
            self.waker.clear()
        except BlockingIOError:
            return False
        return True


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    yield made
    made.waker.close()


def test_before_the_loop_waits_a_message_only_wakes_it(rig: Rig) -> None:
    rig.bring().join()
    assert rig.service.threads == []
    assert rig.loop_is_woken()


def test_the_bus_steps_while_the_loop_waits_and_does_not_wake_it(rig: Rig) -> None:
    rig.turns.begin()
    rig.service.wrench.offer(HELM_WRENCH.message(mode="hold"))
    rig.bring().join()
    assert rig.service.threads == ["bus"]
    assert not rig.loop_is_woken()


def test_a_message_during_a_step_of_the_loop_wakes_it_again(rig: Rig) -> None:
    rig.turns.begin()
    with rig.turns:
        rig.bring().join()
    assert rig.service.threads == []
    assert rig.loop_is_woken()


def test_the_loop_waits_for_a_step_of_the_bus(rig: Rig) -> None:
    rig.turns.begin()
    rig.service.go_on.clear()
    rig.service.wrench.offer(HELM_WRENCH.message(mode="hold"))
    bus = rig.bring()
    assert rig.service.entered.wait(10.0)
    ended = threading.Thread(target=rig.turns.end, name="loop")
    ended.start()
    rig.bring().join()
    assert rig.loop_is_woken(), "a second thread of the bus leaves it to the loop"
    assert ended.is_alive(), "the end waits for the step"
    rig.service.go_on.set()
    bus.join()
    ended.join()
    rig.bring().join()
    assert rig.service.threads == ["bus"], "none after the end"


def test_a_message_for_later_wakes_the_loop_which_keeps_the_time(rig: Rig) -> None:
    rig.turns.begin()
    for _ in range(2):
        rig.service.slow.offer(HELM_STATE.message(mode="stop", status="disarmed", suspended=False))
        rig.bring().join()
    assert rig.service.threads == ["bus"], "the second one is held back by its interval"
    assert rig.loop_is_woken()


def test_a_failing_step_fails_the_loop(rig: Rig) -> None:
    rig.turns.begin()
    rig.service.failure = ZeroDivisionError("here")
    rig.service.wrench.offer(HELM_WRENCH.message(mode="hold"))
    rig.bring().join()
    assert rig.loop_is_woken()
    with pytest.raises(ZeroDivisionError, match="here"), rig.turns:
        pass
    rig.turns.end()  # the loop's own thread does not wait for itself


def test_many_wakes_are_one_until_the_loop_looks_and_the_next_one_counts_again() -> None:
    waker = _Waker()
    with contextlib.closing(waker):
        for _ in range(3):
            for _ in range(5):
                waker.wake()
            waker.clear()
            with pytest.raises(BlockingIOError):  # nothing is left
                waker.clear()
