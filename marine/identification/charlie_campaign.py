"""The campaign of thesis 7.5 again in simulation: Charlie's yaw, two days of 5 speeds x 4 relays x 3 hystereses.

Wind turns the vessel: its moment goes with V^2 sin 2(gamma - psi) and comes in gusts. Mean wind, gusts, their moment
and the compass' noise are chosen (the thesis draws its wind without numbers), so that Day 1 is the windy one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import radians

import numpy as np

from marine.identification import paper_tables as printed
from marine.identification.campaigns import Trial, relay_trials
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import FloatArray
from marine.vessel import DegreeOfFreedom

C_DEG = (10.0, 15.0, 20.0, 25.0)
X_A_DEG = (5.0, 10.0, 15.0)
SAMPLE_S = 0.5
"""Thesis 3.3: "identification procedures are performed at the sampling rate of 0.5 s"."""
COMPASS_NOISE_RAD = radians(0.3)
DURATION_S = 300.0
WINDOW_S = 3.0
"""Of least squares on integrals: the yaw rate is not measured."""

_MOMENT = radians(2.0) / 7.0**2
"""Moment of the wind from abeam of the bow, in rad of rudder for (m/s)^2: chosen."""
_GUST_S = 8.0


@dataclass(frozen=True)
class Day:
    """Weather of one day: mean wind and standard deviation of its gusts in m/s, direction it blows to in rad."""

    number: int
    wind_m_s: float
    gust_m_s: float
    gamma_rad: float


DAYS = (Day(1, 7.0, 1.5, radians(50.0)), Day(2, 3.0, 0.7, radians(-30.0)))
SPEEDS = tuple(r.n_squared for r in printed.TABLE_7_12 if r.day == 1)
"""n^2 in V^2."""


@dataclass(frozen=True)
class Setting:
    """All experiments of one day at one thrust, and the vessel that was simulated (Table 7.12, constant drag)."""

    day: Day
    n_squared: float
    dof: DegreeOfFreedom
    trials: tuple[Trial, ...]


def wind(day: Day, runs: int, seed: int) -> FloatArray:
    """Return the wind speed in m/s each `SAMPLE_S`, shape (n, runs): Gauss-Markov gusts about the mean."""
    rng = np.random.default_rng(seed)
    n = round(DURATION_S / SAMPLE_S)
    keep = np.exp(-SAMPLE_S / _GUST_S)
    gusts = np.empty((n, runs))
    gusts[0] = day.gust_m_s * rng.standard_normal(runs)
    for k in range(1, n):
        gusts[k] = keep * gusts[k - 1] + day.gust_m_s * np.sqrt(1.0 - keep**2) * rng.standard_normal(runs)
    return np.maximum(day.wind_m_s + gusts, 0.0)


@cache
def settings() -> tuple[Setting, ...]:
    """Return the ten settings (days x thrusts) with up to twelve experiments each, 120 in all."""
    pairs = [(radians(C), radians(x_a)) for C in C_DEG for x_a in X_A_DEG]
    C, x_a = np.array(pairs).T
    out = []
    for seed, row in enumerate(printed.TABLE_7_12):
        day, dof = DAYS[row.day - 1], DegreeOfFreedom(row.alpha_linear, row.beta, 0.0)
        loop = RelayLoop(
            dof,
            C,
            x_a,
            sample_time_s=SAMPLE_S,
            noise=COMPASS_NOISE_RAD,
            disturbance=_moment(day, wind(day, len(pairs), seed)),
        )
        trials = relay_trials(loop, len(pairs), DURATION_S, seed=750 + seed, window_s=WINDOW_S)
        out.append(Setting(day, row.n_squared, dof, tuple(trials)))
    return tuple(out)


class _moment:  # noqa: N801 - a function with a table
    def __init__(self, day: Day, speeds: FloatArray) -> None:
        self.gamma, self.speeds = day.gamma_rad, speeds

    def __call__(self, t_s: float, psi: FloatArray) -> FloatArray:
        V = self.speeds[round(t_s / SAMPLE_S)]
        out: FloatArray = _MOMENT * V**2 * np.sin(2.0 * (self.gamma - psi))
        return out
