import math

import pytest

from marine.actuators import command, max_thrust, thrust
from marine.vessel import Thruster


def thruster(*, integer: bool = True, dead_zone: float = 0.0) -> Thruster:
    return Thruster("t", 0.0, 0.0, 0.0, k_t=0.004, n_max=15.0, integer=integer, dead_zone=dead_zone)


def test_characteristic_is_quadratic_odd_and_saturated() -> None:
    # pladypos (1) with K_T = 0.2 and a force unit of 0.02 N; commands from -15 to 15.
    assert thrust(thruster(), 15.0) == pytest.approx(0.9)
    assert thrust(thruster(), -5.0) == pytest.approx(-0.1)
    assert thrust(thruster(), 40.0) == max_thrust(thruster())


def test_continuous_commands_invert_the_characteristic() -> None:
    assert command(thruster(integer=False), -0.1) == pytest.approx(-5.0)
    assert command(thruster(integer=False), 7.0) == 15.0


@pytest.mark.parametrize(
    ("thrust_n", "expected"),
    [(0.004 * 0.49, 0.0), (0.004 * 0.51, 1.0), (-0.004 * 2.49, -1.0), (-0.004 * 2.51, -2.0), (0.9, 15.0), (5.0, 15.0)],
)
def test_whole_commands_are_nearest_in_thrust(thrust_n: float, expected: float) -> None:
    assert command(thruster(), thrust_n) == expected


@pytest.mark.parametrize("integer", [True, False])
def test_dead_zone_is_stepped_over_where_that_is_nearer(integer: bool) -> None:
    dead = thruster(integer=integer, dead_zone=3.0)
    assert thrust(dead, 3.0) == 0.0
    assert command(dead, 0.004 * 4.0) == 0.0
    assert command(dead, 0.004 * 8.9) > 3.0
    assert thrust(dead, command(dead, -0.004 * 8.9)) < 0.0


def test_zero_is_a_plain_zero() -> None:
    assert math.copysign(1.0, command(thruster(), -0.0)) == 1.0
