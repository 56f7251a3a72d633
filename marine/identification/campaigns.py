"""The campaigns of thesis chapter 7 again in simulation: relay experiments and their conventional counterparts.

The raw data of the thesis are not printed. What is printed (relay outputs, hysteresis, bias, steps, mean parameters)
sets up the simulation; noise and disturbances are chosen, and marked so. Parameters are in SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import radians

import numpy as np
from scipy.signal import savgol_filter

from marine.identification import harmonic, least_squares, step
from marine.identification import paper_tables as printed
from marine.identification.describing_function import relay
from marine.identification.oscillation import Oscillation, measure, upward
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import Drag, FloatArray, IdentificationError, Identified
from marine.identification.self_oscillation import marine_parameters
from marine.identification.validation import mean_absolute_error, relative, simulate
from marine.vessel import DegreeOfFreedom

OSCILLATIONS = 5
"""The thesis records five consecutive oscillations an experiment (6.7, 7.5.2)."""
SETTLING = 2
"""Oscillations that pass before the five."""

_DRAGS: tuple[Drag, ...] = ("constant", "linear")
_DEGREE = radians(1.0)
ALPHA_R, BETA_R, BETA_RR = 1e-4 / _DEGREE, 1e-4 / _DEGREE, 1e-6 / _DEGREE**2
"""The units of Tables 7.7 to 7.11 in SI."""
VIDEORAY = DegreeOfFreedom(printed.TABLE_7_8.alpha_mean * ALPHA_R, 0.0, printed.TABLE_7_8.drag_mean * BETA_RR)
"""Yaw: the means of Table 7.8."""
AUTOMARINE = DegreeOfFreedom(printed.TABLE_7_10_MEAN[0] * ALPHA_R, 0.0, printed.TABLE_7_10_MEAN[2] * BETA_RR)
"""Yaw: the means of Table 7.10."""
AUTOMARINE_X_A = {3.40: range(10, 11, 2), 4.27: range(10, 33, 2), 5.15: range(10, 25, 2), 6.46: range(10, 31, 2)}
"""Table 7.11: hysteresis x_a in degrees that was set, for each relay output C in 1e-2 Nm."""
COMPASS_RAD, COMPASS_NOISE_RAD, ROV_SAMPLE_S = radians(2.0), radians(0.3), 0.1
"""VideoRay and AutoMarine, thesis 7.2: 2 degrees each 0.1 s. The noise is chosen."""

Values = Mapping[str, float]
"""alpha, beta, beta_quadratic."""


@dataclass(frozen=True)
class Trial:
    """One self-oscillation experiment, cut to its five oscillations, and what came out of it.

    C in Nm (Charlie: rad of rudder), x_a in rad as set; eta in rad; found: by Table 6.3; squares, projected: by least
    squares and by projection with constant and with linear drag.
    """

    C: float
    x_a: float
    t_s: FloatArray
    eta: FloatArray
    tau: FloatArray
    oscillation: Oscillation
    found: Values
    squares: dict[Drag, Identified]
    projected: dict[Drag, Identified]

    @property
    def margin(self) -> float:
        """Return (x_a* + |x_0|)/X_m of (7.12): below 1 for a self-oscillation."""
        return (self.oscillation.x_a + abs(self.oscillation.x_0)) / self.oscillation.X_m


@dataclass(frozen=True)
class StepTrial:
    """One step response observed by compass: moment in Nm, slope k_ss in rad/s, alpha and drags by Table 4.1."""

    tau: float
    k_ss: float
    alpha: float
    beta: float
    beta_quadratic: float


@dataclass(frozen=True)
class Validation:
    """A record that no model was identified from: yaw rate in rad/s, moment in Nm as it acts."""

    t_s: FloatArray
    nu: FloatArray
    tau: FloatArray


def relay_trials(loop: RelayLoop, runs: int, duration_s: float, *, seed: int, window_s: float | None) -> list[Trial]:
    """Return the experiments of a relay loop with one C and x_a a run; those without enough oscillations are left out.

    window_s: of least squares; None for differences, as in the thesis.
    """
    t, etas, taus = loop.run(duration_s, runs=runs, seed=seed, steps=5)
    C, x_a = np.broadcast_to(loop.C, runs), np.broadcast_to(loop.x_a, runs)
    trials = []
    for k in range(runs):
        cut = five_oscillations(taus[:, k])
        if cut is None:
            continue
        record = t[cut] - t[cut][0], etas[cut, k], taus[cut, k]
        try:
            seen, _ = measure(*record)
        except IdentificationError:
            continue
        squares: dict[Drag, Identified] = {}
        projected: dict[Drag, Identified] = {}
        for drag in _DRAGS:
            squares[drag] = least_squares.uncoupled(
                record[0], record[2], eta=record[1], drag=drag, window_s=window_s, delay_s=loop.delay_s
            )
            projected[drag] = harmonic.project(*record, drag=drag, delay_s=loop.delay_s)
        found = marine_parameters(seen, loop.delay_s)
        trials.append(Trial(float(C[k]), float(x_a[k]), *record, seen, found, squares, projected))
    return trials


def five_oscillations(tau: FloatArray) -> slice | None:
    """Return the part of a record that holds five oscillations after the settling ones; None if there are fewer."""
    up = upward(tau)
    if len(up) <= SETTLING + OSCILLATIONS:
        return None
    return slice(int(up[SETTLING]) - 1, int(up[SETTLING + OSCILLATIONS]) + 1)


@cache
def videoray(delay_s: float = printed.TABLE_7_9_DELAY_S) -> tuple[Trial, ...]:
    """Return the 15 experiments of Table 7.9 (Fig. 7.3-7.8): C, x_a and bias as printed.

    The x_a that was set is not printed: x_a* less half a sample of overshoot stands for it. The tether's moment follows
    from the printed bias, Delta = -C x_0/X_m (first order of (5.12)); its changes are chosen.
    """
    rows = printed.TABLE_7_9
    C = np.array([1e-2 * r.C for r in rows])
    x_a = np.radians([r.x_a - 0.5 * ROV_SAMPLE_S * r.omega * np.sqrt(r.X_m**2 - r.x_a**2) for r in rows])
    bias = np.array([-relay(1e-2 * r.C, r.x_a, r.X_m, r.x_0).Y_0 for r in rows])
    loop = RelayLoop(
        VIDEORAY,
        C,
        x_a,
        bias,
        delay_s=delay_s,
        sample_time_s=ROV_SAMPLE_S,
        quantisation=COMPASS_RAD,
        noise=COMPASS_NOISE_RAD,
    )
    return tuple(relay_trials(loop, len(rows), 70.0, seed=73, window_s=None))


@cache
def automarine() -> tuple[Trial, ...]:
    """Return the 32 relay experiments of Table 7.11 (Fig. 7.11-7.17): C and x_a as printed, no tether, no delay."""
    pairs = [(1e-2 * C, radians(x_a)) for C, widths in AUTOMARINE_X_A.items() for x_a in widths]
    C, x_a = np.array(pairs).T
    loop = RelayLoop(AUTOMARINE, C, x_a, sample_time_s=ROV_SAMPLE_S, quantisation=COMPASS_RAD, noise=COMPASS_NOISE_RAD)
    return tuple(relay_trials(loop, len(pairs), 70.0, seed=74, window_s=None))


@cache
def automarine_steps() -> tuple[StepTrial, ...]:
    """Return the 24 step responses of Table 7.10 (Fig. 7.9, 7.10): moments as printed, 30 s each."""
    moments = np.array([1e-2 * r.N for r in printed.TABLE_7_10])
    loop = RelayLoop(
        AUTOMARINE, moments, np.inf, sample_time_s=ROV_SAMPLE_S, quantisation=COMPASS_RAD, noise=COMPASS_NOISE_RAD
    )
    t, etas, _ = loop.run(30.0, runs=len(moments), seed=710, steps=5)
    trials = []
    for k, tau in enumerate(moments.tolist()):
        linear = step.type_1(t, etas[:, k], tau, drag="linear")
        constant = step.type_1(t, etas[:, k], tau, drag="constant")
        trials.append(
            StepTrial(tau, tau / constant["beta"], linear["alpha"], constant["beta"], linear["beta_quadratic"])
        )
    return tuple(trials)


@cache
def automarine_validation() -> tuple[Validation, ...]:
    """Return 35 records for validation (7.4.3): random moments held for 2 to 6 s, the yaw rate from the compass."""
    rng = np.random.default_rng(735)
    levels = 1e-2 * np.array([r.N for r in printed.TABLE_7_10])
    t = np.arange(0.0, 40.0, ROV_SAMPLE_S)
    sets = []
    for _ in range(35):
        changes = np.cumsum(rng.uniform(2.0, 6.0, 20))
        tau = rng.choice(levels, 21)[np.searchsorted(changes, t)]
        nu = simulate(AUTOMARINE, t, tau)
        heading = np.concatenate([[0.0], np.cumsum(0.5 * ROV_SAMPLE_S * (nu[1:] + nu[:-1]))])
        seen = np.round((heading + COMPASS_NOISE_RAD * rng.standard_normal(len(t))) / COMPASS_RAD) * COMPASS_RAD
        sets.append(Validation(t, turning_rate(seen, ROV_SAMPLE_S), tau))
    return tuple(sets)


def turning_rate(eta: FloatArray, dt_s: float, window_s: float = 1.1) -> FloatArray:
    """Return the velocity of a coarse heading by a Savitzky-Golay filter, as the thesis does (7.4.3)."""
    half = max(2, round(0.5 * window_s / dt_s))
    out: FloatArray = savgol_filter(eta, 2 * half + 1, 2, deriv=1, delta=dt_s)
    return out


def validations(trials: Sequence[Trial], delay_s: float = 0.0) -> list[Validation]:
    """Return the records of trials for validation, the moment delayed by whole samples to when it acts."""
    sets = []
    for trial in trials:
        dt_s = float(trial.t_s[1] - trial.t_s[0])
        lag = round(delay_s / dt_s)
        acting = np.concatenate([np.full(lag, trial.tau[0]), trial.tau[: len(trial.tau) - lag]])
        sets.append(Validation(trial.t_s, turning_rate(trial.eta, dt_s), acting))
    return sets


def average_error(dof: DegreeOfFreedom, sets: Sequence[Validation]) -> float:
    """Return J-bar in rad/s: the mean of (7.3) over records."""
    errors = [mean_absolute_error(simulate(dof, s.t_s, s.tau, nu_0=float(s.nu[0])), s.nu) for s in sets]
    return float(np.mean(errors))


def relative_errors(
    models: Sequence[DegreeOfFreedom], reference: DegreeOfFreedom, sets: Sequence[Validation]
) -> list[float]:
    """Return (7.13) of each model: how much worse (positive) than the reference it predicts the records."""
    J_reference = average_error(reference, sets)
    return [relative(average_error(dof, sets), J_reference) for dof in models]


def experiments(trials: Sequence[Trial]) -> list[tuple[float, Values]]:
    """Return (C, parameters) of trials, as `model_choice.count` takes them."""
    return [(t.C, t.found) for t in trials]


def least_squares_mean(trials: Sequence[Trial], drag: Drag, skip: float = 0.0) -> DegreeOfFreedom:
    """Return the model of the mean parameters of least squares, (4.20) or (4.22), over trials with C > skip."""
    used = [t.squares[drag] for t in trials if skip < t.C]
    name = "beta" if drag == "constant" else "beta_quadratic"
    alpha, beta = (float(np.mean([one[n] for one in used])) for n in ("alpha", name))
    return DegreeOfFreedom(alpha, beta, 0.0) if drag == "constant" else DegreeOfFreedom(alpha, 0.0, beta)
