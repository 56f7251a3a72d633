import math

import numpy as np
import pytest

from marine.allocation import Allocation, allocation_matrix, attainable, axis_limits, vessel_allocation
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")


def test_matrix_from_positions_has_the_corrected_sign_pattern_and_full_rank() -> None:
    B = allocation_matrix(PLADYPOS.thrusters)
    assert np.sign(B[0]).tolist() == [1, 1, 1, 1]
    assert np.sign(B[1]).tolist() == [-1, 1, 1, -1]
    assert np.sign(B[2]).tolist() == [-1, 1, -1, 1]
    assert np.allclose(np.abs(B[:2]), math.sin(math.pi / 4))
    assert np.allclose(np.abs(B[2]), 0.30)
    assert np.linalg.matrix_rank(B) == 3


def test_matrix_as_printed_is_singular() -> None:
    # pladypos (2): the yaw row is a multiple of the sway row (docs/errata.md).
    s, d = math.sin(math.pi / 4), 0.30
    printed = np.array([[s, s, s, s], [-s, s, s, -s], [d, -d, -d, d]])
    assert np.linalg.matrix_rank(printed) == 2


def test_axis_limits_are_those_of_all_thrusters_together() -> None:
    # four times K_T n_max^2 = 0.9 N, at 45 degrees and with a lever of 0.30 m
    force = 4 * 0.9 * math.sin(math.pi / 4)
    assert axis_limits(PLADYPOS) == pytest.approx((force, force, 0.0, 0.0, 0.0, 4 * 0.9 * 0.30))


def test_attainable_is_the_weaker_direction() -> None:
    B = np.array([[1.0, 1.0], [0.0, 0.0], [0.5, -0.5]])
    assert attainable(B, np.array([-1.0, -1.0]), np.array([3.0, 2.0]), axis=0) == pytest.approx(2.0)
    assert attainable(B, np.array([-1.0, -1.0]), np.array([3.0, 2.0]), axis=1) == 0.0
    assert attainable(B, np.array([-1.0, -1.0]), np.array([3.0, 2.0]), axis=2) == pytest.approx(1.0)


def test_demand_within_the_limits_is_met_with_the_smallest_thrusts() -> None:
    allocation = vessel_allocation(PLADYPOS)
    demand = np.array([1.0, -0.4, 0.2])
    thrusts = allocation.solve(*demand)
    assert thrusts == pytest.approx(np.linalg.pinv(allocation_matrix(PLADYPOS.thrusters)) @ demand, abs=1e-9)
    assert allocation.wrench(thrusts) == pytest.approx(demand, abs=1e-9)


def test_yaw_goes_before_surge_and_sway() -> None:
    allocation = vessel_allocation(PLADYPOS)
    surge, sway, yaw = allocation.wrench(allocation.solve(2.5, 0.0, 0.6))
    assert yaw == pytest.approx(0.6, rel=0.05)
    assert 0.9 < surge < 1.3  # what four thrusters have left
    assert sway == pytest.approx(0.0, abs=1e-6)


def test_an_absurd_demand_has_an_answer_and_leaves_nothing_behind() -> None:
    allocation = vessel_allocation(PLADYPOS)
    before = allocation.solve(1.0, 0.3, 0.1)
    assert allocation.wrench(allocation.solve(0.0, 0.0, -1e300))[2] == pytest.approx(-1.08)
    assert allocation.solve(1.0, 0.3, 0.1) == pytest.approx(before, abs=1e-9)


def test_an_axis_without_actuators_is_ignored() -> None:
    B = np.array([[1.0, 1.0], [0.0, 0.0], [0.5, -0.5]])
    allocation = Allocation(B, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert allocation.wrench(allocation.solve(0.5, 7.0, 0.2)) == pytest.approx((0.5, 0.0, 0.2), abs=1e-9)
    assert allocation.reach == pytest.approx((2.0, 0.0, 1.0))


@pytest.mark.parametrize(("lower", "upper"), [(0.1, 1.0), (-1.0, -0.1), (0.0, 0.0)])
def test_limits_must_allow_zero_and_something_else(lower: float, upper: float) -> None:
    with pytest.raises(ValueError, match="enclose zero"):
        Allocation(np.eye(3), np.full(3, lower), np.full(3, upper))
