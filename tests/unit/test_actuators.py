import itertools
import math

import pytest

from marine.actuators import Drive, Side, ThrustCurve, ambient_speed, hull_torque, lagged, torque
from marine.actuators.rudder import angle, attack_angle, flow_squared, force, linear_force, normal_part, stall_end
from marine.vessel import BilinearThrust, Direct, QuadraticThrust, Thruster


def drive(*, integer: bool = True, dead_zone: float = 0.0, n_min: float | None = None) -> Drive:
    characteristic = QuadraticThrust(0.004)
    return Drive(
        Thruster("t", 0.0, 0.0, 0.0, characteristic, n_max=15.0, n_min=n_min, integer=integer, dead_zone=dead_zone)
    )


def test_characteristic_is_quadratic_odd_and_saturated() -> None:
    # pladypos (1) with K_T = 0.2 and a force unit of 0.02 N; commands from -15 to 15.
    assert drive().thrust(15.0) == pytest.approx(0.9)
    assert drive().thrust(-5.0) == pytest.approx(-0.1)
    assert drive().thrust(40.0) == drive().upper == pytest.approx(0.9)
    assert drive().lower == pytest.approx(-0.9)


def test_continuous_commands_invert_the_characteristic() -> None:
    assert drive(integer=False).command(-0.1) == pytest.approx(-5.0)
    assert drive(integer=False).command(7.0) == 15.0


def test_what_runs_forward_only_never_gets_a_command_astern() -> None:
    ahead = drive(n_min=0.0)
    assert (ahead.lower, ahead.command(-0.5), ahead.thrust(-5.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("thrust_n", "expected"),
    [(0.004 * 0.49, 0.0), (0.004 * 0.51, 1.0), (-0.004 * 2.49, -1.0), (-0.004 * 2.51, -2.0), (0.9, 15.0), (5.0, 15.0)],
)
def test_whole_commands_are_nearest_in_thrust(thrust_n: float, expected: float) -> None:
    assert drive().command(thrust_n) == expected


@pytest.mark.parametrize("integer", [True, False])
def test_dead_zone_is_stepped_over_where_that_is_nearer(integer: bool) -> None:
    dead = drive(integer=integer, dead_zone=3.0)
    assert dead.thrust(3.0) == 0.0
    assert dead.command(0.004 * 4.0) == 0.0
    assert dead.command(0.004 * 8.9) > 3.0
    assert dead.thrust(dead.command(-0.004 * 8.9)) < 0.0


def test_zero_is_a_plain_zero() -> None:
    assert math.copysign(1.0, drive().command(-0.0)) == 1.0
    assert math.copysign(1.0, drive().command(-1e-9)) == 1.0


def test_a_direct_command_is_the_wrench_over_its_gain() -> None:
    throttle = Drive(Direct("throttle", "X", gain=2.0, n_max=1.0, n_min=0.0))
    assert (throttle.command(1.5), throttle.command(9.0), throttle.command(-1.0)) == (0.75, 1.0, 0.0)
    assert throttle.thrust(0.75) == 1.5


def test_water_from_ahead_takes_thrust_away() -> None:
    # thesis (2.4): tau = T_nn n |n| - T_nu |n| u_a, by hand for n = 3, u_a = 0.5
    assert ThrustCurve.bilinear(2.0, 1.0, 0.5).thrust(3.0) == pytest.approx(2.0 * 9.0 - 3.0 * 0.5)
    assert ThrustCurve.bilinear(2.0, 1.0, 0.5).thrust(-3.0) == pytest.approx(-2.0 * 9.0 - 3.0 * 0.5)
    # u_a = (1 - u_wake) U with U = sqrt(u^2 + v^2), thesis (2.5), (2.6)
    assert ambient_speed(0.3, -0.4, 0.2) == pytest.approx(0.4)


def test_a_drive_knows_the_speed_only_where_it_matters() -> None:
    propeller = Thruster("p", 0.0, 0.0, 0.0, BilinearThrust(2.0, 1.0, wake=0.2), n_max=10.0)
    assert Drive(propeller).at(0.5).thrust(3.0) == pytest.approx(18.0 - 3.0 * 0.4)
    same = drive()
    assert same.at(0.5) is same


def test_propeller_torque_adds_up_with_one_hand_and_cancels_with_two() -> None:
    # thesis (2.4) and Fig. 2.4: q = q1 + q2 (a), q = q1 - q2 (b)
    q = torque(4.0, 0.5, Q_nn=0.3, Q_nu=0.2)
    assert q == pytest.approx(0.3 * 16.0 - 0.2 * 4.0 * 0.5)
    assert torque(-4.0, 0.0, 0.3, 0.2) == pytest.approx(-4.8)
    assert hull_torque([(q, 1), (q, 1)]) == pytest.approx(2.0 * q)
    assert hull_torque([(q, 1), (q, -1)]) == 0.0


def test_quadratic_and_then_straight_is_continuous() -> None:
    # the later PlaDyPos map: 1.894 n^2 below 0.23, straight above (the slope is chosen here)
    side = Side(1.894, 0.0, knee=0.23, slope=0.9)
    assert side.thrust(0.23) == pytest.approx(0.1001926)
    assert side.thrust(0.23 + 1e-9) == pytest.approx(side.thrust(0.23), abs=1e-8)
    assert side.thrust(1.0) == pytest.approx(0.1001926 + 0.9 * 0.77)


@pytest.mark.parametrize(
    "wrong", [(0.0, 0.0), (-1.0, 0.0), (math.nan, 0.0), (1.0, 0.0, 2.0, 0.0), (1.0, 0.0, 0.0, 1.0), (0.0, -1.0)]
)
def test_a_curve_without_inverse_is_refused(wrong: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="thrust characteristic"):
        Side(*wrong)


def test_a_lag_is_exact_in_any_steps() -> None:
    once = lagged(1.0, 5.0, 0.3, 0.2)
    assert once == pytest.approx(5.0 - 4.0 * math.exp(-1.5))
    assert lagged(lagged(1.0, 5.0, 0.1, 0.2), 5.0, 0.2, 0.2) == pytest.approx(once)
    assert lagged(1.0, 5.0, 0.1, 0.0) == 5.0


STALL = math.radians(25.0)


def test_rudder_keeps_both_printed_laws_and_has_no_jump() -> None:
    # thesis (2.9), corrected (docs/errata.md)
    assert normal_part(STALL, STALL) == pytest.approx(1.0)
    assert normal_part(0.5 * STALL, STALL) == pytest.approx(math.sin(math.pi / 4))
    assert normal_part(math.radians(50.0), STALL) == pytest.approx(math.sin(math.radians(50.0)))
    end = stall_end(STALL)
    assert math.degrees(end) == pytest.approx(39.13, abs=0.01)
    for a in (STALL, end):
        assert normal_part(a - 1e-9, STALL) == pytest.approx(normal_part(a + 1e-9, STALL), abs=1e-7)
    steps = [normal_part(math.radians(d / 10), STALL) for d in range(-900, 901)]
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) < 0.01
    assert steps == pytest.approx([-s for s in reversed(steps)])


def test_rudder_force_flow_and_small_angles() -> None:
    assert flow_squared(0.5, 4.0, 0.1) == pytest.approx(0.65)  # thesis (2.10)
    assert flow_squared(0.1, -4.0, 0.1) == 0.0
    v2 = flow_squared(0.5, 4.0, 0.1)
    k_f = 3.0 * math.pi / (2.0 * STALL)  # thesis (2.11)
    assert force(0.01, v2, 3.0, STALL) == pytest.approx(k_f * v2 * 0.01, rel=1e-3)
    assert linear_force(-0.2, 3.0, 0.5, 2.0, 0.7) == pytest.approx((2.0 * 0.25 + 0.7 * 9.0) * -0.2)  # thesis (2.12)
    assert attack_angle(0.3, 1.0, 0.1, 0.2, 2.0) == pytest.approx(0.3 - math.atan(0.5))
    assert attack_angle(0.3, 0.0, 0.0, 0.0, 2.0) == 0.3


@pytest.mark.parametrize("delta", [-0.43, -0.1, 0.0, 0.2, 0.436])
def test_rudder_angle_inverts_the_force_below_stall(delta: float) -> None:
    assert angle(force(delta, 0.7, 3.0, STALL), 0.7, 3.0, STALL) == pytest.approx(delta, abs=1e-12)


def test_rudder_without_flow_or_beyond_its_force_is_bounded() -> None:
    assert angle(1.0, 0.0, 3.0, STALL) == 0.0
    assert angle(99.0, 0.7, 3.0, STALL) == pytest.approx(STALL)
