import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from marine.control.base import ZERO, Vector3
from marine.control.positioning import Positioning
from marine.frames import to_body, wrap_angle
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
metres = st.floats(-5.0, 5.0)
angles = st.floats(-math.pi, math.pi, exclude_min=True)
etas = st.tuples(metres, metres, angles)
nus = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0))
taus = st.tuples(st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(-1.1, 1.1))


def law() -> Positioning:
    return Positioning(PLADYPOS.model, PLADYPOS.hold_w0_rad_s)


@given(etas, nus, taus, etas)
def test_engaging_does_not_jump_whatever_the_state_and_reference(
    eta: Vector3, nu: Vector3, tau: Vector3, reference: Vector3
) -> None:
    positioning = law()
    positioning.step(0.03, ZERO, (1.0, 1.0, 1.0), ZERO, ZERO)  # some past, to be forgotten
    positioning.follow(eta, nu, tau)
    assert positioning.step(0.0, reference, eta, nu, ZERO) == pytest.approx(tau, abs=1e-9)


@given(etas)
def test_at_rest_on_the_reference_nothing_is_demanded(eta: Vector3) -> None:
    positioning = law()
    positioning.follow(eta, ZERO, ZERO)
    for _ in range(5):
        assert positioning.step(0.03, eta, eta, ZERO, ZERO) == pytest.approx(ZERO, abs=1e-12)
    assert positioning.error == pytest.approx(ZERO, abs=1e-12)


@given(etas, etas, nus, taus, etas)
def test_a_whole_turn_changes_nothing(eta: Vector3, then: Vector3, nu: Vector3, tau: Vector3, ref: Vector3) -> None:
    moved_psi, error_psi = wrap_angle(then[2] - eta[2]), wrap_angle(ref[2] - then[2])
    assume(max(abs(moved_psi), abs(error_psi)) < math.pi - 1e-6)  # at pi the shorter way is anyone's guess
    demands = []
    for turn in (0.0, 2.0 * math.pi):
        positioning = law()
        positioning.follow(eta, nu, tau)
        turned, behind = (*then[:2], then[2] + turn), (*ref[:2], ref[2] - turn)
        demands.append(positioning.step(0.03, behind, turned, nu, ZERO))
    assert demands[0] == pytest.approx(demands[1], abs=1e-9)


def test_passing_pi_is_smooth() -> None:
    demands = []
    for centre in (0.0, math.pi):
        positioning = law()
        positioning.follow((0.0, 0.0, wrap_angle(centre - 0.01)), ZERO, ZERO)
        then = (0.0, 0.0, wrap_angle(centre + 0.01))
        demands.append(positioning.step(0.03, (0.0, 0.0, wrap_angle(centre + 0.02)), then, ZERO, ZERO)[2])
    assert demands[0] == pytest.approx(demands[1], abs=1e-12)
    assert demands[0] < 0.0  # the reference acts through the integral, the position at once


@given(etas, etas, taus, angles)
def test_what_the_integral_holds_stays_in_the_tank_when_the_vessel_turns(
    eta: Vector3, reference: Vector3, tau: Vector3, heading: float
) -> None:
    positioning = law()
    positioning.follow(eta, ZERO, tau)
    held = positioning.action
    tau_turned = positioning.step(0.0, reference, (eta[0], eta[1], heading), ZERO, ZERO)
    expected = to_body(held[0], held[1], heading)  # surge and sway have one inertia
    assert tau_turned[:2] == pytest.approx(expected, abs=1e-9)


@given(st.lists(st.tuples(etas, nus, taus, st.floats(0.0, 0.25)), min_size=1, max_size=30))
def test_output_is_finite_whatever_comes(rounds: list[tuple[Vector3, Vector3, Vector3, float]]) -> None:
    positioning = law()
    for eta, nu, missing, dt_s in rounds:
        tau = positioning.step(dt_s, ZERO, eta, nu, missing)
        assert all(map(math.isfinite, (*tau, *positioning.error, *positioning.action)))
