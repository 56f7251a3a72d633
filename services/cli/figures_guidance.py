"""Figures of thesis 8.2 and 8.3: distance keeping with VideoRay, line following with Charlie, simulated."""

from __future__ import annotations

import functools
import math

import numpy as np

from benchmarks import distance_keeping as wall
from benchmarks import line_following as line
from marine.guidance.path import Line
from marine.vessel import DegreeOfFreedom
from services.cli.figure_parts import Figure
from services.cli.svg import Chart

_AHEAD = Line(0.0, 0.0, math.pi / 2.0)
"""gamma is 90 degrees: along y."""
_WEATHER = "Simulated in a cross wind of 20 N with gusts, GPS 0.5 m and compass 0.5 degrees at 2 Hz (chosen)."


@functools.cache
def _identified() -> tuple[DegreeOfFreedom, DegreeOfFreedom]:
    """Return (surge, yaw) of VideoRay by Algorithm 8.5 I to III."""
    yaw = wall.identified_yaw()
    return wall.identified_surge(yaw), yaw


@functools.cache
def _laws() -> dict[str, line.Direct | line.Indirect]:
    return line.laws(line.SLOW)


def reference_changes(_: None = None) -> Figure:
    """Fig. 8.16: ramp and step of the wanted distance."""
    log = wall.keep(wall.Wall(1), *_identified(), 100.0, wall.ramp_and_step)
    off = np.abs(np.array(log.true_m) - np.array(log.reference))
    caption = (
        "VideoRay on its tether follows a ramp and a step of the distance, gains by Algorithm 8.5 (none are printed). "
        f"Laser 2 Hz, 5 mm, every tenth sample lost. Largest error 20 s after each change: "
        f"{1e3 * max(off[550:600].max(), off[850:].max()):.0f} mm. Between samples the filter keeps the distance."
    )
    return Figure((_distances(log), _speeds(log)), caption)


def laser_absent(_: None = None) -> Figure:
    """Fig. 8.17: twice 5 s without measurements."""
    log = wall.keep(wall.Wall(2), *_identified(), 60.0, lambda _: 0.5, lambda t: 25.0 <= t < 30.0 or 45.0 <= t < 50.0)
    off = np.abs(np.array(log.true_m) - 0.5)
    caption = (
        "VideoRay on its tether; the laser's dots are lost from 25 to 30 s and from 45 to 50 s, as in the thesis. "
        f"Largest errors of the distance kept: {1e3 * off[250:300].max():.0f} and {1e3 * off[450:500].max():.0f} mm."
    )
    return Figure((_distances(log), _speeds(log)), caption)


def _distances(log: wall.Log) -> Chart:
    chart = Chart("VideoRay before a wall", "time, s", "distance, m")
    chart.line(log.t_s, log.reference, "reference")
    chart.line(log.t_s, log.true_m, "true")
    chart.line(log.t_s[5:], log.estimated_m[5:], "estimated")
    chart.points([t for t, _ in log.measured], [d for _, d in log.measured], "laser")
    return chart


def _speeds(log: wall.Log) -> Chart:
    chart = Chart("surge speed", "time, s", "u, m/s")
    chart.line(log.t_s[20:], log.u[20:], "estimated")
    chart.line(log.t_s[20:], log.u_true[20:], "true")
    return chart


def far_away(number: str) -> Figure:
    """Fig. 8.20 to 8.23: far from the line, both methods, without and with the limit of 8.3.3."""
    first, limited = number in ("8.20", "8.21"), number in ("8.21", "8.23")
    start_m = 75.0 if first else 70.0
    law: line.Direct | line.Indirect
    if first:
        law = line.Direct(line.SLOW, approach_rad=math.radians(45.0))
        if not limited:
            law.law.d_max_m = math.inf
    else:
        law = line.Indirect("I-PD", line.identified_loop("I-PD"), line.SLOW)
        if not limited:
            law.law.limit_rad = law.autopilot.turns_rad = math.inf
    boat = line.Boat(0, (start_m, 0.0, math.pi / 2.0), line.CALM)
    voyage = line.sail(boat, law, lambda _: _AHEAD, 250.0)
    turned = np.ptp(np.unwrap(voyage.psi)) / (2.0 * math.pi)
    d = np.abs(voyage.d_m)
    nearer = bool(np.all(np.diff(d[: int(np.argmax(d < 1.0)) or len(d)]) < 0.01))
    caption = (
        f"Method {1 if first else 2} {'with' if limited else 'without'} the limit of 8.3.3, from {start_m:g} m beside "
        f"the line, parallel to it, in a calm: the vessel turns by {turned:.1f} turns in all; its distance falls "
        f"{'all the way' if nearer else 'not all the way'}, and ends at {d[-1]:.2f} m."
    )
    return Figure(_voyage(voyage, _AHEAD), caption)


def u_turn(name: str) -> Figure:
    """Fig. 8.24 to 8.26: a U-turn by each law."""
    voyage = line.sail(line.Boat(1), _laws()[name], line.u_turn, 240.0)
    caption = (
        f"U-turn of Charlie by {name}, model function Bessel with 0.211 rad/s, approach angle 30 degrees: after 80 s "
        f"the line 25 m to starboard, back. RMS error after 110 s more: {voyage.rms(190.0):.2f} m. {_WEATHER}"
    )
    return Figure(_voyage(voyage, None), caption)


def rudder_activity(_: None = None) -> Figure:
    """Fig. 8.27: the rudder by two model functions."""
    boat, ahead = line.Boat(1), Line(0.0, 0.0, 0.0)
    line.sail(boat, line.Direct(line.FAST), lambda _: ahead, 60.0)
    parts = [line.sail(boat, line.Direct(w0), lambda _: ahead, 30.0) for w0 in (line.FAST, line.SLOW)]
    angles = [math.degrees(angle) for part in parts for angle in part.rudder]
    chart = Chart("faster model function until 30 s, then the slower", "time, s", "rudder, degrees")
    chart.line([k * line.STEP_S for k in range(len(angles))], angles)
    caption = (
        f"Rudder of Charlie on a line, model function Bessel with 0.5, after 30 s with 0.211 rad/s. Its activity (mean "
        f"size of its rate) falls by {100.0 * line.rudder_falls():.0f} % over 200 s of each. {_WEATHER}"
    )
    return Figure((chart,), caption)


def _voyage(voyage: line.Voyage, ahead: Line | None) -> tuple[Chart, ...]:
    track = Chart("path", "y, m", "x, m")
    if ahead is not None:
        track.line([min(voyage.y_m), max(voyage.y_m)], [0.0, 0.0], "line")
    track.line(voyage.y_m, voyage.x_m, "vessel")
    heading, rudder = Chart("heading", "time, s", "psi, degrees"), Chart("rudder", "time, s", "delta, degrees")
    heading.line(voyage.t_s, np.degrees(np.unwrap(voyage.psi)).tolist())
    rudder.line(voyage.t_s, np.degrees(voyage.rudder).tolist())
    return track, heading, rudder
