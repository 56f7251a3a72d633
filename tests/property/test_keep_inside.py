"""The guard before the walls, by itself: when it acts, in which direction, and what it leaves of the rest."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marine.allocation import axis_limits
from marine.control.base import ZERO, Vector3
from marine.frames import to_tank
from marine.guidance.abilities import yaw_limit_at
from marine.guidance.keep_inside import GAP_M, PoolGuard
from services.vessels import known_vessels, load_vessel

PLADYPOS, CHARLIE = load_vessel("pladypos"), load_vessel("charlie")
GUARD = PoolGuard(PLADYPOS)
X, Y, _, _, _, N = axis_limits(PLADYPOS)
EXACT = (0.0, 0.0)
angles = st.floats(-math.pi, math.pi)
taus = st.tuples(st.floats(-X, X), st.floats(-Y, Y), st.floats(-N, N))
speeds = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-1.5, 1.5))
inside = st.tuples(st.floats(0.3, 4.7), st.floats(0.3, 3.45), angles)


@pytest.mark.parametrize("name", known_vessels())
def test_braking_by_the_model_ends_before_the_wall(name: str) -> None:
    vessel = load_vessel(name)
    guard, astern = PoolGuard(vessel), name not in ("charlie", "telemetron")
    far = 0.4 * vessel.pool.length_x_m
    speed = min(guard.safe(far)[0], 0.9 * guard.safe(1e9)[0] / 3.0)
    distance, dt_s = far, 0.01
    force = 0.6 * (
        axis_limits(vessel)[0] / math.sqrt(2.0) if vessel.model and axis_limits(vessel)[1] else axis_limits(vessel)[0]
    )
    for _ in range(200_000):
        if speed < 1e-3 or (not astern and speed < 0.055 * guard.safe(1e9)[0] / 3.0):
            break
        slowing = vessel.model.surge.drag(speed) + (force if astern else 0.0)
        speed -= dt_s * slowing / vessel.model.surge.alpha
        distance -= dt_s * max(0.0, speed)
    assert distance > 0.0


def test_safe_speed_grows_with_the_distance_and_is_negative_too_near() -> None:
    rooms = [-0.05, 0.0, 0.01, 0.05, 0.2, 0.5, 1.0, 2.0]
    values = [GUARD.safe(room)[0] for room in rooms]
    assert values == sorted(values)
    assert values[0] < values[1] == 0.0
    for room in rooms[2:]:
        step = 1e-4
        slope = (GUARD.safe(room + step)[0] - GUARD.safe(room - step)[0]) / (2.0 * step)
        assert GUARD.safe(room)[1] == pytest.approx(slope, rel=0.05)


@given(taus, angles)
def test_in_the_middle_at_rest_it_changes_nothing(tau: Vector3, psi: float) -> None:
    assert GUARD.kept(tau, (2.5, 1.875, psi), ZERO, ZERO, EXACT) == (tau, "")


@given(taus, inside, speeds, st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.just(0.0)))
def test_it_never_pushes_more_to_a_wall_and_its_brake_is_attainable(
    tau: Vector3, eta: Vector3, nu: Vector3, push: Vector3
) -> None:
    kept, why = GUARD.kept(tau, eta, nu, push, EXACT)
    if not why:
        assert kept == tau
        return
    before, after = to_tank(tau[0], tau[1], eta[2]), to_tank(kept[0], kept[1], eta[2])
    for axis, name in enumerate("xy"):
        size = (5.0, 3.75)[axis]
        near, far = f"{name} = 0 m" in why, f"{name} = {size:g} m" in why
        if far and not near:
            assert after[axis] <= max(before[axis], 0.0) + 1e-9
        if near and not far:
            assert after[axis] >= min(before[axis], 0.0) - 1e-9
    if sum(abs(t) / limit for t, limit in zip(tau, (X, Y, N), strict=True)) <= 1.0:
        assert sum(abs(t) / limit for t, limit in zip(kept, (X, Y, N), strict=True)) <= 1.0 + 1e-9


@given(angles, st.floats(0.05, 0.3))
def test_before_the_wall_it_brakes_with_all_there_is_whatever_the_stick(psi: float, speed: float) -> None:
    nu = (speed * math.cos(psi), -speed * math.sin(psi), 0.0)  # in +x
    kept, why = GUARD.kept((X, Y, N), (4.7 - GAP_M, 1.875, psi), nu, ZERO, EXACT)
    assert "x = 5 m" in why
    assert to_tank(kept[0], kept[1], psi)[0] < 0.0


def test_an_uncertain_place_is_kept_further_away() -> None:
    eta, tau = (4.6, 1.875, 0.0), (0.3, 0.0, 0.0)
    assert GUARD.kept(tau, eta, ZERO, ZERO, EXACT)[1] == ""
    kept, why = GUARD.kept(tau, eta, ZERO, ZERO, (0.2, 0.2))
    assert why == "before the wall at x = 5 m"
    assert kept[0] < 0.0


def test_a_vessel_that_cannot_push_back_turns_away_while_it_can_and_else_coasts() -> None:
    guard, ahead, steered = PoolGuard(CHARLIE), (60.0, 0.0, 0.0), (60.0, 0.0, 20.0)
    assert guard.kept(steered, (170.0, 75.0, 0.0), (1.0, 0.0, 0.0), ZERO, EXACT) == (steered, "")
    kept, why = guard.kept(ahead, (186.0, 40.0, 0.1), (1.0, 0.0, 0.0), ZERO, EXACT)
    assert why == "before a wall: turning away"
    assert kept[0] == pytest.approx(CHARLIE.model.surge.drag(1.0)), "at this speed: the rudder needs the flow"
    assert kept[2] == pytest.approx(yaw_limit_at(CHARLIE, 1.0), rel=0.15), "to the side that it looks to already"
    late = guard.kept(steered, (194.0, 75.0, 0.0), (1.0, 0.0, 0.0), ZERO, EXACT)
    assert late[0][0] == 0.0, "no way out: it coasts, and turns"
    slow, why = guard.kept(steered, (196.0, 75.0, 0.0), (0.2, 0.0, 0.0), ZERO, EXACT)
    assert why == "before the wall at x = 200 m"
    assert slow == (0.0, 0.0, 20.0), "too slow to turn: it is let coast"
    away = guard.kept(steered, (192.0, 75.0, math.pi), (1.0, 0.0, 0.0), ZERO, EXACT)
    assert away == (steered, "")
