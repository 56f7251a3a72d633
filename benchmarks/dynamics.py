"""Simulation of the uncoupled model: a minute of one vessel, and of a thousand at once."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.result import Result
from marine.dynamics.batch import UncoupledBatch
from marine.dynamics.uncoupled import UncoupledModel
from services.vessels import load_vessel

DT_S = 0.05
"""Errs by less than 1e-6 m and rad after 60 s (tests/unit/test_model_batch.py)."""
STEPS = round(60.0 / DT_S)
TAU = (1.0, 0.1, 0.1)


def results() -> list[Result]:
    """Return medians of 5: 60 s of PlaDyPos in steps of 50 ms from rest under a constant wrench."""
    model = load_vessel("pladypos").model
    one = UncoupledModel(model)
    batch, tau = UncoupledBatch([model] * 1000), np.array(TAU)[:, None]

    def single() -> None:
        state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for _ in range(STEPS):
            state = one.step(state, DT_S, TAU)

    def many() -> None:
        states = np.zeros((6, 1000))
        for _ in range(STEPS):
            states = batch.step(states, DT_S, tau)

    def dop853() -> None:
        solve_ivp(
            lambda _t, s: np.array(one.derivative((s[0], s[1], s[2], s[3], s[4], s[5]), TAU)),
            (0.0, 60.0),
            np.zeros(6),
            method="DOP853",
            rtol=1e-8,
            atol=1e-10,
        )

    return [
        Result("model_60s_single_ms", 1e3 * _median_s(single), {"scipy_dop853": 1e3 * _median_s(dop853)}, goal=20.0),
        Result("model_60s_batch_1000_s", _median_s(many), goal=1.0),
    ]


def _median_s(work: Callable[[], None]) -> float:
    times = []
    for _ in range(5):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)
