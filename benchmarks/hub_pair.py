"""Hub and standby as real processes without the rest of the star, and a stream of messages through them."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

from benchmarks.running_star import ROOT, free_port, secure, wait_for
from bus.messages import AttainedWrench, HubStatistics
from bus.security import Secured, client_settings
from bus.service import RawSample
from bus.topics import ACTUATOR_ATTAINED, HUB_STATISTICS
from bus.zenoh_bus import HubUnreachableError, ZenohBus

VESSEL = "pladypos"
STREAM_HZ = 100.0


class HubPair:
    """One hub, with `standby=True` two, in a run directory of their own; `secured`: with TLS, passwords and rules."""

    def __init__(self, *, standby: bool = True, secured: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="sb-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None)
        self.folder = Path(self._folder.name)
        self.hub, self.standby = (f"{'tls' if secured else 'tcp'}/127.0.0.1:{free_port()}" for _ in range(2))
        self.endpoints = (self.hub, self.standby) if standby else (self.hub,)
        config = self.folder / "config.toml"
        config.write_text(
            f'[hub]\nlisten = ["{self.hub}"]\nstandby = "{self.standby if standby else ""}"\n'
            + (f'security = "{self.folder}/keys"\n' if secured else "")
        )
        self._keys = secure(config) if secured else None
        self.names = ("hub", "hub_standby") if standby else ("hub",)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._clients: list[ZenohBus] = []

    def __enter__(self) -> Self:
        try:
            for name in self.names:
                self.start(name)
            for name in self.names:
                self.wait_until_up(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for client in self._clients:
            client.close()
        for process in self.processes.values():
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in self.processes.values():
            process.wait(10.0)
        self._folder.cleanup()

    def start(self, name: str) -> None:
        """Start a hub (again)."""
        with (self.folder / f"{name}.txt").open("ab") as out:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", "services.cli.main", "run", name, "--config", f"{self.folder}/config.toml"],
                cwd=ROOT, env=os.environ | {"STARBOARD_RUN_DIR": f"{self.folder}/run"},
                stdout=out, stderr=subprocess.STDOUT,
            )  # fmt: skip

    def wait_until_up(self, name: str) -> None:
        """Wait until a hub answers for all keys, and with a standby, is linked."""
        address = self.endpoints[self.names.index(name)]

        def up() -> bool:
            assert self.processes[name].poll() is None, (self.folder / f"{name}.txt").read_text()
            try:
                bus = ZenohBus.connect(VESSEL, (address,), 0.5, self.secured_as("operator"))
            except HubUnreachableError:
                return False
            with contextlib.closing(bus):
                statistics = self.statistics(bus)
                return statistics is not None and (statistics.linked or len(self.names) == 1)

        wait_for(up, 20.0, f"{name} is up")

    def statistics(self, bus: ZenohBus) -> HubStatistics | None:
        """Return the newest hub/statistics if it is no older than 1.5 s."""
        for value in bus.last_values(HUB_STATISTICS.key):
            if value.payload and time.time_ns() - value.received_ns < 1.5e9:
                return HubStatistics.decode(value.payload)
        return None

    def secured_as(self, user: str) -> Secured | None:
        """Return the settings of a user, None where the hubs ask for no password."""
        return client_settings(self._keys, user) if self._keys else None

    def client(self, user: str = "operator") -> ZenohBus:
        """Return a client that knows both hubs; it leaves with this object."""
        self._clients.append(ZenohBus.connect(VESSEL, self.endpoints, 10.0, self.secured_as(user)))
        return self._clients[-1]

    def kill(self, name: str) -> None:
        """SIGKILL."""
        self.processes[name].kill()
        self.processes[name].wait()


class Arrival(NamedTuple):
    """One message of a stream."""

    at_s: float
    seq: int


class Stream:
    """Typed messages at a steady rate from one client to another."""

    def __init__(self, sender: ZenohBus, receiver: ZenohBus, rate_hz: float = STREAM_HZ) -> None:
        self.arrivals: list[Arrival] = []
        self._sender = sender
        self._period_s = 1.0 / rate_hz
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._send)
        receiver.subscribe(ACTUATOR_ATTAINED.key, self._hear)

    def __enter__(self) -> Self:
        self._thread.start()
        wait_for(lambda: len(self.arrivals) > 20, 5.0, "the stream flows")
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _send(self) -> None:
        begin_s = time.monotonic()
        for seq in itertools.count():
            if self._over.wait(max(0.0, begin_s + seq * self._period_s - time.monotonic())):
                return
            message = AttainedWrench(stamp_ns=time.time_ns(), seq=seq, source="allocator", surge_n=1.0)
            self._sender.publish(ACTUATOR_ATTAINED, message)

    def _hear(self, sample: RawSample) -> None:
        self.arrivals.append(Arrival(time.monotonic(), AttainedWrench.decode(sample.payload).seq))

    def wait_for_flow(self, seconds: float, timeout_s: float = 10.0) -> None:
        """Wait until messages have come without a pause over 50 ms for so long, from now on."""
        begin_s = time.monotonic()

        def flows() -> bool:
            since_s = time.monotonic() - seconds
            if since_s < begin_s:
                return False
            recent = [since_s, *(a.at_s for a in list(self.arrivals) if a.at_s > since_s), time.monotonic()]
            return max(b - a for a, b in itertools.pairwise(recent)) < 0.05

        wait_for(flows, timeout_s, "the stream flows again")

    def gap_since(self, begin_s: float) -> tuple[float, int]:
        """Return the longest time between two messages in s and how many were lost, since a monotonic time."""
        first = next((i for i, a in enumerate(self.arrivals) if a.at_s >= begin_s), len(self.arrivals))
        arrivals = self.arrivals[max(first - 1, 0) :]
        pairs = list(itertools.pairwise(arrivals))
        return max(b.at_s - a.at_s for a, b in pairs), sum(max(b.seq - a.seq - 1, 0) for a, b in pairs)


def kill_trials(count: int, signal_number: int = signal.SIGKILL) -> Iterator[tuple[float, int]]:
    """Yield gap in s and messages lost of a 100 Hz stream for each time the hub in use is killed or stopped."""
    with HubPair() as pair, Stream(pair.client(), pair.client()) as stream:
        for trial in range(count):
            victim = pair.names[trial % 2]  # the one that clients use: they do not move back
            stream.wait_for_flow(0.3)
            begin_s = time.monotonic()
            pair.processes[victim].send_signal(signal_number)
            stream.wait_for_flow(0.3)
            yield stream.gap_since(begin_s)
            pair.kill(victim)
            pair.start(victim)
            pair.wait_until_up(victim)
