"""The processes of `starboard bench bus`: services of ours, the same over plain eclipse-zenoh, and over raw TCP.

`python -m benchmarks.bus_peers ROLE JSON`; those that measure print one JSON list and end.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from benchmarks.hub_pair import VESSEL
from bus.messages import CameraImage, Wrench
from bus.run import run
from bus.service import Input, Output, RawSample, Service
from bus.topics import HEARTBEAT, Qos, Topic
from bus.zenoh_bus import ZenohBus

PING = Topic("bench/ping", Wrench, "ping", "Round trip: there.", qos=Qos.COMMAND)
PONG = Topic("bench/pong", Wrench, "echo", "Round trip: back.", qos=Qos.COMMAND)
FLOOD = Topic("bench/flood", Wrench, "flood", "As fast as it goes, with back-pressure.", qos=Qos.REQUEST)
STREAM = Topic("bench/stream", Wrench, "stream", "At a steady rate.")
COMMAND = Topic("bench/command", Wrench, "stream", "At a steady rate, with high priority.", qos=Qos.COMMAND)
PICTURE = Topic("bench/picture", CameraImage, "pictures", "An image flood.", qos=Qos.IMAGE)
TOPICS = {t.key: t for t in (STREAM, COMMAND)}
WARM_UP = 50
SAY_AGAIN_S = 0.2
MESSAGE = Wrench(surge_n=1.2541836291054823, sway_n=-0.5072919451386754, yaw_nm=0.1258302916447193)
"""200 B on the wire."""


def finish(values: list[float]) -> None:
    """Print what was measured and end this process' loop."""
    print(json.dumps(values), flush=True)
    os.kill(os.getpid(), signal.SIGTERM)


class Echo(Service):
    """Send back what comes."""

    name = "echo"
    quick = True
    ping = Input(PING, wakes=True)
    pong = Output(PONG)

    def step(self, now_s: float) -> None:
        if self.ping.updated:
            self.pong.publish(MESSAGE)


class Ping(Service):
    """Round trips in us: at 50 Hz, or each after the other."""

    name = "ping"
    rate_hz = 50.0
    quick = True
    pong = Input(PONG, wakes=True)
    ping = Output(PING)

    def __init__(self, count: int, flat_out: bool) -> None:
        self._count, self._flat_out = count, flat_out
        self._sent_ns = 0
        self._trips: list[float] = []

    def step(self, now_s: float) -> None:
        if self.pong.updated and self._sent_ns:
            self._trips.append((time.perf_counter_ns() - self._sent_ns) * 1e-3)
            self._sent_ns = 0
            if len(self._trips) == self._count + WARM_UP:
                finish(self._trips[WARM_UP:])
            if not self._flat_out:
                return
        if not self._sent_ns or time.perf_counter_ns() - self._sent_ns > SAY_AGAIN_S * 1e9:
            self._sent_ns = time.perf_counter_ns()
            self.ping.publish(MESSAGE)


class Flood(Service):
    """Publish `count` messages as fast as they are taken, as soon as the reader is there."""

    name = "flood"
    rate_hz = 1000.0
    reader = Input(HEARTBEAT.of("drain"))
    flood = Output(FLOOD)

    def __init__(self, count: int) -> None:
        self._left = count

    def step(self, now_s: float) -> None:
        batch = min(2000, self._left) if self.reader.latest is not None else 0
        for _ in range(batch):
            self.flood.publish(MESSAGE)
        self._left -= batch


class Drain(Service):
    """Messages per second from the first to the last of a flood, and how many were lost."""

    name = "drain"
    flood = Input(FLOOD, wakes=True, queue=200_000)

    def __init__(self, count: int) -> None:
        self._count, self._got = count, 0
        self._begin_ns = 0

    def step(self, now_s: float) -> None:
        taken = self.flood.take()
        self._begin_ns = self._begin_ns or time.perf_counter_ns()
        self._got += len(taken)
        if taken and taken[-1].seq == self._count - 1:
            seconds = (time.perf_counter_ns() - self._begin_ns) * 1e-9
            finish([self._got / seconds, self._count - self._got])


class Stream(Service):
    """Publish on a topic at a steady rate."""

    name = "stream"

    def __init__(self, key: str, rate_hz: float) -> None:
        self.rate_hz = rate_hz  # type: ignore[misc]
        self._output = Output(TOPICS[key])

    @property
    def outputs(self) -> list[Output[Any]]:
        return [self._output]

    def step(self, now_s: float) -> None:
        self._output.publish(MESSAGE.model_copy(update={"stamp_ns": time.time_ns()}))


class Ways(Service):
    """One-way times in us of a stream, for so many messages."""

    name = "ways"

    def __init__(self, key: str, count: int) -> None:
        self._input = Input(TOPICS[key], wakes=True, queue=1000)
        self._count = count
        self._ways: list[float] = []

    @property
    def inputs(self) -> list[Input[Any]]:
        return [self._input]

    def step(self, now_s: float) -> None:
        now_ns = time.time_ns()
        self._ways += [(now_ns - message.stamp_ns) * 1e-3 for message in self._input.take()]
        if self._count and len(self._ways) >= self._count + WARM_UP:
            finish(self._ways[WARM_UP:])
            self._count = 0


class Pictures(Service):
    """An image flood."""

    name = "pictures"
    picture = Output(PICTURE)

    def __init__(self, rate_hz: float, size: int) -> None:
        self.rate_hz = rate_hz  # type: ignore[misc]
        self._image = CameraImage(frame=0, width_px=1, height_px=1, data=os.urandom(size))

    def step(self, now_s: float) -> None:
        self.picture.publish(self._image)


SERVICES: dict[str, Callable[..., Service]] = {
    "echo": Echo, "ping": Ping, "flood": Flood, "drain": Drain, "stream": Stream, "ways": Ways, "pictures": Pictures,
}  # fmt: skip


def sleeper(endpoints: list[str]) -> None:
    """Sleep 10 ms on each message, in the bus' own thread: the rudest reader there is."""

    def hear(_: RawSample) -> None:
        time.sleep(0.01)

    bus = ZenohBus.connect(VESSEL, tuple(endpoints))
    bus.subscribe("**", hear)
    threading.Event().wait()


# --- plain eclipse-zenoh, with its defaults ---------------------------------------------------------------------


def _zenoh(mode: str, endpoint: str) -> Any:
    import zenoh

    ends = {"listen" if mode == "router" else "connect": {"endpoints": [endpoint]}}
    return zenoh.open(
        zenoh.Config.from_json5(json.dumps({"mode": mode, "scouting": {"multicast": {"enabled": False}}} | ends))
    )


def zenoh_router(endpoint: str) -> None:
    """A router opened from Python, without anything else."""
    session = _zenoh("router", endpoint)
    threading.Event().wait()
    session.close()


def zenoh_echo(endpoint: str) -> None:
    """Send 8 bytes back."""
    session = _zenoh("client", endpoint)
    publisher = session.declare_publisher("bench/pong")
    subscriber = session.declare_subscriber("bench/ping", lambda sample: publisher.put(sample.payload))
    threading.Event().wait()
    subscriber.undeclare()


def zenoh_ping(endpoint: str, count: int, flat_out: bool) -> None:
    """Round trips of 8 bytes in us."""
    session = _zenoh("client", endpoint)
    publisher = session.declare_publisher("bench/ping")
    subscriber = session.declare_subscriber("bench/pong")
    publisher.put(b"12345678")
    while subscriber.try_recv() is None:
        time.sleep(0.05)
        publisher.put(b"12345678")
    time.sleep(0.3)
    while subscriber.try_recv() is not None:
        pass
    trips = []
    for _ in range(count + WARM_UP):
        if not flat_out:
            time.sleep(0.02)
        begin_ns = time.perf_counter_ns()
        publisher.put(b"12345678")
        subscriber.recv()
        trips.append((time.perf_counter_ns() - begin_ns) * 1e-3)
    print(json.dumps(trips[WARM_UP:]), flush=True)
    session.close()


def zenoh_flood(endpoint: str, count: int, as_bytes: bool) -> None:
    """Publish the same JSON `count` times, made anew each time as we do, or made once; then an empty payload."""
    import zenoh

    session = _zenoh("client", endpoint)
    publisher = session.declare_publisher("bench/flood", congestion_control=zenoh.CongestionControl.BLOCK)
    values = json.loads(MESSAGE.encode()) | {"stamp_ns": time.time_ns(), "source": "flood"}
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    payload = json.dumps(values, separators=(",", ":")).encode()
    for seq in range(count):
        if not as_bytes:
            values["seq"] = seq
            payload = json.dumps(values, separators=(",", ":")).encode()
        publisher.put(payload)
    publisher.put(b"")
    threading.Event().wait()


def zenoh_drain(endpoint: str, count: int, as_bytes: bool) -> None:
    """Messages per second, parsed or as they are."""
    session = _zenoh("client", endpoint)
    begin_ns = got = 0
    subscriber = session.declare_subscriber("bench/flood")  # lives as long as this name
    for sample in subscriber:
        begin_ns = begin_ns or time.perf_counter_ns()
        payload = sample.payload.to_bytes()
        if not payload:
            break
        if not as_bytes:
            json.loads(payload)
        got += 1
    seconds = (time.perf_counter_ns() - begin_ns) * 1e-9
    print(json.dumps([got / seconds, count - got]), flush=True)
    session.close()


# --- raw TCP ----------------------------------------------------------------------------------------------------


def _tcp(endpoint: str) -> socket.socket:
    host, _, port = endpoint.removeprefix("tcp/").partition(":")
    client = socket.create_connection((host, int(port)))
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client


def tcp_relay(endpoint: str) -> None:
    """Pass on what one of two clients sends to the other."""
    host, _, port = endpoint.removeprefix("tcp/").partition(":")
    with socket.create_server((host, int(port))) as server:
        first, second = server.accept()[0], server.accept()[0]
    with selectors.EpollSelector() as selector:
        for source, target in ((first, second), (second, first)):
            source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            selector.register(source, selectors.EVENT_READ, target)
        while True:
            for key, _ in selector.select():
                data = key.fileobj.recv(64)  # type: ignore[union-attr]
                if not data:
                    return
                key.data.sendall(data)


def tcp_echo(endpoint: str) -> None:
    """Send 8 bytes back."""
    client = _tcp(endpoint)
    while data := client.recv(64):
        client.sendall(data)


def tcp_ping(endpoint: str, count: int, flat_out: bool) -> None:
    """Round trips of 8 bytes in us."""
    client = _tcp(endpoint)
    trips = []
    for _ in range(count + WARM_UP):
        if not flat_out:
            time.sleep(0.02)
        begin_ns = time.perf_counter_ns()
        client.sendall(b"12345678")
        client.recv(64)
        trips.append((time.perf_counter_ns() - begin_ns) * 1e-3)
    print(json.dumps(trips[WARM_UP:]), flush=True)


PLAIN: dict[str, Callable[..., None]] = {
    f.__name__: f
    for f in (zenoh_router, zenoh_echo, zenoh_ping, zenoh_flood, zenoh_drain, tcp_relay, tcp_echo, tcp_ping, sleeper)
}


def main() -> None:
    """Run one role."""
    role, arguments = sys.argv[1], json.loads(sys.argv[2])
    if role in PLAIN:
        PLAIN[role](**arguments)
    else:
        endpoints = tuple(arguments.pop("endpoints"))
        run(SERVICES[role](**arguments), ZenohBus.connect(VESSEL, endpoints))


if __name__ == "__main__":
    main()
