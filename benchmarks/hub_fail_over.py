"""What a holding vessel notices when the hub is killed, then its standby held: read from the recording, drawn as SVG.

`python -m benchmarks.hub_fail_over docs/hub-fail-over.svg` draws the picture of docs/hub.md.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.running_star import RunningStar, wait_for
from bus import topics
from logs.reader import Recording

PLACE = (1.5, 1.2, 0.5)
CALM_S = 6.0
AFTER_S = 6.0
WIDTH, HEIGHT, LEFT, GAP = 760, 150, 60, 40


class FailOver(NamedTuple):
    """Times in s since the first; errors in mm; the times between commands in ms, at the time of the later one."""

    error: NDArray[np.float64]
    intervals: NDArray[np.float64]
    killed_s: float
    held_s: float

    def largest_error_mm(self, begin_s: float, end_s: float) -> float:
        """Return the largest true position error within a span of time."""
        within = (self.error[0] >= begin_s) & (self.error[0] < end_s)
        return float(self.error[1][within].max())

    def longest_interval_ms(self, begin_s: float, end_s: float) -> float:
        """Return the longest time without an actuator command."""
        within = (self.intervals[0] >= begin_s) & (self.intervals[0] < end_s)
        return float(self.intervals[1][within].max())


def run() -> FailOver:
    """Hold; SIGKILL the hub; SIGSTOP the standby that took its place; return what the recording says."""
    with RunningStar("[simulator]\ncurrent_x_m_s = 0.05\n") as star:
        star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 30.0, "a pose")
        star.hold(*PLACE)

        away_s = time.monotonic()

        def settled() -> bool:
            nonlocal away_s
            truth = star.last(topics.SIMULATION_TRUTH)
            if truth is None or math.hypot(truth.x_m - PLACE[0], truth.y_m - PLACE[1]) > 0.005:
                away_s = time.monotonic()
            return time.monotonic() - away_s > CALM_S

        wait_for(settled, 60.0, "the vessel is there")
        killed_s = time.time()
        os.kill(star.pid("hub"), signal.SIGKILL)
        time.sleep(AFTER_S)
        held_s = time.time()
        os.kill(star.pid("hub_standby"), signal.SIGSTOP)  # the supervisor kills it 3 s later
        time.sleep(AFTER_S)
        star.interrupt()
        (path,) = star.recordings.glob("*.mcap")
        return _read(Recording(path), killed_s, held_s)


def _read(recording: Recording, killed_s: float, held_s: float) -> FailOver:
    begin_s = killed_s - CALM_S
    truth = [(e.publish_ns * 1e-9, e.message) for e in recording.messages(topics.SIMULATION_TRUTH)]
    error = [(t - begin_s, 1e3 * math.hypot(m.x_m - PLACE[0], m.y_m - PLACE[1])) for t, m in truth if t >= begin_s]
    times = np.array([e.publish_ns * 1e-9 for e in recording.messages(topics.ACTUATOR_COMMAND)])
    intervals = np.array([times[1:] - begin_s, 1e3 * np.diff(times)])
    return FailOver(np.array(error).T, intervals[:, times[1:] >= begin_s], CALM_S, held_s - begin_s)


def draw(result: FailOver) -> str:
    """Return the picture as SVG."""
    panels = [("true position error, mm", result.error), ("time between recorded commands, ms", result.intervals)]
    end_s = result.held_s + AFTER_S
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH + LEFT + 20}" height="{2 * (HEIGHT + GAP) + 20}" '
        'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>'
    ]
    for number, (title, (times, values)) in enumerate(panels):
        top, most = number * (HEIGHT + GAP) + 25, float(values.max()) * 1.1
        points = " ".join(
            f"{LEFT + WIDTH * t / end_s:.1f},{top + HEIGHT * (1 - v / most):.1f}"
            for t, v in zip(times, values, strict=True)
            if t <= end_s
        )
        parts.append(f'<text x="{LEFT}" y="{top - 8}">{title}</text>')
        parts += [
            f'<text x="{LEFT - 8}" y="{top + HEIGHT * (1 - v / most) + 4:.1f}" text-anchor="end">{v:.3g}</text>'
            for v in (0.0, float(values.max()))
        ]
        parts.append(f'<rect x="{LEFT}" y="{top}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#999"/>')
        parts.append(f'<polyline points="{points}" fill="none" stroke="#0a58a6"/>')
        for at_s, what in ((result.killed_s, "hub: SIGKILL"), (result.held_s, "standby: SIGSTOP")):
            x = LEFT + WIDTH * at_s / end_s
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{top + HEIGHT}" stroke="#b00020"/>')
            parts.append(f'<text x="{x + 4:.1f}" y="{top + 14}" fill="#b00020">{what}</text>')
    parts.append(f'<text x="{LEFT + WIDTH}" y="{2 * (HEIGHT + GAP) + 5}" text-anchor="end">{end_s:.0f} s</text></svg>')
    return "\n".join(parts) + "\n"


def main() -> None:
    """Draw the picture and print its figures."""
    result = run()
    Path(sys.argv[1]).write_text(draw(result))
    end_s = result.held_s + AFTER_S
    for what, begin, end in (
        ("steady", 0.0, result.killed_s), ("hub killed", result.killed_s, result.held_s),
        ("standby held", result.held_s, end_s),
    ):  # fmt: skip
        error, interval = result.largest_error_mm(begin, end), result.longest_interval_ms(begin, end)
        print(f"{what:<13} largest error {error:.2f} mm, longest time without a command {interval:.0f} ms")


if __name__ == "__main__":
    main()
