"""The figures of thesis chapter 8 from recordings of the star: what was wanted, what was, and what a caption says."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.chapter_8.runs import UNDER_WAY_M_S
from bus import topics
from bus.clock import NS
from logs.reader import Recording
from marine.allocation import axis_limits
from marine.control.model_function import bessel
from marine.control.single_loop import LimitedLoop
from marine.control.structures import STRUCTURES, design
from services.cli.figure_parts import Figure
from services.cli.svg import Chart
from services.vessels import load_vessel

Array = NDArray[np.float64]
MOST_POINTS = 400
WEATHER = "wind of 20 N across with gusts, position 0.5 m, compass 0.5 degrees at 2 Hz."
STEADY_S = 40.0
"""Of a line, at its end."""
BOW_M = load_vessel("videoray").radius_m
"""VideoRay's lasers sit at its bow; its wall is that at x = 0."""


@dataclass(frozen=True)
class Drawing:
    """Which runs a figure needs, and what draws it from their recordings."""

    title: str
    draw: Callable[..., Figure]
    runs: tuple[str, ...] = ()


class Log:
    """A recording, in seconds since the first request that the helm took."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.vessel = load_vessel(recording.vessel)
        helm = [e.message for e in recording.messages(topics.HELM_STATE) if e.message.request_id]
        self.begin_ns = helm[0].stamp_ns
        self.requests = {state.request_id: (state.stamp_ns - self.begin_ns) / NS for state in reversed(helm)}
        """When each request began, by its id, the last first."""
        self.helm = helm

    def begun(self, number: int) -> float:
        """Return when the request of this number began, s."""
        times: list[float] = sorted(self.requests.values())
        return times[number]

    def series(self, topic: topics.Topic[Any], *fields: str) -> tuple[Array, ...]:
        """Return times in s and fields, from the first request on; where a field is missing it is NaN."""
        found = self.recording.series(topic, "stamp_ns", *fields)
        t = (found["stamp_ns"].astype(float) - self.begin_ns) / NS
        columns = (np.array(found[name], dtype=float) for name in fields)
        return (t[t >= 0.0], *(column[t >= 0.0] for column in columns))

    def truth(self, *fields: str) -> tuple[Array, ...]:
        """Return times and fields of the true state."""
        return self.series(topics.SIMULATION_TRUTH, *fields)

    def wanted(self, field: str) -> tuple[Array, Array]:
        """Return times and values of a reference of the helm."""
        pairs = [((s.stamp_ns - self.begin_ns) / NS, getattr(s, field)) for s in self.helm]
        kept = [(t, v) for t, v in pairs if v is not None]
        return np.array([t for t, _ in kept]), np.array([v for _, v in kept])


def line(chart: Chart, t: Array, values: NDArray[Any], label: str = "", most: int = MOST_POINTS) -> None:
    """Draw a line of at most so many points."""
    every = max(1, math.ceil(len(t) / most))
    chart.line(np.round(t[::every], 3).tolist(), np.round(values[::every], 4).tolist(), label)


def against_model(  # noqa: PLR0917
    log: Log, request: int, field: str, w0: float, scale: float, unit: str, speed: str, tau: tuple[Any, str, str]
) -> tuple[tuple[Chart, ...], Array, Array, Array]:
    """Return charts of a step, its time and size from 0 to 1, and that of the model function."""
    t, eta, nu = log.truth(field, speed)
    begin = log.begun(request)
    t_end = t[-1] - 0.5
    here = (t >= begin) & (t <= t_end)
    t, eta, nu = t[here] - begin, eta[here], nu[here]
    wanted = log.wanted(field)[1]
    moved = (eta - eta[0]) / (wanted[-1] - eta[0])
    grid = np.linspace(0.0, float(t[-1]), len(t))
    model = np.interp(t, grid, signal.step(([1.0], [*bessel(3, w0)[::-1], 1.0]), T=grid)[1])
    place = Chart("recorded and designed", "t, s", unit)
    line(place, t, scale * (eta[0] + model * (wanted[-1] - eta[0])), f"model function, w0 = {w0:g}")
    line(place, t, scale * eta, "recorded")
    rate = Chart("speed", "t, s", f"{unit}/s")
    line(rate, t, scale * nu, "recorded")
    topic, name, label = tau
    at, action = log.series(topic, name)
    force = Chart("actuators", "t, s", label)
    line(force, at[at >= begin] - begin, action[at >= begin], "attained")
    return (place, rate, force), t, moved, model


def turn(number: str, example: str, log: Log) -> Figure:
    """Fig. 8.6 and 8.8: a turn by 90 degrees."""
    charts, _, moved, model = against_model(
        log, 1, "psi_rad", 1.5, math.degrees(1.0), "deg", "yaw_rad_s", (topics.ACTUATOR_ATTAINED, "yaw_nm", "N, Nm")
    )
    speed, compass = np.abs(log.truth("yaw_rad_s")[1]).max(), log.vessel.sensor("compass")
    assert compass is not None
    bound = "its drag is constant: 3.78 < 17.84 (8.23)" if number == "8.6" else "the limit (8.27) is 13.4 rad/s"
    caption = (
        f"{example}: {log.vessel.title}, controller designed with the identified model, 90 degrees at w0 = 1.5 rad/s. "
        f"Overshoot {over(moved)}, largest difference from the model function {apart(moved, model)} (compass "
        f"every {1e3 * compass.sample_time_s:.0f} ms), fastest {speed:.2f} rad/s; {bound}."
    )
    return Figure(charts, caption)


def over(moved: Array) -> str:
    """Return the overshoot of a step from 0 to 1."""
    return f"{100.0 * max(0.0, float(moved.max()) - 1.0):.1f} %"


def apart(moved: Array, model: Array) -> str:
    """Return the largest difference of two steps from 0 to 1."""
    return f"{100.0 * float(np.abs(moved - model).max()):.1f} %"


def dive(w0: float, log: Log) -> Figure:
    """Fig. 8.7: a dive."""
    charts, _, moved, model = against_model(
        log, 1, "z_m", w0, 1.0, "m", "heave_m_s", (topics.ACTUATOR_ATTAINED, "heave_n", "Z, N")
    )
    caption = (
        f"Example 8.2: {log.vessel.title}, controller designed with the identified model, 3 m at w0 = {w0:g} rad/s; "
        f"nobody told it of {log.vessel.bias[2]:g} N of weight. Overshoot {over(moved)}, largest difference from the "
        f"model function {apart(moved, model)}; its drag is constant: 1.61 < 9.515 (8.23)."
    )
    return Figure(charts, caption)


def saturated(w0: float, log: Log) -> Figure:
    """Fig. 8.4: a dive that the actuator limits; without anti-windup as it would be by the model."""
    charts, t, moved, _ = against_model(
        log, 1, "z_m", w0, 1.0, "m", "heave_m_s", (topics.ACTUATOR_ATTAINED, "heave_n", "Z, N")
    )
    limit, heave = axis_limits(log.vessel)[2], log.vessel.model.heave
    assert heave is not None
    loop = LimitedLoop(design(STRUCTURES["I-PD"], heave, bessel(3, w0)), limit, math.inf)
    z, w, dt, wound = 0.0, 0.0, 0.02, []
    for _ in range(round(float(t[-1]) / dt)):
        w += dt * (loop.step(dt, 1.0, z, w) - heave.drag(w)) / heave.alpha
        z += dt * w
        wound.append(1.0 + z)
    at = dt * np.arange(1, len(wound) + 1, dtype=np.float64)
    line(charts[0], at, np.array(wound), "simulated without anti-windup")
    _, force = log.series(topics.ACTUATOR_ATTAINED, "heave_n")
    at_limit_s = float(np.mean(force >= 0.999 * limit) * np.ptp(log.truth("z_m")[0]))
    caption = (
        f"{log.vessel.title} dives by 1 m, {at_limit_s:.0f} s of that at its thruster's limit. With the anti-windup of "
        f"(8.29) it overshoots by {over(moved)}, without by {100.0 * (max(wound) - 2.0):.0f} %."
    )
    return Figure(charts, caption)


def headings(log: Log) -> Figure:
    """Algorithm 8.4 and Fig. 8.9: the self-oscillation by the rudder, heading and rudder after it."""
    t, psi = log.truth("psi_rad")
    result = next(e.message for e in log.recording.messages(topics.EXPERIMENT_RESULT))
    relay, heading = Chart("self-oscillation", "t, s", "deg"), Chart("heading", "t, s", "deg")
    t_wanted, wanted = log.wanted("psi_rad")
    begun = log.begun(3)
    _, (t_rudder, angle) = rudder_chart(log)
    began, ended = ((at - log.begin_ns) / NS for at in (result.began_ns, result.ended_ns))
    for at, values, label in ((t, np.degrees(np.unwrap(psi)), "heading"), (t_rudder, angle, "rudder")):
        here = (at >= began) & (at <= ended)
        line(relay, at[here] - began, values[here], label)
    here = t_wanted >= begun
    line(heading, t_wanted[here] - begun, np.degrees(wanted[here]), "wanted")
    line(heading, t[t >= begun] - begun, np.degrees(psi[t >= begun]), "recorded")
    rudder, here = Chart("rudder", "t, s", "deg"), t_rudder >= begun
    line(rudder, t_rudder[here] - begun, angle[here], most=800)
    last = np.degrees(psi[t >= t[-1] - 15.0])
    caption = (
        f"Algorithm 8.4 with Charlie's rudder, under way at {UNDER_WAY_M_S:g} m/s, wind of 20 N across with gusts: "
        f"{result.plan.oscillations} oscillations with x_a = 10 degrees took {ended - began:.0f} s; I-PD by Bessel, "
        "0.45 rad/s: (5.48, 12.01, 10.97), on the model that was found. Mean error of the last 15 s "
        f"{abs(last.mean() - 20.0):.1f} degrees; there the rudder moves by "
        f"{iadc(t_rudder, angle, t[-1] - 15.0, t[-1]):.1f} degrees a second."
    )
    return Figure((relay, heading, rudder), caption)


def rudder_chart(log: Log, label: str = "") -> tuple[Chart, tuple[Array, Array]]:
    """Return the commanded rudder's chart, and its times and angles in degrees."""
    told = [e.message for e in log.recording.messages(topics.ACTUATOR_COMMAND)]
    begin = log.begin_ns
    t = np.array([(m.stamp_ns - begin) / NS for m in told])
    angle = np.degrees([m.commands["rudder_port"] for m in told])
    chart = Chart("rudder", "t, s", "deg")
    line(chart, t[t >= 0.0], angle[t >= 0.0], label, 800)
    return chart, (t[t >= 0.0], angle[t >= 0.0])


def iadc(t: Array, angle: Array, begin_s: float, end_s: float) -> float:
    """Return how far the rudder moves per second between two times."""
    here = (t >= begin_s) & (t <= end_s)
    return float(np.abs(np.diff(angle[here])).sum() / (end_s - begin_s))


def tuned(log: Log) -> Figure:
    """Algorithm 8.4: turns before and after, and the self-oscillation between."""
    t, psi = log.truth("psi_rad")
    begins = sorted(log.requests.values())
    first, experiment, second = begins[1], begins[2], begins[4]
    turns, relay = Chart("turns by 90 degrees", "t, s", "deg"), Chart("self-oscillation", "t, s", "deg")
    overshoot = []
    for begin, label in ((first, "file's model"), (second, "identified model")):
        here = (t >= begin) & (t <= begin + 24.5)
        line(turns, t[here] - begin, np.degrees(psi[here]), label)
        overshoot.append(float(np.degrees(psi[here]).max() - 90.0))
    here = (t >= experiment) & (t <= begins[3])
    line(relay, t[here] - experiment, np.degrees(np.unwrap(psi[here])), "heading")
    caption = (
        "Algorithm 8.4 on the star: PlaDyPos twice as heavy as its file says, with half the drag, in a current of "
        f"0.05 m/s. Overshoot of a turn {overshoot[0]:.1f} degrees with the file's model, {overshoot[1]:.1f} with the "
        "identified one."
    )
    return Figure((turns, relay), caption)


# --- 8.2


def distances(number: str, log: Log) -> Figure:
    """Fig. 8.16 and 8.17."""
    t, x = log.truth("x_m")
    true = x - BOW_M
    t_wall, estimated, status = _wall(log)
    chart, speed = Chart("VideoRay before a wall", "t, s", "distance, m"), Chart("surge speed", "t, s", "u, m/s")
    t_wanted, wanted = log.wanted("distance_m")
    line(chart, t_wanted, wanted, "wanted")
    line(chart, t, true, "true")
    line(chart, t_wall, estimated, "estimated")
    at, u = log.series(topics.NAVIGATION_WALL, "surge_m_s")
    line(speed, at, u, "estimated")
    at, u = log.truth("surge_m_s")
    line(speed, at, u, "true")
    off = np.abs(true - np.interp(t, t_wanted, wanted))
    if number == "8.16":
        ramp, step = _mm(off, t, 55.0, 59.0), _mm(off, t, 75.0, 1e9)
        said = f"largest error 15 s after the ramp {ramp}, 15 s after the step {step}"
    else:
        dark = t_wall[status]
        parts = np.split(dark, np.flatnonzero(np.diff(dark) > 2.0) + 1)
        absent = [p for p in parts if len(p) and np.ptp(p) > 2.0]
        said = "without dots until " + ", ".join(f"{p[-1]:.0f} s: {_mm(off, t, p[0], p[-1] + 1.0)}" for p in absent)
    caption = f"On the star, dots in rendered pictures at 2 Hz, the tether pulling: {said}."
    return Figure((chart, speed), caption)


def _wall(log: Log) -> tuple[Array, Array, NDArray[np.bool_]]:
    told = [e.message for e in log.recording.messages(topics.NAVIGATION_WALL) if e.message.distance_m is not None]
    t = np.array([(m.stamp_ns - log.begin_ns) / NS for m in told])
    distance, dark = np.array([m.distance_m for m in told]), np.array([m.status == "predicting" for m in told])
    return t[t >= 0.0], distance[t >= 0.0], dark[t >= 0.0]


def _mm(off: Array, t: Array, begin_s: float, end_s: float) -> str:
    return f"{1e3 * off[(t >= begin_s) & (t <= end_s)].max():.0f} mm"


# --- 8.3


def voyage(what: str, log: Log) -> Figure:
    """Fig. 8.21 and 8.23 to 8.26: path, heading, rudder."""
    t, x, y, psi = log.truth("x_m", "y_m", "psi_rad")
    path = Chart("path (y downwards in the pool)", "x, m", "y, m")
    points = log.helm[0].points
    path.line([p.x_m for p in points], [p.y_m for p in points], "path")
    line(path, x, y, "recorded")
    heading = Chart("heading", "t, s", "deg")
    line(heading, t, np.degrees(np.unwrap(psi)))
    rudder, _ = rudder_chart(log)
    a, b = points[-2:]
    gamma = math.atan2(b.y_m - a.y_m, b.x_m - a.x_m)
    d = -(x - a.x_m) * math.sin(gamma) + (y - a.y_m) * math.cos(gamma)
    turned = np.ptp(np.unwrap(psi)) / (2.0 * math.pi)
    said = f"Charlie on the star, {what}; {WEATHER} It turns by {turned:.2f} turns in all; "
    if len(points) == 2:
        size = np.abs(d[:: max(1, round(1.0 / (t[1] - t[0])))])
        falls = -np.diff(size[10 : int(np.argmax(size < 2.0))])
        said += f"once it has turned the distance falls all the way to 2 m, by {falls.min():.2f} m a second at least."
    else:
        last = d[t > t[-1] - STEADY_S]
        said += (
            f"in the last {STEADY_S:.0f} s its mean distance from the line is {abs(last.mean()):.2f} m, "
            f"RMS {math.sqrt(float(np.mean(last**2))):.2f} m."
        )
    return Figure((path, heading, rudder), said)


def rudders(fast: Log, slow: Log) -> Figure:
    """Fig. 8.27: the rudder with both model functions."""
    chart = Chart("steady on a line", "t, s", "rudder, deg")
    moved = []
    for log, label in ((fast, "0.5 rad/s"), (slow, "0.211 rad/s")):
        _, (t, angle) = rudder_chart(log)
        here = (t >= 90.0) & (t <= 150.0)
        line(chart, t[here], angle[here], label, 600)
        moved.append(iadc(t, angle, 90.0, 150.0))
    caption = (
        "Rudder of Charlie on a line by method 1, two runs in the same wind: with the slower model function it "
        f"moves by {moved[1]:.2f} instead of {moved[0]:.2f} degrees a second, "
        f"{100.0 * (1.0 - moved[1] / moved[0]):.0f} % less."
    )
    return Figure((chart,), caption)


def _of(number: str, title: str, draw: Callable[..., Figure], *runs: str) -> tuple[str, Drawing]:
    return number, Drawing(title, draw, runs or (number,))


FIGURES: dict[str, Drawing] = dict(
    (
        _of("8.4", "anti-windup: AutoMarine dives at its actuator's limit", lambda log: saturated(0.3, log)),
        _of("8.6", "Example 8.1: Falcon turns", lambda log: turn("8.6", "Example 8.1", log)),
        _of("8.7", "Example 8.2: Falcon dives", lambda log: dive(0.8, log)),
        _of("8.8", "Example 8.3: nonlinear yaw turns", lambda log: turn("8.8", "Example 8.3", log)),
        _of("8.9", "Charlie's heading and rudder", headings),
        _of("algorithm-8.4", "tuned on the running system", tuned),
        _of("8.16", "distance keeping: ramp and step", lambda log: distances("8.16", log)),
        _of("8.17", "distance keeping: twice 5 s without dots", lambda log: distances("8.17", log)),
        _of("8.21", "method 1 from 75 m beside the line", lambda log: voyage("method 1, at most 45 degrees", log)),
        _of("8.23", "method 2 from 70 m beside the line", lambda log: voyage("method 2, at most 45 degrees", log)),
        _of("8.24", "U-turn by method 1", lambda log: voyage("method 1", log)),
        _of("8.25", "U-turn by method 2 on P-D", lambda log: voyage("method 2, case 1 (P-D)", log)),
        _of("8.26", "U-turn by method 2 on I-PD", lambda log: voyage("method 2, case 2 (I-PD)", log)),
        _of("8.27", "rudder by two model functions", rudders, "8.27 fast", "8.27 slow"),
    )
)
