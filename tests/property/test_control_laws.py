"""The contract of every law in marine/control: a new file is tested here without being named."""

import copy
import functools
import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import signal

from marine.allocation import axis_limits
from marine.control.base import ZERO, ControlLaw, Reference, Vector3
from marine.control.laws import known_laws
from marine.control.lqr import lqr_design
from marine.control.positioning import Positioning, PositioningParameters
from marine.dynamics.uncoupled import UncoupledModel
from marine.frames import to_body, wrap_angle
from marine.vessel import DegreeOfFreedom
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
_X, _Y, _, _, _, _N = axis_limits(PLADYPOS)
LIMITS = (_X, _Y, _N)
LAWS = known_laws()
metres = st.floats(-5.0, 5.0)
angles = st.floats(-math.pi, math.pi, exclude_min=True)
etas = st.tuples(metres, metres, angles)
nus = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0))
taus = st.tuples(st.floats(-_X, _X), st.floats(-_Y, _Y), st.floats(-_N, _N))
rates = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-1.0, 1.0))
references = st.builds(Reference, etas, rates, rates)
dts = st.floats(0.0, 0.25)
every_law = pytest.mark.parametrize("name", LAWS)
every_positioning_law = pytest.mark.parametrize("name", [n for n in LAWS if LAWS[n].serves == "positioning"])


@functools.cache
def _designed(name: str) -> ControlLaw:
    law = LAWS[name]
    return law.for_vessel(law.Parameters(), PLADYPOS, LIMITS)


def made(name: str) -> ControlLaw:
    """A new law: a copy, for a design takes ten times as long as the rest of an example."""
    return copy.deepcopy(_designed(name))


@every_law
@given(rounds=st.lists(st.tuples(references, etas, nus, taus, taus, dts), min_size=1, max_size=20))
def test_output_is_finite_and_within_the_limits(
    name: str, rounds: list[tuple[Reference, Vector3, Vector3, Vector3, Vector3, float]]
) -> None:
    law = made(name)
    for reference, eta, nu, missing, disturbance, dt_s in rounds:
        tau = law.step(dt_s, reference, eta, nu, missing, disturbance)
        assert all(map(math.isfinite, (*tau, *law.error, *law.action)))
        assert all(abs(t) <= limit for t, limit in zip(tau, LIMITS, strict=True))


@every_law
@given(eta=etas)
def test_at_rest_on_the_reference_nothing_is_demanded(name: str, eta: Vector3) -> None:
    law = made(name)
    law.follow(eta, ZERO, ZERO)
    for _ in range(5):
        assert law.step(0.03, Reference(eta), eta, ZERO, ZERO) == pytest.approx(ZERO, abs=1e-9)
    assert law.error == pytest.approx(ZERO, abs=1e-12)


@every_law
@given(eta=etas, nu=nus, tau=taus, reference=references, disturbance=taus)
def test_engaging_does_not_jump(  # noqa: PLR0917
    name: str, eta: Vector3, nu: Vector3, tau: Vector3, reference: Reference, disturbance: Vector3
) -> None:
    law = made(name)
    law.follow(eta, nu, tau)
    assert law.step(0.0, reference, eta, nu, ZERO, disturbance) == pytest.approx(tau, abs=1e-9)


@every_law
@given(eta=etas, nu=nus, tau=taus, reference=references, past=references, there=etas)
def test_following_forgets_the_past(  # noqa: PLR0917
    name: str, eta: Vector3, nu: Vector3, tau: Vector3, reference: Reference, past: Reference, there: Vector3
) -> None:
    fresh, used = made(name), made(name)
    for _ in range(3):
        used.step(0.1, past, there, ZERO, (0.3, 0.1, -0.2), (1.0, 0.0, 0.0))
    demands = []
    for law in (fresh, used):
        law.follow(eta, nu, tau)
        demands.append([law.step(dt, reference, eta, nu, ZERO) for dt in (0.0, 0.03, 0.2)])
    assert demands[0] == demands[1]


@every_law
@given(eta=etas, then=etas, nu=nus, tau=taus, target=etas)
def test_a_whole_turn_changes_nothing(  # noqa: PLR0917
    name: str, eta: Vector3, then: Vector3, nu: Vector3, tau: Vector3, target: Vector3
) -> None:
    turns = [wrap_angle(a[2] - b[2]) for a, b in ((then, eta), (target, then), (target, eta))]
    assume(max(map(abs, turns)) < math.pi - 1e-6)  # at pi the shorter way is anyone's guess
    demands = []
    for turn in (0.0, 2.0 * math.pi):
        law = made(name)
        law.follow(eta, nu, tau)
        law.step(0.0, Reference(target), eta, nu, ZERO)
        turned, behind = (*then[:2], then[2] + turn), (*target[:2], target[2] - turn)
        demands.append(law.step(0.03, Reference(behind), turned, nu, ZERO))
    assert demands[0] == pytest.approx(demands[1], abs=1e-9)


@every_law
@pytest.mark.parametrize("turn", [-0.3, 0.02])
def test_passing_pi_is_as_passing_zero(name: str, turn: float) -> None:
    tracks = []
    for centre in (0.0, math.pi):
        law = made(name)
        heading, yaw = [wrap_angle(centre + k * turn / 10.0) for k in range(-5, 6)], []
        law.follow((0.0, 0.0, heading[0]), ZERO, ZERO)
        for psi in heading:
            reference = Reference((0.0, 0.0, wrap_angle(centre + 0.4 * turn)))
            yaw.append(law.step(0.03, reference, (0.0, 0.0, psi), (0.0, 0.0, turn / 3.0), ZERO)[2])
        tracks.append(yaw)
    assert tracks[0] == pytest.approx(tracks[1], abs=1e-9)


@every_positioning_law
def test_pulls_towards_the_reference_and_arrives(name: str) -> None:
    law, water = made(name), UncoupledModel(PLADYPOS.model)
    state = (1.0, 1.0, 3.0, 0.0, 0.0, 0.0)
    pushed = (0.2, -0.1, 0.01)  # in {E}; laws without an integral are told
    law.follow(state[:3], ZERO, ZERO)
    tau, target = ZERO, Reference((1.3, 0.8, -3.0))
    for _ in range(int(40.0 / 0.033)):
        tau = law.step(0.033, target, state[:3], state[3:], ZERO, ZERO if law.integral else pushed)
        x, y, psi, u, v, r = water.step(state, 0.033, tau, disturbance=pushed)
        state = (x, y, wrap_angle(psi), u, v, r)
    assert state[:2] == pytest.approx(target.eta[:2], abs=2e-3)
    assert state[2] == pytest.approx(target.eta[2], abs=2e-3)
    against = to_body(*law.action[:2], state[2])
    assert (*against, law.action[2]) == pytest.approx(tau, abs=0.02)  # at rest the action is all of it
    assert law.action == pytest.approx((-0.2, 0.1, -0.01), abs=0.02)


@every_law
@pytest.mark.parametrize("axis", range(3))
def test_on_its_true_model_it_is_the_closed_loop_that_was_designed(name: str, axis: int) -> None:
    """Issue 7: within 2 %, zeros included, unsaturated; of laws that are made of loops (`designs`)."""
    law, water, size, dt = made(name), UncoupledModel(PLADYPOS.model), 0.02, 0.005
    if not hasattr(law, "designs"):
        pytest.skip("not made of loops of Table 8.1")
    if law.designs[axis].gains.proportional == 0.0:
        pytest.skip("steers only")
    tf = law.designs[axis].transfer_function()
    law.follow(ZERO, ZERO, ZERO)
    law.step(0.0, Reference(ZERO), ZERO, ZERO, ZERO)
    state, track = (0.0,) * 6, []
    target = Reference((size if axis == 0 else 0.0, size if axis == 1 else 0.0, size if axis == 2 else 0.0))
    for _ in range(4000):
        tau = law.step(dt, target, state[:3], state[3:], ZERO)
        assert all(abs(t) < limit for t, limit in zip(tau, LIMITS, strict=True))
        state = water.step(state, dt, tau)
        track.append(state[axis] / size)
    _, expected = signal.step((tf.numerator, tf.denominator), T=dt * np.arange(1, 4001))
    assert np.abs(np.array(track) - expected).max() < 0.02


@every_law
@given(data=st.data())
@settings(max_examples=20)
def test_laws_are_exchanged_without_a_jump(name: str, data: st.DataObject) -> None:
    other = made(data.draw(st.sampled_from(sorted(LAWS))))
    law, eta, nu, reference = made(name), data.draw(etas), data.draw(nus), data.draw(references)
    law.follow(eta, nu, ZERO)
    for _ in range(10):
        tau = law.step(0.1, reference, eta, nu, ZERO)
    other.follow(eta, nu, tau)
    assert other.step(0.0, reference, eta, nu, ZERO) == pytest.approx(tau, abs=1e-9)


# Of the I-PD law alone


@given(etas, etas, taus, angles)
def test_what_the_integral_holds_stays_in_the_tank_when_the_vessel_turns(
    eta: Vector3, target: Vector3, tau: Vector3, heading: float
) -> None:
    tau = (0.5 * tau[0], 0.5 * tau[1], tau[2])
    law = made("ipd")
    law.follow(eta, ZERO, tau)
    law.step(0.0, Reference(target), eta, ZERO, ZERO)
    held = law.action
    turned = law.step(0.0, Reference(target), (eta[0], eta[1], heading), ZERO, ZERO)
    expected = to_body(held[0], held[1], heading)  # surge and sway have one inertia
    assert turned[:2] == pytest.approx(expected, abs=1e-9)


def test_other_gains_take_over_without_a_jump_and_go_on_holding() -> None:
    def positioning(w0: float) -> Positioning:
        return Positioning.for_vessel(PositioningParameters(w0_rad_s=w0), PLADYPOS, LIMITS)

    law, water = positioning(0.4), UncoupledModel(PLADYPOS.model)
    state, target, tau, furthest = (1.0, 1.0, 0.5, 0.0, 0.0, 0.0), Reference((1.0, 1.0, 0.5)), ZERO, 0.0
    law.follow(state[:3], ZERO, ZERO)
    for k in range(2400):
        if k == 1200:
            before, law = tau, positioning(0.9)
            law.follow(state[:3], state[3:], tau)
            assert law.step(0.0, target, state[:3], state[3:], ZERO) == pytest.approx(before, abs=1e-9)
        tau = law.step(0.033, target, state[:3], state[3:], ZERO)
        x, y, psi, u, v, r = water.step(state, 0.033, tau, disturbance=(0.4, 0.0, 0.0))
        state = (x, y, wrap_angle(psi), u, v, r)
        furthest = max(furthest, math.hypot(x - 1.0, y - 1.0)) if k > 1200 else 0.0
    assert furthest < 1e-3


sizes = st.floats(1e-2, 1e2)


@given(alpha=sizes, limit=sizes, size=sizes, integral_size=sizes)
def test_the_regulators_gains_solve_riccatis_equation(
    alpha: float, limit: float, size: float, integral_size: float
) -> None:
    gains = lqr_design(DegreeOfFreedom(alpha, 0.0, 0.0), limit, size, integral_size).gains
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    B = np.array([[0.0], [0.0], [1.0 / alpha]])
    Q, R = np.diag([1.0 / integral_size**2, 1.0 / size**2, 0.0]), np.array([[1.0 / limit**2]])
    K = np.linalg.solve(R, B.T @ scipy.linalg.solve_continuous_are(A, B, Q, R))[0]
    assert (gains.integral, gains.proportional, gains.derivative) == pytest.approx(tuple(K), rel=1e-6)


@given(w0=st.floats(0.2, 2.0), yaw_w0=st.floats(0.2, 2.0))
def test_heading_may_have_a_frequency_of_its_own(w0: float, yaw_w0: float) -> None:
    surge, _, yaw = Positioning.for_vessel(PositioningParameters("bessel", w0, yaw_w0), PLADYPOS, LIMITS).designs
    assert surge.gains.integral / surge.model.alpha == pytest.approx(w0**3)
    assert yaw.gains.integral / yaw.model.alpha == pytest.approx(yaw_w0**3)
