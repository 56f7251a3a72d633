"""The bus in figures; in the same run its floor, a TCP relay, and plain eclipse-zenoh through a Python router."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import psutil

from benchmarks.hub_pair import HubPair, kill_trials
from benchmarks.result import NotMeasured, Result, percentile
from benchmarks.running_star import ROOT, free_port, wait_for

TRIPS = {"50hz": (100, False), "flat_out": (2000, True)}
ROUNDS = 3
FLOOD = 50_000
READERS = 10
STALLED_S = 60.0
KILLS = 20
MIB = 2**20


class Crew:
    """Processes of `benchmarks.bus_peers`, ended with this object."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[str]] = []
        self._roles: dict[int, str] = {}

    def start(self, role: str, **arguments: Any) -> subprocess.Popen[str]:
        """Start one and return it."""
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.bus_peers", role, json.dumps(arguments)],
            cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self._running.append(process)
        self._roles[process.pid] = role
        return process

    def values(self, process: subprocess.Popen[str], timeout_s: float = 60.0) -> list[float]:
        """Return what a measuring process prints; raise NotMeasured when it does not."""
        try:
            line, _ = process.communicate(timeout=timeout_s)
            values: list[float] = json.loads(line)
        except (subprocess.TimeoutExpired, ValueError):
            raise NotMeasured(f"{self._roles[process.pid]} gave no figures") from None
        return values

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            process.kill()
            process.wait()
            if process.stdout:
                process.stdout.close()


@contextlib.contextmanager
def plain_router(crew: Crew, role: str = "zenoh_router") -> Iterator[str]:
    """Start a router (or relay) of the peers and yield its address."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = crew.start(role, endpoint=endpoint)
    _wait_listening(router)
    yield endpoint


def _wait_listening(process: subprocess.Popen[str]) -> None:
    def listens() -> bool:
        return any(c.status == psutil.CONN_LISTEN for c in psutil.Process(process.pid).net_connections("tcp"))

    wait_for(listens, 20.0, "the peers' router")


def round_trips() -> list[Result]:
    """Median and 99th percentile of a round trip through the centre; who is measured alternates, against the noise."""
    results = []
    for name, (count, flat_out) in TRIPS.items():
        measured: dict[str, list[float]] = {"starboard": [], "zenoh_python": [], "tcp_relay": []}
        for _ in range(ROUNDS):
            measured["starboard"] += _our_trips(count, flat_out)
            measured["zenoh_python"] += _peers_trips("zenoh_router", "zenoh", count, flat_out)
            measured["tcp_relay"] += _peers_trips("tcp_relay", "tcp", count, flat_out)
        for p in (50, 99):
            figures = {who: percentile(trips, p) for who, trips in measured.items()}
            value = figures.pop("starboard")
            goal = 1.3 * figures["zenoh_python"] if p == 50 else None
            results.append(Result(f"hub_round_trip_{name}_p{p}_us", value, figures, goal))
    return results


def _our_trips(count: int, flat_out: bool) -> list[float]:
    with HubPair(standby=False) as hub, Crew() as crew:
        crew.start("echo", endpoints=hub.endpoints)
        return crew.values(crew.start("ping", endpoints=hub.endpoints, count=count, flat_out=flat_out))


def _peers_trips(centre: str, prefix: str, count: int, flat_out: bool) -> list[float]:
    with Crew() as crew, plain_router(crew, centre) as endpoint:
        crew.start(f"{prefix}_echo", endpoint=endpoint)
        return crew.values(crew.start(f"{prefix}_ping", endpoint=endpoint, count=count, flat_out=flat_out))


def throughput() -> list[Result]:
    """Typed messages of 200 B to one reader, with back-pressure and the hub's store.

    The peer makes and parses the same JSON for each message, as we do (its router keeps nothing); for comparison, what
    it passes on when the bytes are made once and never looked at.
    """
    rates: dict[str, list[float]] = {"starboard": [], "zenoh_python": [], "zenoh_python_bytes_only": []}
    lost = dict.fromkeys(rates, 0.0)
    for _ in range(ROUNDS):
        for who, (rate, missing) in {
            "starboard": _our_flood(),
            "zenoh_python": _peers_flood(as_bytes=False),
            "zenoh_python_bytes_only": _peers_flood(as_bytes=True),
        }.items():
            rates[who].append(rate)
            lost[who] += missing
    figures = {who: percentile(rate, 50) for who, rate in rates.items()}
    value, our_lost = figures.pop("starboard"), lost.pop("starboard")
    return [
        Result("throughput_200b_hz", value, figures, 0.7 * figures["zenoh_python"]),
        Result("throughput_lost_messages", our_lost, lost, 0.0),
    ]


def _our_flood() -> list[float]:
    with HubPair(standby=False) as hub, Crew() as crew:
        drain = crew.start("drain", endpoints=hub.endpoints, count=FLOOD)
        crew.start("flood", endpoints=hub.endpoints, count=FLOOD)
        return crew.values(drain)


def _peers_flood(*, as_bytes: bool) -> list[float]:
    with Crew() as crew, plain_router(crew) as endpoint:
        drain = crew.start("zenoh_drain", endpoint=endpoint, count=FLOOD, as_bytes=as_bytes)
        crew.start("zenoh_flood", endpoint=endpoint, count=FLOOD, as_bytes=as_bytes)
        return crew.values(drain)


def fan_out() -> list[Result]:
    """One publisher at 100 Hz to ten processes."""
    with HubPair(standby=False) as hub, Crew() as crew:
        readers = [crew.start("ways", endpoints=hub.endpoints, key="bench/stream", count=1000) for _ in range(READERS)]
        centre = psutil.Process(hub.processes["hub"].pid)
        watching = hub.client()
        wait_for(lambda: (s := hub.statistics(watching)) and s.clients > READERS, 60.0, "all readers are there")
        time.sleep(1.0)  # they have finished starting
        crew.start("stream", endpoints=hub.endpoints, key="bench/stream", rate_hz=100.0)
        time.sleep(2.0)
        before_s, begin_s = sum(centre.cpu_times()[:2]), time.monotonic()
        time.sleep(5.0)
        busy = (sum(centre.cpu_times()[:2]) - before_s) / (time.monotonic() - begin_s)
        ways = [way for reader in readers for way in crew.values(reader)]
    return [
        Result("fan_out_10_p99_ms", percentile(ways, 99) * 1e-3, {"p50_ms": percentile(ways, 50) * 1e-3}, 5.0),
        Result("fan_out_10_hub_cpu_percent", 100.0 * busy, goal=8.0),
    ]


def stalled(seconds: float = STALLED_S) -> Result:
    """Growth of the hub's memory while a reader is held, at 1000 messages a second."""
    with HubPair(standby=False) as hub, Crew() as crew:
        reader = crew.start("ways", endpoints=hub.endpoints, key="bench/stream", count=0)
        crew.start("stream", endpoints=hub.endpoints, key="bench/stream", rate_hz=1000.0)
        centre = psutil.Process(hub.processes["hub"].pid)
        time.sleep(3.0)
        before = centre.memory_info().rss
        reader.send_signal(signal.SIGSTOP)
        end_s, most = time.monotonic() + seconds, before
        while time.monotonic() < end_s:
            time.sleep(0.5)
            most = max(most, centre.memory_info().rss)
    return Result("hub_memory_stalled_reader_growth_mb", (most - before) / MIB, goal=25.0)


def commands_under_flood(count: int = 1000) -> list[Result]:
    """A command's way beside 20 MB/s of images, with a reader that sleeps 10 ms on each message."""
    with HubPair(standby=False) as hub, Crew() as crew:
        crew.start("stream", endpoints=hub.endpoints, key="bench/command", rate_hz=100.0)
        quiet = crew.values(crew.start("ways", endpoints=hub.endpoints, key="bench/command", count=count))
        crew.start("sleeper", endpoints=hub.endpoints)
        crew.start("pictures", endpoints=hub.endpoints, rate_hz=200.0, size=100_000)
        time.sleep(2.0)  # the flood flows
        ways = crew.values(crew.start("ways", endpoints=hub.endpoints, key="bench/command", count=count))
    return [
        Result(f"command_under_flood_p{p}_ms", percentile(ways, p) * 1e-3, {"quiet": percentile(quiet, p) * 1e-3}, goal)
        for p, goal in ((50, None), (99, 10.0))
    ]


def fail_over() -> list[Result]:
    """A stream of 100 Hz while the hub in use is killed, 20 times, and held, 4 times."""
    killed = list(kill_trials(KILLS))
    held = list(kill_trials(4, signal.SIGSTOP))
    gaps_ms = [1e3 * gap for gap, _ in killed]
    return [
        Result("hub_killed_gap_max_ms", max(gaps_ms), {"p50_ms": percentile(gaps_ms, 50)}, 100.0),
        Result("hub_killed_lost_max_messages", max(lost for _, lost in killed), goal=3.0),
        Result("hub_held_gap_max_ms", max(1e3 * gap for gap, _ in held), goal=1000.0),
    ]


def measure() -> list[Result]:
    """Return all figures; takes about four minutes."""
    return [*round_trips(), *throughput(), *fan_out(), *commands_under_flood(), *fail_over(), stalled()]
