"""From a frame's capture to the command bytes at the far end of the pseudo-terminal: whole chain, real bus.

The star runs as real processes; only the simulator is replaced by itself with an ear on its port. A command frame on
the wire carries its time of sending, `actuator/command` on the bus the capture time of the picture it comes from: the
first frame sent after a command was decided is that command's.
"""

from __future__ import annotations

import json
import time
from bisect import bisect_left
from collections.abc import Callable

from benchmarks.result import NotMeasured, Result, percentile
from benchmarks.running_star import RunningStar, wait_for
from bus.messages import ActuatorCommand
from bus.service import RawSample
from bus.topics import ACTUATOR_COMMAND, HELM_STATE
from camera_tracker.sources import FrameWriter, Image
from platform_link.drivers import Driver
from platform_link.protocol import Command, Decoder
from services.simulator.service import Simulator

SECONDS = 15.0
MINIMUM = 100
LISTENING = 'simulation = true\nservices = { simulator = "benchmarks.chain:ListeningSimulator" }'
_WRAP_US = 1 << 32


class _Ear:
    """The simulator's end of the port; notes when each command frame arrived."""

    def __init__(self, port: Driver) -> None:
        self._port = port
        self._decoder = Decoder()
        self.arrivals: list[tuple[int, int]] = []
        """(time of sending in us modulo 2^32, arrival in ns)"""
        self.write, self.fileno, self.close = port.write, port.fileno, port.close

    def read(self) -> bytes:
        """Return what has come, and note it."""
        data = self._port.read()
        now_ns = time.time_ns()
        self.arrivals += [(m.time_us, now_ns) for m in self._decoder.feed(data) if isinstance(m, Command)]
        return data


class ListeningSimulator(Simulator):
    """Simulate vessel, pool, camera and platform, and write down when commands arrive."""

    def start(self, now_s: float) -> None:
        """Put the ear on the port and a watch on the pictures' way out."""
        super().start(now_s)
        self._ear = _Ear(self._port)
        self._port = self._ear
        self._handed_over: list[tuple[int, int]] = []
        assert self._frames is not None
        self._frames.write = self._watched(self._frames)  # type: ignore[method-assign, assignment]

    def _watched(self, frames: FrameWriter) -> Callable[[Image, int], int]:
        write = frames.write

        def watched(image: Image, stamp_ns: int) -> int:
            self._handed_over.append((stamp_ns, time.time_ns()))
            return write(image, stamp_ns)

        return watched

    def stop(self, now_s: float) -> None:
        """Write everything down beside the run directory."""
        super().stop(now_s)
        notes = {"arrivals": self._ear.arrivals, "handed_over": self._handed_over}
        (self._run_dir.parent / "notes.json").write_text(json.dumps(notes))


def measure(seconds: float = SECONDS, sections: str = "", system: str = LISTENING) -> list[Result]:
    """Return median and 99th percentile, from the picture's stamp and from its handing over to the tracker."""
    with RunningStar(sections=sections, system=system) as star:
        commands = _listen(star, seconds)
        star.interrupt()
        notes = json.loads((star.folder / "notes.json").read_text())
    handed_over = dict(notes["handed_over"])
    from_stamp, from_handover = [], []
    for origin_ns, arrived_ns in _matched(commands, notes["arrivals"]):
        from_stamp.append((arrived_ns - origin_ns) * 1e-6)
        if origin_ns in handed_over:
            from_handover.append((arrived_ns - handed_over[origin_ns]) * 1e-6)
    if len(from_stamp) < MINIMUM:
        raise NotMeasured(f"only {len(from_stamp)} commands could be followed from a picture to the platform")
    return [
        Result("capture_to_command_p50_ms", percentile(from_stamp, 50), goal=8.0),
        Result("capture_to_command_p99_ms", percentile(from_stamp, 99), goal=25.0),
        Result("handover_to_command_p50_ms", percentile(from_handover, 50)),
        Result("handover_to_command_p99_ms", percentile(from_handover, 99)),
        Result("commands_followed", len(from_stamp)),
    ]


def _listen(star: RunningStar, seconds: float) -> list[tuple[int, int]]:
    """Return (decided, capture) in ns of the first command of each picture, while the vessel holds."""
    heard: list[ActuatorCommand] = []

    def hear(sample: RawSample) -> None:
        heard.append(ActuatorCommand.decode(sample.payload))

    try:
        star.hold(2.5, 1.9, 0.0)
        star.wait(HELM_STATE, lambda s: s.mode == "hold" and not s.suspended, 5.0, "holding")
    except TimeoutError as error:
        raise NotMeasured(f"the vessel does not hold: {str(error).splitlines()[0]}") from None
    star.bus.subscribe(ACTUATOR_COMMAND.key, hear)
    end_s = time.monotonic() + seconds
    wait_for(lambda: time.monotonic() > end_s, seconds + 1.0, "the measurement")
    first: dict[int, int] = {}
    for command in heard:
        if command.origin_ns is not None:
            first.setdefault(command.origin_ns, command.stamp_ns)
    return sorted((decided_ns, origin_ns) for origin_ns, decided_ns in first.items())


def _matched(commands: list[tuple[int, int]], arrivals: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return (capture, arrival) in ns of each command whose bytes arrived within 0.2 s."""
    sent_ns = [_unwrapped(time_us, arrived_ns) for time_us, arrived_ns in arrivals]
    matched = []
    for decided_ns, origin_ns in commands:
        at = bisect_left(sent_ns, decided_ns)
        if at < len(arrivals) and arrivals[at][1] - decided_ns < 200_000_000:
            matched.append((origin_ns, arrivals[at][1]))
    return matched


def _unwrapped(time_us: int, arrived_ns: int) -> int:
    """Return a time of sending in ns, from its lowest 32 bits in us and the arrival shortly after."""
    return arrived_ns - ((arrived_ns // 1000 - time_us) % _WRAP_US) * 1000
