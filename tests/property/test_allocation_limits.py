import math
from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import lsq_linear

from marine.actuators import command, thrust
from marine.allocation import REGULARISATION, Allocation, Array, allocation_matrix
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
seeds = st.integers(0, 2**32 - 1)
demands = arrays(float, 3, elements=st.floats(-20.0, 20.0).map(lambda x: round(x, 6)))


def random_vessel(seed: int) -> tuple[Array, Array, Array]:
    """Three to seven thrusters anywhere, with different limits forwards and backwards."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 8))
    thrusters = [
        replace(PLADYPOS.thrusters[0], x_m=x, y_m=y, angle_rad=angle)
        for x, y, angle in zip(*rng.uniform(-1.0, 1.0, (2, n)), rng.uniform(-math.pi, math.pi, n), strict=True)
    ]
    return allocation_matrix(thrusters), -rng.uniform(0.2, 3.0, n), rng.uniform(0.2, 3.0, n)


def oracle(allocation: Allocation, B: Array, lower: Array, upper: Array, demand: Array) -> Array:
    """The same regularised problem by scipy's BVLS, from the stacked matrix and not from its square."""
    scale, root = allocation.thrust_scale, math.sqrt(REGULARISATION)
    stacked = np.vstack([allocation.weights[:, None] * B * scale, root * np.eye(len(scale))])
    wanted = np.concatenate([allocation.weights * demand, root * (np.linalg.pinv(B * scale) @ demand)])
    result = lsq_linear(stacked, wanted, (lower / scale, upper / scale), method="bvls", tol=1e-15, max_iter=500)
    assume(result.status > 0)
    return np.asarray(result.x * scale)


@settings(max_examples=150, deadline=None)
@given(seeds, st.lists(demands, min_size=1, max_size=4))
def test_thrusts_keep_the_limits_and_are_those_of_bvls(seed: int, sequence: list[Array]) -> None:
    B, lower, upper = random_vessel(seed)
    assume(np.linalg.cond(B) < 30.0)
    allocation = Allocation(B, lower, upper)
    for demand in sequence:  # one object: the solver starts from what it found before
        thrusts = np.array(allocation.solve(*demand.tolist()))
        assert np.all(thrusts <= upper + 1e-9)
        assert np.all(thrusts >= lower - 1e-9)
        assert np.allclose(thrusts, oracle(allocation, B, lower, upper, demand), rtol=0.0, atol=1e-9)


@given(
    thrust_n=st.floats(-1.5, 1.5),
    n_max=st.integers(1, 30),
    dead_zone=st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.7]),
    integer=st.booleans(),
)
def test_no_other_command_is_nearer_in_thrust(thrust_n: float, n_max: int, dead_zone: float, integer: bool) -> None:
    thruster = replace(PLADYPOS.thrusters[0], n_max=float(n_max), dead_zone=dead_zone, integer=integer)
    n = command(thruster, thrust_n)
    assert abs(n) <= n_max
    assert not integer or n == int(n)
    assert n == 0.0 or abs(n) > dead_zone
    error = abs(thrust(thruster, n) - thrust_n)
    rivals = range(-n_max, n_max + 1) if integer else np.linspace(-n_max, n_max, 61)
    assert error <= min(abs(thrust(thruster, float(rival)) - thrust_n) for rival in rivals) + 1e-12
