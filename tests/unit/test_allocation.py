import math
from collections.abc import Sequence

import numpy as np
import pytest

from marine.allocation import (
    Allocation,
    Array,
    allocation_matrix,
    axis_limits,
    rank,
    scale_back,
    vessel_allocation,
    weighted_pseudo_inverse,
)
from marine.allocation.of_vessel import FixedActuators
from marine.allocation.rounding import CARRY_S
from marine.vessel import BilinearThrust, QuadraticThrust, Thruster
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
PLANE = [0, 1, 5]
D, H = 0.4, 0.6


def at(x: float, y: float, azimuth_deg: float, elevation_deg: float = 0.0) -> Thruster:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    return Thruster("t", x, y, azimuth, QuadraticThrust(0.01), elevation_rad=elevation, n_max=10.0)


A = math.sin(math.pi / 4)
TOPOLOGIES: dict[str, tuple[list[Thruster], list[int], list[list[float]]]] = {
    # thesis Table 2.2, geometry and printed matrix; (b) and (c) corrected, see docs/errata.md
    "a": ([at(0, -D, 0), at(0, D, 0), at(0, 0, 0, 90)], [0, 2, 5], [[1, 1, 0], [0, 0, 1], [D, -D, 0]]),
    "b": ([at(0, -D, 0), at(0, D, 0), at(0, 0, 90)], [0, 1, 5], [[1, 1, 0], [0, 0, 1], [D, -D, 0]]),
    "b, lateral thruster ahead": (
        [at(0, -D, 0), at(0, D, 0), at(H, 0, 90)],
        [0, 1, 5],
        [[1, 1, 0], [0, 0, 1], [D, -D, H]],
    ),
    "c": (
        [at(D * A, D * A, -45), at(D * A, -D * A, 45), at(-D * A, D * A, 45), at(-D * A, -D * A, -45)],
        [0, 1, 5],
        [[A, A, A, A], [-A, A, A, -A], [-D, D, -D, D]],
    ),
    "d": (
        [at(0, -D, 0), at(D, 0, 90), at(0, D, 0), at(-D, 0, 90)],
        [0, 1, 5],
        [[1, 0, 1, 0], [0, 1, 0, 1], [D, D, -D, -D]],
    ),
    "e": (
        [at(0, -D, 0), at(0, D, 0), at(D, 0, 0, 90), at(-D, 0, 0, 90)],
        [0, 2, 4, 5],
        [[1, 1, 0, 0], [0, 0, 1, 1], [0, 0, -D, D], [D, -D, 0, 0]],
    ),
}


@pytest.mark.parametrize("name", TOPOLOGIES)
def test_topologies_of_table_2_2_follow_from_geometry(name: str) -> None:
    thrusters, axes, printed = TOPOLOGIES[name]
    B = allocation_matrix(thrusters)
    assert B.shape == (6, len(thrusters))
    assert np.allclose(B[axes], printed, atol=1e-12)
    others = np.delete(B, axes, axis=0)
    assert np.allclose(others, 0.0, atol=1e-12)
    assert rank(B) == len(axes)


def test_matrix_from_positions_has_the_corrected_sign_pattern_and_full_rank() -> None:
    B = allocation_matrix(PLADYPOS.thrusters)
    assert np.sign(B[0]).tolist() == [1, 1, 1, 1]
    assert np.sign(B[1]).tolist() == [-1, 1, 1, -1]
    assert np.sign(B[5]).tolist() == [-1, 1, -1, 1]
    assert np.allclose(np.abs(B[:2]), math.sin(math.pi / 4))
    assert np.allclose(np.abs(B[5]), 0.30)
    assert rank(B) == 3


def test_matrix_as_printed_is_singular() -> None:
    # pladypos (2): the yaw row is a multiple of the sway row (docs/errata.md).
    s, d = math.sin(math.pi / 4), 0.30
    assert rank(np.array([[s, s, s, s], [-s, s, s, -s], [d, -d, -d, d]])) == 2


def test_propellers_of_one_hand_roll_the_vessel_and_of_two_hands_do_not() -> None:
    # thesis Fig. 2.4 (a), (b): q = q1 + q2 and q1 - q2
    def pair(*spins: int) -> Array:
        propellers = [BilinearThrust(2.0, 1.0, q_nn=0.3, spin=spin) for spin in spins]
        thrusters = [Thruster("p", 0.0, y, 0.0, p, n_max=5.0) for y, p in zip((-D, D), propellers, strict=True)]
        return allocation_matrix(thrusters) @ np.ones(2)

    assert pair(1, 1).tolist() == pytest.approx([2.0, 0.0, 0.0, 0.3, 0.0, 0.0])
    assert pair(1, -1).tolist() == pytest.approx([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_axis_limits_are_those_of_all_thrusters_together() -> None:
    # four times K_T n_max^2 = 0.9 N, at 45 degrees and with a lever of 0.30 m
    force = 4 * 0.9 * math.sin(math.pi / 4)
    assert axis_limits(PLADYPOS) == pytest.approx((force, force, 0.0, 0.0, 0.0, 4 * 0.9 * 0.30))


def in_plane(rows: Sequence[Sequence[float]]) -> Array:
    B = np.zeros((6, len(rows[0])))
    B[PLANE] = rows
    return B


def pladypos() -> Allocation:
    allocation = vessel_allocation(PLADYPOS)
    assert isinstance(allocation, FixedActuators)
    return allocation.allocation


def tau(X: float, Y: float, N: float) -> tuple[float, ...]:
    return X, Y, 0.0, 0.0, 0.0, N


def test_demand_within_the_limits_is_met_with_the_smallest_thrusts() -> None:
    allocation = pladypos()
    demand = np.array([1.0, -0.4, 0.2])
    thrusts, attained = allocation.solve(tau(*demand))
    assert thrusts == pytest.approx(np.linalg.pinv(allocation_matrix(PLADYPOS.thrusters)[PLANE]) @ demand, abs=1e-9)
    assert attained == pytest.approx(tau(*demand), abs=1e-9)
    assert allocation.wrench(thrusts) == pytest.approx(attained, abs=1e-9)


def test_yaw_goes_before_surge_and_sway() -> None:
    allocation = pladypos()
    surge, sway, *_, yaw = allocation.solve(tau(2.5, 0.0, 0.6))[1]
    assert yaw == pytest.approx(0.6, rel=0.05)
    assert 0.9 < surge < 1.3  # what four thrusters have left
    assert sway == pytest.approx(0.0, abs=1e-6)


def test_priority_says_who_goes_first() -> None:
    force = vessel_allocation(PLADYPOS, priority={0: 30.0})
    surge, *_, yaw = force.solve(tau(2.5, 0.0, 0.6))[1]
    assert surge == pytest.approx(2.5, rel=0.01)
    assert yaw < 0.1


def test_a_kept_direction_makes_the_whole_wrench_smaller() -> None:
    allocation = vessel_allocation(PLADYPOS, keep_direction=True)
    demand = np.array([2.5, -1.0, 0.6])
    attained = np.array(allocation.solve(tau(*demand))[1])[PLANE]
    factor = attained[0] / demand[0]
    assert 0.1 < factor < 0.9
    assert attained == pytest.approx(factor * demand, abs=1e-3)
    thrusts, _ = pladypos().solve(tau(*attained))
    assert max(map(abs, thrusts)) == pytest.approx(0.9, abs=1e-3)  # as far as it goes


def test_an_absurd_demand_has_an_answer_and_leaves_nothing_behind() -> None:
    allocation = pladypos()
    before, _ = allocation.solve(tau(2.0, 0.3, 0.5))
    assert allocation.solve(tau(0.0, 0.0, -1e300))[1][5] == pytest.approx(-1.08)
    assert allocation.solve(tau(2.0, 0.3, 0.5))[0] == pytest.approx(before, abs=1e-9)


def test_an_axis_without_actuators_is_ignored() -> None:
    B = in_plane([[1.0, 1.0], [0.0, 0.0], [0.5, -0.5]])
    allocation = Allocation(B, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert allocation.axes == (0, 5)
    assert allocation.solve(tau(0.5, 7.0, 0.2))[1] == pytest.approx(tau(0.5, 0.0, 0.2), abs=1e-9)
    assert allocation.reach == pytest.approx([2.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def test_an_axis_that_is_not_controlled_is_left_to_itself() -> None:
    B = in_plane([[1.0, 1.0], [0.0, 0.4], [0.5, -0.5]])
    allocation = Allocation(B, np.array([-1.0, -1.0]), np.array([1.0, 1.0]), axes=(0, 5))
    _, attained = allocation.solve(tau(0.5, 0.0, 0.2))
    assert (attained[0], attained[5]) == pytest.approx((0.5, 0.2), abs=1e-9)
    assert attained[1] == pytest.approx(0.4 * (0.5 - 0.2 / 0.5) / 2)


def test_a_failed_thruster_gets_nothing_and_three_still_control_three_axes() -> None:
    whole, three = vessel_allocation(PLADYPOS), vessel_allocation(PLADYPOS, failed=["front_port"])
    commands, attained = three.solve(tau(0.4, 0.2, 0.05))
    assert commands[1] == 0.0
    assert attained == pytest.approx(tau(0.4, 0.2, 0.05), abs=1e-9)
    assert (whole.rank, three.rank) == (3, 3)
    two = vessel_allocation(PLADYPOS, failed=["front_port", "rear_port"])
    assert two.rank == 2
    one_axis = vessel_allocation(PLADYPOS, failed=["front_port", "rear_starboard"])
    assert one_axis.rank == 2
    with pytest.raises(ValueError, match="no working actuator"):
        vessel_allocation(PLADYPOS, failed=[t.name for t in PLADYPOS.thrusters])


def test_thrusts_keep_to_the_limits_of_the_moment_and_forget_them() -> None:
    allocation = pladypos()
    narrow, _ = allocation.solve(tau(2.0, 0.0, 0.0), ([0.1] * 4, [0.3] * 4))
    assert narrow == pytest.approx([0.3] * 4)
    assert allocation.solve(tau(0.0, 0.0, 0.0), ([0.1] * 4, [0.3] * 4))[0] == pytest.approx([0.1] * 4)
    wide, _ = allocation.solve(tau(9.0, 0.0, 0.0))
    assert wide == pytest.approx([0.9] * 4)


@pytest.mark.parametrize(("lower", "upper"), [(0.1, 1.0), (-1.0, -0.1), (0.0, 0.0)])
def test_limits_must_allow_zero_and_something_else(lower: float, upper: float) -> None:
    with pytest.raises(ValueError, match="enclose zero"):
        Allocation(np.eye(6), np.full(6, lower), np.full(6, upper))


def test_pseudo_inverse_is_the_inverse_of_a_square_matrix_and_prefers_cheap_thrusters() -> None:
    square = allocation_matrix(TOPOLOGIES["a"][0])[TOPOLOGIES["a"][1]]
    assert np.allclose(weighted_pseudo_inverse(square, np.array([1.0, 5.0, 2.0])), np.linalg.inv(square))
    wide = allocation_matrix(PLADYPOS.thrusters)[PLANE]
    W = np.diag([1.0, 1.0, 1.0, 50.0])
    expected = np.linalg.inv(W) @ wide.T @ np.linalg.inv(wide @ np.linalg.inv(W) @ wide.T)
    P = weighted_pseudo_inverse(wide, np.diag(W))
    assert np.allclose(P, expected)
    with pytest.raises(ValueError, match="positive"):
        weighted_pseudo_inverse(wide, np.zeros(4))


def test_scaling_back_keeps_the_direction() -> None:
    t = scale_back(np.array([2.0, -1.0, 0.0]), np.array([-0.5, -0.5, -1.0]), np.array([1.5, 1.0, 1.0]))
    assert t == pytest.approx([1.0, -0.5, 0.0])
    assert scale_back(np.array([0.2, 0.0]), -np.ones(2), np.ones(2)) == pytest.approx([0.2, 0.0])


def test_whole_commands_make_up_for_their_rounding_errors_with_few_changes() -> None:
    allocation, dt_s = vessel_allocation(PLADYPOS, failed=["front_port"]), 1.0 / 30.0
    wrench = np.array([0.03, 0.011, 0.0, 0.0, 0.0, 0.002])  # against a current: all between -3 and 3
    carried = [allocation.solve(wrench.tolist(), 0.0, dt_s, carry=True)[0] for _ in range(300)]
    given = np.array([allocation.delivered(commands) for commands in carried])
    owed = np.cumsum(wrench - given, axis=0) * dt_s
    step = allocation.delivered([3.0, 0.0, 0.0, 0.0])[0] - allocation.delivered([2.0, 0.0, 0.0, 0.0])[0]
    assert np.abs(owed[:, :2]).max() < 3.0 * step * CARRY_S  # of three thrusters
    alone = np.array(allocation.delivered(allocation.solve(wrench.tolist())[0]))
    assert np.abs(wrench - given.mean(axis=0))[PLANE].max() < 0.05 * np.abs(wrench - alone)[PLANE].max()
    changes = np.count_nonzero(np.diff(carried, axis=0))
    assert changes < 0.25 * len(carried) * 3
    assert (np.ptp(carried, axis=0) <= 1.0).all()


def test_beyond_the_limits_nothing_is_owed() -> None:
    allocation = vessel_allocation(PLADYPOS)
    for _ in range(100):
        assert max(map(abs, allocation.solve(tau(9.0, 0.0, 0.0), 0.0, 0.05, carry=True)[0])) == 15.0
    assert allocation.solve(tau(0.0, 0.0, 0.0), 0.0, 0.05, carry=True)[0] == [0.0] * 4
