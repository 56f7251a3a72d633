"""What a recording says of the paths that were followed: `python -m benchmarks.paths RECORDING [PLOT.svg]`.

For each path or line of helm/state: how far the true vessel (of a simulation; else the estimated one) was from it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bus import topics
from bus.messages import HelmState
from logs.reader import Recording
from marine.guidance.abilities import course_of
from marine.guidance.course import Course
from services.cli.svg import Chart, write


@dataclass
class Followed:
    """One request: its course, and the vessel's places between the path's beginning and the end of the mode."""

    name: str
    course: Course
    request_id: str
    begin_s: float = 0.0
    end_s: float = 0.0
    places: list[tuple[float, float, float]] = field(default_factory=list)

    def distances(self) -> list[float]:
        """Return the distance from the path at each place, m."""
        return [float(np.hypot(*(self.course.places - place[1:]).T).min()) for place in self.places]


def followed(recording: Recording) -> list[Followed]:
    """Return what was followed, in order."""
    found: dict[str, Followed] = {}
    for entry in recording.messages(topics.HELM_STATE):
        state = entry.message
        assert isinstance(state, HelmState)
        if not state.points:
            continue
        points = [(p.x_m, p.y_m) for p in state.points]
        name = f"{'spline' if state.smooth else state.mode}, {state.speed_m_s or 0.0:.2f} m/s"
        one = found.setdefault(state.request_id, Followed(name, course_of(points, state.smooth), state.request_id))
        one.end_s = state.stamp_ns * 1e-9
    for entry in recording.messages(topics.CONTROL_STATUS):
        told = entry.message
        if told.request_id in found and (told.along_m or 0.0) > 0.0 and not found[told.request_id].begin_s:
            found[told.request_id].begin_s = told.stamp_ns * 1e-9
    key = topics.SIMULATION_TRUTH if topics.SIMULATION_TRUTH.key in recording.topics else topics.NAVIGATION_STATE
    for entry in recording.messages(key):
        at_s = entry.message.stamp_ns * 1e-9
        for one in found.values():
            if 0.0 < one.begin_s <= at_s <= one.end_s:
                one.places.append((at_s, entry.message.x_m, entry.message.y_m))
    return [one for one in found.values() if one.places]


def main(recording: Path, plot: Path | None) -> None:
    """Print the distances; draw tracks and distances."""
    track, off = Chart("Track", "x, m", "y, m"), Chart("Distance from the path", "t, s", "mm")
    for one in followed(Recording(recording)):
        d = one.distances()
        rms = 1e3 * float(np.sqrt(np.mean(np.square(d))))
        print(f"{one.name}: {one.course.length_m:.2f} m in {one.end_s - one.begin_s:.1f} s, RMS {rms:.1f} mm, "
              f"largest {1e3 * max(d):.0f} mm")  # fmt: skip
        x, y = one.course.places.T[:, ::10].tolist()
        track.line(x, y)
        track.line([x for _, x, _ in one.places[::5]], [y for _, _, y in one.places[::5]], one.name)
        off.line([t - one.begin_s for t, _, _ in one.places[::5]], [1e3 * value for value in d[::5]], one.name)
    if plot:
        write(plot, [track, off])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
