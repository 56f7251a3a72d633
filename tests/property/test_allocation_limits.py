import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from marine.allocation import (
    REGULARISATION,
    Allocation,
    Array,
    AttainableSet,
    allocation_matrix,
    scale_back,
    vessel_allocation,
    weighted_pseudo_inverse,
)
from marine.vessel import QuadraticThrust, Thruster
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
seeds = st.integers(0, 2**32 - 1)
PLANE = [0, 1, 5]


def random_vessel(rng: np.random.Generator, *, solid: bool = False) -> tuple[Array, Array, Array]:
    """Three to seven thrusters in the plane, or six to nine in space; limits differ forwards and backwards."""
    n = int(rng.integers(6, 10) if solid else rng.integers(3, 8))
    thrusters = [
        Thruster("t", x, y, angle, QuadraticThrust(1.0), z_m=z if solid else 0.0, elevation_rad=e * solid, n_max=1.0)
        for x, y, z, angle, e in zip(
            *rng.uniform(-1.0, 1.0, (3, n)), *rng.uniform(-math.pi, math.pi, (2, n)), strict=True
        )
    ]
    return allocation_matrix(thrusters), -rng.uniform(0.2, 3.0, n), rng.uniform(0.2, 3.0, n)


def oracle(allocation: Allocation, B: Array, lower: Array, upper: Array, demand: Array) -> Array | None:
    """The same regularised problem by scipy's BVLS, from the stacked matrix and not from its square."""
    rows = list(allocation.axes)
    scale, root = allocation.thrust_scale, math.sqrt(REGULARISATION)
    stacked = np.vstack([allocation.weights[:, None] * B[rows] * scale, root * np.eye(len(scale))])
    preferred = np.linalg.pinv(B[rows] * scale) @ demand[rows]
    wanted = np.concatenate([allocation.weights * demand[rows], root * preferred])
    result = lsq_linear(stacked, wanted, (lower / scale, upper / scale), method="bvls", tol=1e-15, max_iter=500)
    return np.asarray(result.x * scale) if result.status > 0 else None


def compare_with_oracle(rng: np.random.Generator, cases: int) -> tuple[int, float]:
    """Return how many of the cases were beyond the limits, and the largest difference of a thrust in N."""
    clipped, worst, done = 0, 0.0, 0
    while done < cases:
        B, lower, upper = random_vessel(rng, solid=done % 4 == 3)
        allocation = Allocation(B, lower, upper)
        if np.linalg.cond(B[list(allocation.axes)]) > 30.0:
            continue
        for _ in range(5):  # one object: the solver starts from what it found before
            demand = np.zeros(6)
            demand[list(allocation.axes)] = rng.normal(size=len(allocation.axes)) * rng.choice([1.0, 3.0, 20.0])
            limits = None
            low, high = lower, upper
            if rng.random() < 0.2:  # limits of the moment, as a limited rate gives them
                middle = rng.uniform(lower, upper)
                low, high = np.maximum(lower, middle - 0.2), np.minimum(upper, middle + 0.2)
                limits = low.tolist(), high.tolist()
            given, attained = allocation.solve(demand.tolist(), limits)
            thrusts = np.array(given)
            assert attained == pytest.approx(B @ thrusts, abs=1e-9)
            expected = oracle(allocation, B, low, high, demand)
            if expected is None:
                continue
            assert np.all(thrusts <= high + 1e-9)
            assert np.all(thrusts >= low - 1e-9)
            worst = max(worst, float(np.abs(thrusts - expected).max()))
            clipped += not np.allclose(B @ thrusts, demand, atol=1e-6)
            done += 1
    return clipped, worst


def test_thrusts_keep_the_limits_and_are_those_of_bvls() -> None:
    clipped, worst = compare_with_oracle(np.random.default_rng(1), 500)
    assert clipped > 100
    assert worst < 1e-9


@pytest.mark.soak
def test_ten_thousand_random_cases_agree_with_bvls() -> None:
    clipped, worst = compare_with_oracle(np.random.default_rng(2), 10_000)
    assert clipped > 2000
    assert worst < 1e-9


def test_a_third_of_what_can_be_attained_is_clipped_by_the_scaled_pseudo_inverse() -> None:
    # The attainable set of four thrusters in X is the projection of a 4-cube along its diagonal, what the
    # pseudo-inverse finds the section across it: 16 and 32/3 in volume.
    rng = np.random.default_rng(3)
    B = allocation_matrix(PLADYPOS.thrusters)
    upper = np.full(4, 0.9)
    allocation, P = Allocation(B, -upper, upper), weighted_pseudo_inverse(B[PLANE], np.ones(4))
    candidates = rng.uniform(-1.0, 1.0, (3000, 3)) * allocation.attainable.reach
    inside = [demand for demand in candidates if allocation.attainable.contains(demand)][:600]
    assert len(inside) == 600
    clipped = 0
    for X, Y, N in inside:
        surge, sway, *_, yaw = allocation.solve((X, Y, 0.0, 0.0, 0.0, N))[1]
        assert (surge, sway, yaw) == pytest.approx((X, Y, N), abs=1e-3)
        scaled = scale_back(P @ (X, Y, N), -upper, upper)
        clipped += not np.allclose(B[PLANE] @ scaled, (X, Y, N), atol=1e-3)
    assert clipped / 600 == pytest.approx(1 / 3, abs=0.06)


@settings(max_examples=60, deadline=None)
@given(seeds, st.booleans())
def test_attainable_set_is_that_of_a_linear_program(seed: int, solid: bool) -> None:
    rng = np.random.default_rng(seed)
    B, lower, upper = random_vessel(rng, solid=solid)
    B = B[np.abs(B).max(axis=1) > 0.0]
    assume(np.linalg.cond(B) < 30.0)
    attainable = AttainableSet(B, lower, upper)
    assert attainable.rank == len(B)
    demand = rng.normal(size=len(B)) * 3.0
    columns = np.column_stack([B, -demand])  # largest s with B t = s demand
    bounds = [*zip(lower, upper, strict=True), (0.0, 1.0)]
    best = linprog([0.0] * len(lower) + [-1.0], A_eq=columns, b_eq=np.zeros(len(B)), bounds=bounds)
    assert best.fun is not None
    assert attainable.scaled(demand) == pytest.approx(-best.fun, abs=1e-7)
    assert attainable.contains(B @ rng.uniform(lower, upper))
    assert attainable.contains(demand) == (best.fun < -1.0 + 1e-9)


@settings(max_examples=40, deadline=None)
@given(seeds, st.floats(0.0, math.tau))
def test_polygons_reach_as_far_as_a_linear_program(seed: int, heading: float) -> None:
    rng = np.random.default_rng(seed)
    B, lower, upper = random_vessel(rng)
    B = B[PLANE]
    assume(np.linalg.cond(B) < 30.0)
    attainable = AttainableSet(B, lower, upper)
    towards = np.array([math.cos(heading), math.sin(heading)])
    bounds = list(zip(lower, upper, strict=True))
    for polygon, zeros in ((attainable.section(0, 2), [1]), (attainable.shadow(0, 2), [])):
        A_eq = B[zeros] if zeros else None
        best = linprog(-towards @ B[[0, 2]], A_eq=A_eq, b_eq=np.zeros(len(zeros)) if zeros else None, bounds=bounds)
        assert best.fun is not None
        assert max((np.array(polygon) @ towards).tolist()) == pytest.approx(-best.fun, abs=1e-6)


@given(st.lists(st.tuples(*[st.floats(-0.05, 0.05)] * 3), min_size=1, max_size=20))
def test_no_wrench_is_no_command_at_once_whatever_is_owed(before: list[tuple[float, float, float]]) -> None:
    allocation = vessel_allocation(PLADYPOS)
    for wrench in before:
        allocation.solve((*wrench[:2], 0.0, 0.0, 0.0, wrench[2]), 0.0, 1.0 / 30.0, carry=True)
    assert allocation.solve((0.0,) * 6, 0.0, 1.0 / 30.0, carry=True)[0] == [0.0] * 4
