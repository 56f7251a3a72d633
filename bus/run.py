"""The loop of every process: signals, rate, heartbeat, watchdogs. It owns all that a service does not.

The loop waits in one selector on an eventfd that the bus writes, on the files a service names and on the signal's
descriptor. A service whose steps are `quick` is stepped by the bus' thread that brings the message while the loop
waits: waking another thread would take longer than the step. Readiness and life are told to the supervisor by systemd's
protocol (`NOTIFY_SOCKET`), so the same process runs under `starboard up`, under systemd (`Type=notify`,
`WatchdogSec=`) and by hand.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import gc
import logging
import os
import selectors
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence

from bus.clock import NS, Clock
from bus.service import Service
from bus.stepper import Stepper
from bus.zenoh_bus import ZenohBus

WATCHDOG_S = 2.0
"""A loop that does not come round for so long is killed, with a traceback of where it hangs."""
_REARM_S = 0.5
_ASK_TIME_S = 2.0


def run(service: Service, bus: ZenohBus) -> None:
    """Run a service until SIGTERM or SIGINT; then bring it into its safe state and leave the bus.

    Whatever a step raises ends the process with a traceback, after `service.stop`: the supervisor starts it again.
    """
    service.warp = bus.clock.warp.factor
    with _signals() as signal_fd, contextlib.closing(_Waker()) as waker:
        stepper = Stepper(service, bus.publish, time.perf_counter, bus.clock)
        turns = _Turns(stepper, bus.clock, waker)
        bus.attach(service, turns.take if service.quick else waker.wake)
        try:
            with _Watchdog() as watchdog:
                _loop(turns, bus, waker, signal_fd, watchdog)
        finally:
            turns.end()
            _notify("STOPPING=1")
            stepper.stop(bus.clock.now_ns())
            bus.close()


def _loop(turns: _Turns, bus: ZenohBus, waker: _Waker, signal_fd: int, watchdog: _Watchdog) -> None:
    clock, stepper = bus.clock, turns.stepper
    asked_s = time.monotonic()
    stepper.start(clock.now_ns())
    _notify("READY=1")
    gc.collect()
    gc.freeze()  # what start made lives for ever: never walk it again
    watched: Sequence[int] = ()
    turns.begin()
    with selectors.PollSelector() as selector:
        selector.register(waker.fd, selectors.EVENT_READ)
        selector.register(signal_fd, selectors.EVENT_READ)
        while True:
            with turns:
                watched = _watch(selector, watched, stepper.service.files())
                now_ns = clock.now_ns()
                wait_s = (stepper.next_ns(now_ns) - now_ns) / NS / clock.warp.factor
            ready = {key.fd for key, _ in selector.select(max(wait_s, 0.0))}
            if signal_fd in ready:
                return
            with turns:
                now_ns = clock.now_ns()
                if waker.fd in ready:
                    waker.clear()
                    if not stepper.woken(now_ns):
                        ready.remove(waker.fd)
                if ready or now_ns >= stepper.next_ns(now_ns):
                    stepper.step(now_ns)
            real_s = time.monotonic()
            watchdog.feed(real_s)
            if real_s - asked_s >= _ASK_TIME_S:
                asked_s = real_s
                bus.ask_time()


def _watch(selector: selectors.BaseSelector, watched: Sequence[int], wanted: Sequence[int]) -> Sequence[int]:
    """Follow the files a service names. (poll, not epoll: that forgets a descriptor that was closed and came again.)"""
    if watched == wanted:
        return watched
    for fd in watched:
        with contextlib.suppress(KeyError, ValueError):
            selector.unregister(fd)
    for fd in wanted:
        selector.register(fd, selectors.EVENT_READ)
    return tuple(wanted)


class _Waker:
    """An eventfd that the bus writes from its threads."""

    def __init__(self) -> None:
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._written = False

    def wake(self) -> None:
        if self._written:  # the loop has not looked yet; it will find this message, too
            return
        self._written = True
        with contextlib.suppress(OSError):  # a late message while the loop closes
            os.eventfd_write(self.fd, 1)

    def clear(self) -> None:
        os.eventfd_read(self.fd)
        self._written = False  # last: a wake between the two would be read and its mark would stay

    def close(self) -> None:
        os.close(self.fd)


class _Turns:
    """Who steps the service: the loop (`with turns`), or the bus' thread that brings a message (`take`)."""

    def __init__(self, stepper: Stepper, clock: Clock, waker: _Waker) -> None:
        self.stepper = stepper
        self._clock = clock
        self._waker = waker
        self._lock = threading.RLock()
        self._lock.acquire()  # the loop's until it begins to wait
        self._failure: BaseException | None = None

    def begin(self) -> None:
        """Let the bus' thread step too."""
        self._lock.release()

    def __enter__(self) -> None:
        self._lock.acquire()
        if self._failure is not None:
            raise self._failure

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def take(self) -> None:
        """Step at once, or wake the loop if it has the turn, or for what is its part: a later step, a failure."""
        if not self._lock.acquire(blocking=False):
            self._waker.wake()
            return
        try:
            now_ns = self._clock.now_ns()
            if self._failure is None and self.stepper.woken(now_ns):
                self.stepper.step(now_ns)
                return
        except BaseException as failure:  # the loop raises it
            self._failure = failure
        finally:
            self._lock.release()
        self._waker.wake()

    def end(self) -> None:
        """Wait for a step of the bus' thread, if there is one; there are none from now on."""
        self._lock.acquire()


class _Watchdog:
    """Ends a process whose loop hangs, and tells the supervisor that this one does not."""

    def __init__(self) -> None:
        self._fed_s = -_REARM_S

    def __enter__(self) -> _Watchdog:
        return self

    def __exit__(self, *_: object) -> None:
        faulthandler.cancel_dump_traceback_later()

    def feed(self, real_s: float) -> None:
        if real_s - self._fed_s < _REARM_S:
            return
        self._fed_s = real_s
        faulthandler.dump_traceback_later(WATCHDOG_S, exit=True)
        _notify("WATCHDOG=1")


@contextlib.contextmanager
def _signals() -> Iterator[int]:
    """Turn SIGTERM and SIGINT into a readable descriptor."""
    reader, writer = socket.socketpair()
    with reader, writer:
        reader.setblocking(False)
        writer.setblocking(False)
        before = {s: signal.signal(s, lambda *_: None) for s in (signal.SIGTERM, signal.SIGINT)}
        old_fd = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
        try:
            yield reader.fileno()
        finally:
            signal.set_wakeup_fd(old_fd)
            for number, handler in before.items():
                signal.signal(number, handler)


def _notify(text: str) -> None:
    """Tell the supervisor, by systemd's sd_notify protocol; nothing happens without one."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        client.sendto(text.encode(), address)


def prepare_process() -> None:
    """Set up logging, and die with the supervisor when there is one: a killed parent must leave no orphans."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # while the bus waits for the hub, Ctrl-C must end it
    if os.environ.get("STARBOARD_SUPERVISED"):
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
        if os.getppid() == 1:
            sys.exit("the supervisor is gone")
