# ruff: noqa: N803, N806, PLR0917 - symbols of the thesis
"""Distance keeping by thesis 8.2 in simulation: Algorithm 8.5 with VideoRay before a wall, and the laser's absence.

`python -m benchmarks.distance_keeping PLOT.svg` draws what Fig. 8.16 and 8.17 show; with a RECORDING of the star as
second argument it draws that, and prints what it says.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.result import Result
from bus import topics
from bus.messages import SimulationTruth
from camera_tracker.laser.dots import DotTracker
from camera_tracker.laser.ranging import laser_module
from camera_tracker.laser.wall import WallCamera
from logs.reader import Recording
from marine.allocation import axis_limits
from marine.control.distance import DistanceKeeping
from marine.control.model_function import bessel
from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import UncoupledModel
from marine.estimation.distance_ekf import STEADY, DistanceEkf, DistanceTuning
from marine.frames import wrap_angle
from marine.identification import harmonic
from marine.identification.result import Axis
from marine.vessel import DegreeOfFreedom
from services.cli.svg import Chart, write
from services.simulator.laser import wall_ahead
from services.vessels import load_vessel

VIDEORAY = load_vessel("videoray")
_X, _, _, _, _, _N = axis_limits(VIDEORAY)
STEP_S = 0.1
LASER_EVERY = 5
COMPASS_QUANTUM_RAD = math.radians(2.0)
COMPASS_OFFSET_RAD = 2.0
"""Heading of the vessel when it faces the wall: unknown to everybody."""
W0_DISTANCE, W0_ANGLE = 0.4, 0.8


@dataclass
class Sight:
    """One laser sample: angle and distance, or nothing when the dots are not found."""

    phi_rad: float
    distance_m: float


@dataclass
class Log:
    """What happened, one value a step of 0.1 s."""

    t_s: list[float] = field(default_factory=list)
    reference: list[float] = field(default_factory=list)
    true_m: list[float] = field(default_factory=list)
    estimated_m: list[float] = field(default_factory=list)
    measured: list[tuple[float, float]] = field(default_factory=list)
    u: list[float] = field(default_factory=list)
    u_true: list[float] = field(default_factory=list)
    phi_true: list[float] = field(default_factory=list)


class Eye:
    """The laser module as the star has it: a rendered picture of the dots, and what the dot tracker finds in it."""

    def __init__(self, seed: int) -> None:
        module = laser_module()
        self._camera, self._dots = WallCamera(module, seed=seed), DotTracker(module)

    def see(self, distance_m: float, phi_rad: float) -> Sight | None:
        """Return what is seen of a wall at a distance square to it; nothing when the dots are not found."""
        found = self._dots.read(self._camera.picture(distance_m / math.cos(phi_rad), phi_rad))
        if found.distance_m is None or found.angle_rad is None:
            return None
        return Sight(found.angle_rad, found.distance_m * math.cos(found.angle_rad))


class Wall:
    """VideoRay before a wall, with delays, limits and sensors of its vessel file; the wall's normal is x.

    Laser noise 5 mm and 1 degree (with pictures: what the dot tracker makes of them), 10 % of the samples lost; compass
    in steps of 2 degrees, a step late.
    drift_m_s: v_d, a current away from the wall; tether: the constant force and moment of the file's [bias], too.
    """

    def __init__(
        self,
        seed: int,
        distance_m: float = 0.6,
        phi_rad: float = 0.1,
        *,
        drift_m_s: float = 0.0,
        tether: bool = True,
        pictures: bool = False,
    ) -> None:
        self._eye = Eye(seed) if pictures else None
        self._random = np.random.default_rng(seed)
        self._water = UncoupledModel(VIDEORAY.model)
        self._state: State = (-distance_m, 0.0, phi_rad, 0.0, 0.0, 0.0)
        self._drift = (-drift_m_s, 0.0)
        self._bias = VIDEORAY.bias if tether else (0.0,) * 6
        self._commands = deque([(0.0, 0.0)] * round(VIDEORAY.command_delay_s / STEP_S))
        self._headings = deque([phi_rad] * 2, maxlen=2)
        self.steps = 0
        self.blind = False

    @property
    def truth(self) -> tuple[float, float, float]:
        """Distance, angle, surge speed."""
        return -self._state[0], self._state[2], self._state[3]

    def compass(self) -> float:
        heading = self._headings[0] + COMPASS_OFFSET_RAD
        return wrap_angle(round(heading / COMPASS_QUANTUM_RAD) * COMPASS_QUANTUM_RAD)

    def laser(self) -> Sight | None:
        """The sample of this step; None between two of them, and when the dots are not found."""
        if self.steps % LASER_EVERY or self.blind or self._random.random() < 0.1:
            return None
        d, phi, _ = self.truth
        noise = self._random.standard_normal(2)
        if self._eye is not None:
            return self._eye.see(d + 0.005 * noise[1], phi)
        return Sight(phi + math.radians(1.0) * noise[0], d + 0.005 * noise[1])

    def step(self, X: float, N: float) -> tuple[float, float]:
        """Advance by 0.1 s; return the force and moment that acted: those of the step before."""
        self._commands.append((max(-_X, min(_X, X)), max(-_N, min(_N, N))))
        X, N = self._commands.popleft()
        bias = self._bias
        for _ in range(5):
            tau = (X + bias[0], bias[1], N + bias[5])
            self._state = self._water.step(self._state, STEP_S / 5, tau, self._drift)
        self._headings.append(self._state[2])
        self.steps += 1
        return X, N


def identified_yaw(seed: int = 0, C: float = 0.1, x_a: float = math.radians(10.0)) -> DegreeOfFreedom:
    """Algorithm 8.5 I: the self-oscillation of yaw by compass alone."""
    wall, C, headings, moments = Wall(seed, phi_rad=0.0), min(C, _N), [], []
    middle, N = wall.compass(), C
    while wall.steps < 400:
        e = wrap_angle(middle - wall.compass())
        N = C if e >= x_a else -C if e <= -x_a else N
        headings.append(-e)
        moments.append(N)
        wall.step(0.0, N)
    return _identified(headings, moments, STEP_S, 0.2, "angular")


def identified_surge(
    yaw: DegreeOfFreedom, seed: int = 0, C: float = 0.6, x_a: float = 0.05, *, pictures: bool = False
) -> DegreeOfFreedom:
    """Algorithm 8.5 II, III: phi kept at zero with a differentiated heading, the self-oscillation of the distance."""
    wall = Wall(seed, pictures=pictures)
    keeping = DistanceKeeping(VIDEORAY.model.surge, yaw, bessel(3, W0_DISTANCE), bessel(3, W0_ANGLE), _X, _N)
    sight, X, normal = wall.laser() or Sight(0.0, 0.6), 0.0, wall.compass()
    past = deque([wall.compass()] * (LASER_EVERY + 1), maxlen=LASER_EVERY + 1)
    middle, moved, forces = 0.5, [], []
    while wall.steps < 1500:
        past.append(wall.compass())
        if wall.steps % LASER_EVERY == 0:
            if seen := wall.laser():
                sight = seen
                normal = wrap_angle(normal + 0.2 * wrap_angle(past[-1] - seen.phi_rad - normal))
            e = sight.distance_m - middle
            X = (C if e >= x_a else -C if e <= -x_a else X or C) if wall.steps >= 100 else 0.0
            if wall.steps >= 300:
                moved.append(-e)
                forces.append(X)
        r = wrap_angle(past[-1] - past[0]) / (LASER_EVERY * STEP_S)
        wall.step(X, keeping.steer(STEP_S, wrap_angle(past[-1] - normal), r))
    return _identified(moved, forces, LASER_EVERY * STEP_S, 0.1, "linear")


def _identified(eta: list[float], tau: list[float], dt_s: float, delay_s: float, axis: Axis) -> DegreeOfFreedom:
    t = np.arange(len(eta), dtype=float) * dt_s
    found = harmonic.project(t, np.array(eta), np.array(tau), drag="linear", axis=axis, delay_s=delay_s)
    return DegreeOfFreedom(found["alpha"], 0.0, found["beta_quadratic"])


def keep(
    wall: Wall,
    surge: DegreeOfFreedom,
    yaw: DegreeOfFreedom,
    seconds: float,
    reference: Callable[[float], float],
    blind: Callable[[float], bool] = lambda _: False,
    tuning: DistanceTuning = STEADY,
) -> Log:
    """Algorithm 8.5 IV, V: filter and both controllers, the angle's 5 s before the distance's."""
    keeping = DistanceKeeping(surge, yaw, bessel(3, W0_DISTANCE), bessel(3, W0_ANGLE), _X, _N)
    ekf, log, acted = DistanceEkf(surge, yaw, tuning), Log(), (0.0, 0.0)
    for k in range(round(seconds / STEP_S)):
        t = k * STEP_S
        wall.blind = blind(t)
        ekf.predict(STEP_S, *acted)
        seen = wall.laser()
        ekf.update(
            psi_rad=wall.compass(),
            phi_rad=seen.phi_rad if seen else None,
            distance_m=seen.distance_m if seen else None,
        )
        u, phi, d = ekf.surge_m_s, ekf.angle_rad, ekf.distance_m
        N = keeping.steer(STEP_S, phi, ekf.yaw_rate_rad_s)
        X = keeping.drive(STEP_S, reference(t), d, phi, u) if t >= 5.0 else 0.0
        true_d, true_phi, true_u = wall.truth
        log.t_s.append(t)
        log.reference.append(reference(t))
        log.true_m.append(true_d)
        log.estimated_m.append(d)
        log.u.append(u)
        log.u_true.append(true_u)
        log.phi_true.append(true_phi)
        if seen:
            log.measured.append((t, seen.distance_m))
        acted = wall.step(X, N)
    return log


def blind_errors(
    surge: DegreeOfFreedom, yaw: DegreeOfFreedom, *, drift_m_s: float, tether: bool, runs: int
) -> list[float]:
    """Return the largest error of the distance kept, in m, in each of two absences of the laser of 5 s per run."""
    errors = []
    for seed in range(runs):
        wall = Wall(seed, drift_m_s=drift_m_s, tether=tether)
        log = keep(wall, surge, yaw, 65.0, lambda _: 0.5, lambda t: 40.0 <= t < 45.0 or t >= 60.0)
        off = np.abs(np.array(log.true_m) - 0.5)
        errors += [float(off[k : k + 50].max()) for k in (400, 600)]
    return errors


def measure() -> list[Result]:
    """Return errors with the laser, and without it for 5 s, of filter and controllers made by Algorithm 8.5."""
    yaw = identified_yaw()
    surge = identified_surge(yaw)
    log = keep(Wall(1), surge, yaw, 60.0, lambda _: 0.5)
    off = np.array(log.true_m[300:]) - 0.5
    current = [e for v in (0.0, 0.01, 0.02) for e in blind_errors(surge, yaw, drift_m_s=v, tether=False, runs=8)]
    force = blind_errors(surge, yaw, drift_m_s=0.0, tether=True, runs=8)
    seen = keep(Wall(1, pictures=True), identified_surge(yaw, pictures=True), yaw, 60.0, lambda _: 0.5)
    off_seen = np.array(seen.true_m[300:]) - 0.5
    return [
        Result("distance_keeping_rms_mm", 1e3 * float(np.sqrt(np.mean(off**2)))),
        Result("distance_keeping_with_pictures_rms_mm", 1e3 * float(np.sqrt(np.mean(off_seen**2)))),
        Result("distance_without_laser_5s_current_max_mm", 1e3 * max(current), goal=50.0),
        Result("distance_without_laser_5s_current_median_mm", 1e3 * float(np.median(current))),
        Result("distance_without_laser_5s_tether_max_mm", 1e3 * max(force), goal=50.0),
        Result("distance_without_laser_5s_tether_median_mm", 1e3 * float(np.median(force))),
    ]


def ramp_and_step(t: float) -> float:
    """Return the wanted distance of Fig. 8.16, in m: a ramp from 20 to 40 s, a step at 60 s."""
    return 0.6 - 0.2 * min(max((t - 20.0) / 20.0, 0.0), 1.0) + (0.15 if t >= 60.0 else 0.0)


def plot(path: Path) -> None:
    """Draw ramp and step of the reference (Fig. 8.16), and two absences of the laser (Fig. 8.17)."""
    yaw = identified_yaw()
    surge = identified_surge(yaw)

    moving = keep(Wall(1), surge, yaw, 100.0, ramp_and_step)
    absent = keep(Wall(2), surge, yaw, 60.0, lambda _: 0.5, lambda t: 25.0 <= t < 30.0 or 45.0 <= t < 50.0)
    charts = []
    for title, log in (("Ramp and step", moving), ("Laser absent 25-30 s, 45-50 s", absent)):
        chart = Chart(title, "t, s", "distance, m")
        chart.line(log.t_s, log.reference, "reference")
        chart.line(log.t_s, log.true_m, "true")
        chart.line(log.t_s[5:], log.estimated_m[5:], "estimated")
        charts.append(chart)
    write(path, charts)


def plot_recording(path: Path, recording: Recording) -> None:
    """Draw the distance in a recording of the star, and print its errors: with the laser, and in each absence of it."""
    walls = [e.message for e in recording.messages(topics.NAVIGATION_WALL) if e.message.distance_m is not None]
    begin_s = next(e.message.stamp_ns * 1e-9 for e in recording.messages(topics.HELM_STATE) if e.message.distance_m)

    def curve(messages: Iterable[Any], value: Callable[[Any], float | None]) -> tuple[list[float], list[float]]:
        pairs = [(m.stamp_ns * 1e-9 - begin_s, value(m)) for m in messages]
        kept = [(t, v) for t, v in pairs if t >= 0.0 and v is not None]
        return [t for t, _ in kept], [v for _, v in kept]

    def told(topic: topics.Topic[Any]) -> Iterable[Any]:
        return (entry.message for entry in recording.messages(topic))

    def true(m: SimulationTruth) -> float:
        ahead_m, angle_rad = wall_ahead(VIDEORAY.pool, m.x_m, m.y_m, m.psi_rad)
        return (ahead_m - VIDEORAY.radius_m) * math.cos(angle_rad)

    t_wanted, wanted = curve(told(topics.HELM_STATE), lambda m: m.distance_m)
    t_true, is_true = curve(told(topics.SIMULATION_TRUTH), true)
    chart = Chart("Mode distance on the star, recorded", "t, s", "distance, m")
    chart.line(t_wanted, wanted, "wanted")
    chart.line(t_true[::3], is_true[::3], "true")
    chart.line(*curve(walls, lambda m: m.distance_m), "estimated")
    write(path, [chart])
    t, off = np.array(t_true), np.array(is_true) - np.interp(t_true, t_wanted, wanted)
    blind = [m.stamp_ns * 1e-9 - begin_s for m in walls if m.status == "predicting"]
    for absence in np.split(np.array(blind), np.flatnonzero(np.diff(blind) > 1.0) + 1):
        if len(absence) and np.ptp(absence) > 2.0:
            within = (t >= absence[0]) & (t <= absence[-1])
            print(f"no dots until {absence[-1]:.0f} s: largest error {1e3 * np.abs(off[within]).max():.0f} mm")
    settled = np.array([t_wanted[-1] > at > 15.0 and np.ptp(_during(t_wanted, wanted, at)) == 0.0 for at in t_true])
    print(f"from 12 s after a wish on: RMS {1e3 * float(np.sqrt(np.mean(off[settled] ** 2))):.1f} mm")


def _during(t_s: list[float], values: list[float], at_s: float, before_s: float = 12.0) -> list[float]:
    """Return the values of the last seconds before a time."""
    return [value for t, value in zip(t_s, values, strict=True) if at_s - before_s <= t <= at_s] or [0.0, 1.0]


if __name__ == "__main__":
    if len(sys.argv) > 2:
        plot_recording(Path(sys.argv[1]), Recording(Path(sys.argv[2])))
    else:
        plot(Path(sys.argv[1]))
