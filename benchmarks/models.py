"""The mathematics: one allocation, from a wrench to whole commands for four thrusters with limits; simulation."""

from __future__ import annotations

import functools
import gc
import time
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks import dynamics
from benchmarks.result import Result, percentile
from marine.allocation import vessel_allocation
from marine.allocation.of_vessel import FixedActuators
from services.vessels import load_vessel

CALLS = 4000
PEER_CALLS = 300
Demands = list[tuple[float, ...]]


def measure() -> list[Result]:
    """Return medians of allocation over random wrenches, half of them beyond the limits, and of simulation."""
    allocation = vessel_allocation(load_vessel("pladypos"))
    assert isinstance(allocation, FixedActuators)
    inside, outside = _wrenches(allocation)
    mixed = [demand for pair in zip(inside, outside, strict=True) for demand in pair]
    solve = functools.partial(allocation.solve, dt_s=1.0 / 30.0, carry=True)
    bvls = _bvls(allocation)
    return [
        Result(
            "allocation_p50_us",
            _median_us(solve, mixed),
            {"scipy_bvls": _median_us(bvls, mixed[:PEER_CALLS])},
            goal=10.0,
        ),
        Result("allocation_attainable_p50_us", _median_us(solve, inside)),
        Result("allocation_beyond_limits_p50_us", _median_us(solve, outside)),
        *dynamics.results(),
    ]


def _wrenches(allocation: FixedActuators) -> tuple[Demands, Demands]:
    """Return as many wrenches [X Y Z K M N] that can be attained as wrenches that cannot."""
    attainable = allocation.allocation.attainable
    rng = np.random.default_rng(1)
    inside: Demands = []
    outside: Demands = []
    while min(len(inside), len(outside)) < CALLS // 2:
        demand = rng.uniform(-1.0, 1.0, 3) * attainable.reach
        surge, sway, yaw = demand.tolist()
        (inside if attainable.contains(demand) else outside).append((surge, sway, 0.0, 0.0, 0.0, yaw))
    return inside[: CALLS // 2], outside[: CALLS // 2]


def _bvls(allocation: FixedActuators) -> Callable[[Sequence[float]], object]:
    """Return the same bounded least squares, without the regularisation, by scipy, and without commands after it."""
    from scipy.optimize import lsq_linear

    problem = allocation.allocation
    axes = list(problem.axes)
    columns = np.column_stack([problem.wrench(unit) for unit in np.eye(len(problem.thrust_scale)).tolist()])[axes]
    weighted, limit = problem.weights[:, None] * columns, problem.thrust_scale

    def solve(tau: Sequence[float]) -> object:
        wanted = problem.weights * np.array([tau[axis] for axis in axes])
        return lsq_linear(weighted, wanted, (-limit, limit), method="bvls").x

    return solve


def _median_us(solve: Callable[[Sequence[float]], object], demands: Demands) -> float:
    for demand in demands[:50]:
        solve(demand)
    times = []
    gc.disable()
    try:
        for demand in demands:
            begin_ns = time.perf_counter_ns()
            solve(demand)
            times.append((time.perf_counter_ns() - begin_ns) * 1e-3)
    finally:
        gc.enable()
    return percentile(times, 50)
