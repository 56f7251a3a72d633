import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marine.allocation import axis_limits
from marine.frames import wrap_angle
from marine.guidance.reference_filter import MotionLimits, ReferenceFilter, terminal_speed
from marine.vessel import DegreeOfFreedom
from services.vessels import load_vessel

LIMITS = MotionLimits(0.25, 0.05, 1.0, 0.8, 1.0)
DT = 1.0 / 30.0
metres = st.floats(-4.0, 4.0)
poses = st.tuples(metres, metres, st.floats(-math.pi, math.pi, exclude_min=True))


@given(st.lists(st.tuples(poses, st.integers(1, 120)), min_size=1, max_size=6), st.sampled_from([0.01, DT, 0.2]))
def test_limits_hold_whatever_the_target_does(targets: list[tuple[tuple[float, float, float], int]], dt: float) -> None:
    shaped = ReferenceFilter(LIMITS)
    shaped.start((0.0, 0.0, 3.0), (0.1, 0.0, 0.0))
    for target, steps in targets:
        for _ in range(steps):
            before = shaped.eta
            shaped.step(dt, target)
            assert math.hypot(*shaped.rate[:2]) <= LIMITS.speed_m_s * (1.0 + 1e-9)
            assert math.hypot(*shaped.acceleration[:2]) <= LIMITS.acceleration_m_s2 * (1.0 + 1e-6)
            assert abs(shaped.rate[2]) <= LIMITS.yaw_rate_rad_s * (1.0 + 1e-9)
            assert abs(shaped.acceleration[2]) <= LIMITS.yaw_acceleration_rad_s2 * (1.0 + 1e-6)
            assert shaped.eta[0] - before[0] == pytest.approx(shaped.rate[0] * dt, abs=1e-9)
            assert -math.pi < shaped.eta[2] <= math.pi


@given(poses)
def test_from_rest_it_arrives_without_overshoot_on_the_straight_line(target: tuple[float, float, float]) -> None:
    shaped = ReferenceFilter(LIMITS)
    shaped.start((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    turn = wrap_angle(target[2] - 1.0)
    for _ in range(int(60.0 / DT)):
        shaped.step(DT, target)
        x, y, psi = shaped.eta
        assert x * target[0] + y * target[1] <= (target[0] ** 2 + target[1] ** 2) * (1.0 + 1e-3) + 1e-9
        assert abs(x * target[1] - y * target[0]) < 1e-6
        assert wrap_angle(psi - 1.0) * math.copysign(1.0, turn) <= abs(turn) * (1.0 + 1e-3) + 1e-9 or abs(turn) > 3.1
    assert shaped.eta[:2] == pytest.approx(target[:2], abs=1e-3)
    assert abs(wrap_angle(shaped.eta[2] - target[2])) < 1e-3 or abs(turn) > 3.1


def test_a_motion_ends_on_its_target_and_the_next_begins_there() -> None:
    shaped, target = ReferenceFilter(LIMITS), (1.0, -0.5, 2.0 * math.pi - 1.0)
    shaped.start((0.0, 0.0, 1.0), (0.1, 0.0, 0.3))
    for _ in range(int(40.0 / DT)):
        before = shaped.eta
        shaped.step(DT, target)
        assert math.dist(shaped.eta[:2], before[:2]) <= math.hypot(*shaped.rate[:2]) * DT + 1e-9
    assert shaped.eta == (1.0, -0.5, wrap_angle(target[2]))
    assert shaped.rate == shaped.acceleration == (0.0, 0.0, 0.0)
    shaped.step(DT, (2.0, -0.5, -1.0))
    assert 0.0 < shaped.eta[0] - 1.0 == pytest.approx(shaped.rate[0] * DT, rel=1e-6)
    shaped.step(DT, target)
    assert shaped.rate[0] != 0.0, "it was moving: it cannot stop at once"


@pytest.mark.parametrize("passing", [(0.25, 0.0, 0.0), (0.0, 0.0, 0.5)])
def test_one_that_only_passes_its_target_goes_on(passing: tuple[float, float, float]) -> None:
    shaped = ReferenceFilter(LIMITS)
    shaped.start((0.0, 0.0, 0.0), passing)
    ahead = tuple(0.5 * rate / LIMITS.approach_1_s for rate in passing)  # where the lag lets it be at the target
    shaped.step(DT, (ahead[0], ahead[1], ahead[2]))
    assert math.hypot(*shaped.rate) > 0.1


def test_limits_of_a_vessel_take_no_more_than_the_share() -> None:
    vessel = load_vessel("pladypos")
    X, Y, _, _, _, N = axis_limits(vessel)
    limits = MotionLimits.of_vessel(vessel.model, (X, Y, N), 0.5, 1.0)
    assert vessel.model.surge.drag(limits.speed_m_s) == pytest.approx(0.5 * X)
    assert vessel.model.yaw.drag(limits.yaw_rate_rad_s) == pytest.approx(0.5 * N)
    assert limits.acceleration_m_s2 * vessel.model.surge.alpha == pytest.approx(0.5 * X)
    shaped = ReferenceFilter(limits)
    most = 0.0
    for _ in range(600):
        shaped.step(DT, (3.0, 0.0, 0.0))
        surge = vessel.model.surge
        most = max(most, surge.alpha * shaped.acceleration[0] + surge.drag(shaped.rate[0]))
    assert 0.4 * X < most <= 0.55 * X


@pytest.mark.parametrize(
    "dof", [DegreeOfFreedom(1.0, 2.0, 0.0), DegreeOfFreedom(1.0, 0.0, 3.0), DegreeOfFreedom(1.0, 2.0, 3.0)]
)
def test_terminal_speed(dof: DegreeOfFreedom) -> None:
    assert dof.drag(terminal_speed(dof, 0.7)) == pytest.approx(0.7)
    assert terminal_speed(DegreeOfFreedom(1.0, 0.0, 0.0), 1.0) == math.inf


def test_limits_that_are_not_positive_are_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        ReferenceFilter(MotionLimits(0.2, 0.0, 1.0, 1.0, 1.0))
