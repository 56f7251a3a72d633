# ruff: noqa: N803, N806 - symbols of the thesis
"""Line following by thesis 8.3 in simulation: Charlie in wind, GPS and compass at 2 Hz, both methods, both cases.

`python -m benchmarks.line_following PLOT.svg` draws a U-turn by each law, and the rudder of two model functions.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.result import Result
from marine.control.line_following import DirectLine, HeadingLoop, IndirectLine
from marine.control.model_function import bessel
from marine.control.preview import natural_time_s
from marine.control.single_loop import TRACKING_TIME, SingleLoop
from marine.control.structures import STRUCTURES, design
from marine.dynamics.integrate import State
from marine.dynamics.small_vessel import SmallVesselDynamics, Stern
from marine.estimation.ekf import EkfTuning, PoseEkf
from marine.frames import wrap_angle
from marine.guidance.path import Line
from marine.identification import harmonic, self_oscillation
from marine.identification.oscillation import whole_periods
from marine.identification.result import FloatArray
from marine.vessel import DegreeOfFreedom, Rudder, SmallVesselModel
from services.vessels import load_vessel

CHARLIE = load_vessel("charlie")
_RUDDER = next(a for a in CHARLIE.actuators if isinstance(a, Rudder))
assert isinstance(CHARLIE.dynamics, SmallVesselModel)
DYNAMICS = SmallVesselDynamics(CHARLIE.dynamics)
N_SQUARED = 36.0
"""Thesis 8.3.4: n^2 = 36 V^2, kept."""
U_R = 1.0
STEP_S = 0.1
SAMPLE_STEPS = 5
STERN = Stern(0.6, 1.2)
MOMENT_PER_RAD = 2.0 * STERN.L_m * _RUDDER.k_r2 * N_SQUARED
N_MAX = MOMENT_PER_RAD * _RUDDER.n_max
YAW = CHARLIE.model.yaw
FAST, SLOW = 0.5, 0.211
"""Characteristic frequencies of Fig. 8.27, rad/s."""
HEADING_W0 = {"P-D": 0.2, "I-PD": 0.3}
"""Of the autopilots, rad/s: as fast as the rudder follows in the self-oscillations of Table 7.13."""
APPROACH = math.radians(30.0)
GUST_S = 10.0
TUNING = EkfTuning(
    position_m=0.5,
    heading_rad=math.radians(0.5),
    velocity_walk_m_s=0.003,
    yaw_rate_walk_rad_s=0.002,
    force_walk_n=0.3,
    moment_walk_nm=0.3,
    initial_force_n=30.0,
    initial_moment_nm=10.0,
)
"""Charlie's noise as in its vessel file; the walks are chosen."""


@dataclass(frozen=True)
class Weather:
    """Constant wind force on the vessel in {E}, N; standard deviation of gusts (10 s) in N, and noise of the sensors.

    The default is the stated weather of the tests: 20 N across the line, gusts of 3 N, GPS 0.5 m and compass 0.5
    degrees, each sample independently.
    """

    wind_n: tuple[float, float] = (20.0, 0.0)
    gust_n: float = 3.0
    position_m: float = 0.5
    heading_rad: float = math.radians(0.5)


CALM = Weather((0.0, 0.0), 0.0, 0.0, 0.0)


@dataclass
class Voyage:
    """What happened, a value a step of 0.1 s: d is the true distance from the line."""

    t_s: list[float] = field(default_factory=list)
    x_m: list[float] = field(default_factory=list)
    y_m: list[float] = field(default_factory=list)
    psi: list[float] = field(default_factory=list)
    d_m: list[float] = field(default_factory=list)
    phi: list[float] = field(default_factory=list)
    rudder: list[float] = field(default_factory=list)

    def iadc(self, begin_s: float, end_s: float) -> float:
        """Return the mean of |rudder'| in rad/s between two times."""
        part = np.array(self.rudder[round(begin_s / STEP_S) : round(end_s / STEP_S)])
        return float(np.abs(np.diff(part)).sum() / (STEP_S * len(part)))

    def rms(self, begin_s: float) -> float:
        """Return the root mean square of d from a time on, m."""
        return float(np.sqrt(np.mean(np.square(self.d_m[round(begin_s / STEP_S) :]))))


class Boat:
    """Charlie with its rudders' limits and rate, its sensors, and the filter of the star between them and the law."""

    def __init__(
        self, seed: int = 0, place: tuple[float, float, float] = (0.0, 0.0, 0.0), weather: Weather = Weather()
    ) -> None:
        """place: x, y in m, psi in rad. In a calm the law gets the true state, without the filter."""
        self._random, self.weather = np.random.default_rng(seed), weather
        self.state: State = (*place, U_R, 0.0, 0.0)
        self.rudder = 0.0
        self._gust = np.zeros(2)
        self._steps = 0
        tuning = replace(TUNING, position_m=max(weather.position_m, 0.01))
        self.ekf = PoseEkf(CHARLIE.model, tuning, *self._seen())
        self.ekf.state = (*self.ekf.state[:3], U_R, 0.0, 0.0)

    @property
    def known(self) -> State:
        """What the law is told."""
        return self.state if self.weather == CALM else self.ekf.state

    def _seen(self) -> tuple[float, float, float]:
        x, y, psi = self.state[:3]
        noise, w = self._random.standard_normal(3), self.weather
        return x + w.position_m * noise[0], y + w.position_m * noise[1], wrap_angle(psi + w.heading_rad * noise[2])

    def step(self, N: float) -> None:
        """Move on by 0.1 s under a demanded yaw moment in Nm; the thrusters run all the time."""
        wanted = max(-_RUDDER.n_max, min(_RUDDER.n_max, N / MOMENT_PER_RAD))
        most = (_RUDDER.rate_per_s or math.inf) * STEP_S
        self.rudder += max(-most, min(most, wanted - self.rudder))
        tau = STERN.equal_wrench(N_SQUARED, _RUDDER.k_r2 * N_SQUARED, self.rudder)
        w = self.weather
        decay = math.exp(-STEP_S / GUST_S)
        self._gust = decay * self._gust + w.gust_n * math.sqrt(1.0 - decay**2) * self._random.standard_normal(2)
        wind = (w.wind_n[0] + float(self._gust[0]), w.wind_n[1] + float(self._gust[1]), 0.0)
        self.state = DYNAMICS.step(self.state, STEP_S, tau, N_SQUARED, disturbance=wind)
        if w == CALM:
            return
        self.ekf.predict(STEP_S, tau)
        self._steps += 1
        if self._steps % SAMPLE_STEPS == 0:
            self.ekf.update(*self._seen())


class Direct:
    """Method 1 on a boat."""

    def __init__(self, w0: float, yaw: DegreeOfFreedom = YAW, approach_rad: float = APPROACH) -> None:
        self.law = DirectLine(yaw, bessel(4, w0), U_R, N_nm=N_MAX, approach_rad=approach_rad)

    def moment(self, line: Line, eta: State) -> float:
        _, d = line.place(eta[0], eta[1])
        return self.law.step(STEP_S, d, wrap_angle(eta[2] - line.gamma_rad), eta[3:])


class Autopilot:
    """The heading loop that there is: P-D (Case 1) or I-PD (Case 2), thesis 7.7, not to be changed."""

    def __init__(self, structure: str) -> None:
        kind = STRUCTURES[structure]
        made = design(kind, YAW, bessel(kind.order, HEADING_W0[structure]))
        self._loop = SingleLoop(made, TRACKING_TIME * natural_time_s(made))
        self.turns_rad = math.pi
        """Largest turn that it makes towards a reference: beyond half a turn it goes the other way round."""
        self._before: float | None = None
        self._turned = 0.0
        self._missing = 0.0

    def moment(self, psi_ref: float, psi: float, r: float) -> float:
        if self._before is None:
            self._loop.follow(0.0, r)
            self._before = self._turned = psi
        moved = wrap_angle(psi - self._before)
        self._turned += moved
        error = psi_ref - self._turned
        self._loop.advance(STEP_S, error if abs(error) < self.turns_rad else wrap_angle(error), moved, self._missing)
        self._before, wanted = psi, self._loop.demand(r)
        N = max(-N_MAX, min(N_MAX, wanted))
        self._missing = N - wanted
        return N


class Indirect:
    """Method 2 on a boat: the law gives the autopilot its heading."""

    def __init__(self, structure: str, loop: HeadingLoop, w0: float) -> None:
        self.autopilot = Autopilot(structure)
        self.law = IndirectLine(loop, bessel(4, w0), U_R, approach_rad=APPROACH)

    def moment(self, line: Line, eta: State) -> float:
        _, d = line.place(eta[0], eta[1])
        phi_ref = self.law.step(STEP_S, d, wrap_angle(eta[2] - line.gamma_rad), eta[5])
        return self.autopilot.moment(line.gamma_rad + phi_ref, eta[2], eta[5])


def sail(boat: Boat, law: Direct | Indirect, line: Callable[[float], Line], seconds: float) -> Voyage:
    """Follow a line, which may be another one at another time."""
    voyage = Voyage()
    for k in range(round(seconds / STEP_S)):
        now = line(k * STEP_S)
        boat.step(law.moment(now, boat.known))
        x, y, psi, *_ = boat.state
        voyage.t_s.append(k * STEP_S)
        voyage.x_m.append(x)
        voyage.y_m.append(y)
        voyage.psi.append(psi)
        voyage.d_m.append(now.place(x, y)[1])
        voyage.phi.append(wrap_angle(psi - now.gamma_rad))
        voyage.rudder.append(boat.rudder)
    return voyage


# Identification: Algorithm 8.6 I, II and Algorithm 8.8 I, II

TABLE_7_13 = {"P-D": ((20.0, 5.0), (15.0, 5.0)), "I-PD": ((10.0, 5.0), (30.0, 10.0))}
"""(C, x_a) in degrees of both experiments of Case 1 and Case 2."""


def identified_yaw(seed: int = 0, C: float = math.radians(20.0), x_a: float = math.radians(10.0)) -> DegreeOfFreedom:
    """Return alpha_r and beta_r from one self-oscillation by rudder and compass (6.33)."""
    boat, delta, t, eta, tau = Boat(seed, weather=Weather((0.0, 0.0), 3.0)), C, [], [], []
    for k in range(800):
        psi = boat.known[2]
        delta = C if -psi >= x_a else -C if -psi <= -x_a else delta
        t.append(k * STEP_S)
        eta.append(psi)
        tau.append(boat.rudder * MOMENT_PER_RAD)
        boat.step(delta * MOMENT_PER_RAD)
    found = harmonic.project(np.array(t), np.array(eta), np.array(tau), drag="constant", axis="angular")
    return DegreeOfFreedom(found["alpha"], found["beta"], 0.0)


def identified_loop(structure: str, weather: Weather = Weather((0.0, 0.0), 3.0), seed: int = 0) -> HeadingLoop:
    """Return the closed heading loop from two self-oscillations of its reference, (6.52), relays of Table 7.13."""
    gains, omegas = [], []
    for C_deg, x_a_deg in TABLE_7_13[structure]:
        C, x_a = math.radians(C_deg), math.radians(x_a_deg)
        boat, autopilot, ref, eta, tau = Boat(seed, weather=weather), Autopilot(structure), C, [], []
        for _ in range(1000):
            psi = boat.known[2]
            ref = C if -psi >= x_a else -C if -psi <= -x_a else ref
            eta.append(psi)
            tau.append(ref)
            boat.step(autopilot.moment(ref, psi, boat.known[5]))
        omega, response = _first_harmonic(np.array(eta)[200:], np.array(tau)[200:])
        gains.append(-1.0 / response)
        omegas.append(omega)
    values = self_oscillation.heading_closed_loop(gains, omegas)
    return HeadingLoop(values["a_1"], values["a_2"], values["a_3"], values["b_1"])


def _first_harmonic(eta: FloatArray, tau: FloatArray) -> tuple[float, complex]:
    """Return omega in rad/s and eta/tau there, over whole periods of a tau that is held for a step.

    -1 over it is the gain that (6.52) takes from the relay's describing function, without the assumption of a sine.
    """
    starts = whole_periods(tau)
    first, last = int(starts[0]), int(starts[-1])
    omega = 2.0 * math.pi * (len(starts) - 1) / ((last - first) * STEP_S)
    turn = np.exp(-1j * omega * STEP_S * np.arange(last - first))
    held = np.exp(-0.5j * omega * STEP_S)
    return omega, complex((eta[first:last] @ turn) / (tau[first:last] @ turn) / held)


def u_turn(t: float) -> Line:
    """Return a line in +x, after 80 s the one 25 m to starboard, back."""
    return Line(0.0, 0.0, 0.0) if t < 80.0 else Line(0.0, 25.0, math.pi)


def laws(w0: float) -> dict[str, Direct | Indirect]:
    """Return the three laws of thesis 8.3.4, each from its own self-oscillations."""
    return {
        "method 1": Direct(w0, identified_yaw()),
        "method 2, case 1": Indirect("P-D", identified_loop("P-D"), w0),
        "method 2, case 2": Indirect("I-PD", identified_loop("I-PD"), w0),
    }


def measure() -> list[Result]:
    """Return steady cross-track errors of the three laws in the stated weather, and rudder activity by w0."""
    ahead, results = Line(0.0, 0.0, math.pi / 2.0), []
    precise = Weather(gust_n=1.0, position_m=0.05)
    for name, law in laws(SLOW).items():
        key = name.replace(",", "").replace(" ", "_")
        voyage = sail(Boat(1, (10.0, 0.0, math.pi / 2.0)), law, lambda _: ahead, 400.0)
        results.append(Result(f"line_{key}_mean_error_mm", 1e3 * abs(float(np.mean(voyage.d_m[1500:]))), goal=100.0))
        results.append(Result(f"line_{key}_rms_error_gps_50cm_mm", 1e3 * voyage.rms(150.0)))
    for name, law in laws(SLOW).items():
        key = name.replace(",", "").replace(" ", "_")
        voyage = sail(Boat(1, (10.0, 0.0, math.pi / 2.0), precise), law, lambda _: ahead, 400.0)
        results.append(Result(f"line_{key}_rms_error_gps_5cm_mm", 1e3 * voyage.rms(150.0), goal=100.0))
    return [*results, Result("line_rudder_activity_falls_percent", 100.0 * rudder_falls(), goal=70.0)]


def rudder_falls(seed: int = 1) -> float:
    """Return by which part IADC falls from the faster to the slower model function of Fig. 8.27 (8.3.5)."""
    ahead = Line(0.0, 0.0, 0.0)
    fast, slow = (sail(Boat(seed), Direct(w0), lambda _: ahead, 300.0).iadc(100.0, 300.0) for w0 in (FAST, SLOW))
    return 1.0 - slow / fast


def plot(path: Path) -> None:
    """Draw a U-turn by each law (Fig. 8.24-8.26) and the rudder's angle by both model functions (Fig. 8.27)."""
    from services.cli.svg import Chart, write

    track, rudder = Chart("U-turn", "x, m", "y, m"), Chart("Rudder: w0 0.5, from 30 s 0.211 rad/s", "t, s", "deg")
    for name, law in laws(SLOW).items():
        voyage = sail(Boat(1), law, u_turn, 200.0)
        track.line(voyage.x_m, voyage.y_m, name)
    boat, ahead = Boat(1), Line(0.0, 0.0, 0.0)
    sail(boat, Direct(FAST), lambda _: ahead, 60.0)
    parts = [sail(boat, Direct(w0), lambda _: ahead, 30.0) for w0 in (FAST, SLOW)]
    angles = [math.degrees(angle) for part in parts for angle in part.rudder]
    rudder.line([k * STEP_S for k in range(len(angles))], angles)
    write(path, [track, rudder])


if __name__ == "__main__":
    plot(Path(sys.argv[1]))
