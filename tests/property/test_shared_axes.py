"""The contract of every law when another source has some of its axes: a new file in marine/control is tested, too."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marine.allocation import axis_limits
from marine.control.base import ZERO, ControlLaw, Reference, Vector3
from marine.control.laws import known_laws
from marine.control.tracking import missing_of
from marine.dynamics.uncoupled import UncoupledModel
from marine.frames import wrap_angle
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")
X, Y, _, _, _, N = axis_limits(PLADYPOS)
LIMITS = (X, Y, N)
DT_S = 1.0 / 30.0
OURS = [o for o in itertools.product((True, False), repeat=3) if any(o) and not all(o)]
LAWS = known_laws()
every_law = pytest.mark.parametrize("name", LAWS)
every_positioning_law = pytest.mark.parametrize("name", [n for n in LAWS if LAWS[n].serves == "positioning"])
every_share = pytest.mark.parametrize("ours", OURS, ids=lambda o: "".join("XYN"[i] for i in range(3) if o[i]))


def made(name: str) -> ControlLaw:
    law = LAWS[name]
    return law.for_vessel(law.Parameters(), PLADYPOS, LIMITS)


class Shared:
    """A vessel of which a law has some axes and a stick the others; the law's reference there is where it is."""

    def __init__(self, law: ControlLaw, ours: tuple[bool, bool, bool], push: Vector3) -> None:
        self.law, self.ours, self.push = law, ours, push
        self.water, self.state = UncoupledModel(PLADYPOS.model), (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
        self.demand: Vector3 = ZERO
        self.given: Vector3 = ZERO
        law.follow(self.state[:3], ZERO, ZERO)
        self.demand = law.step(0.0, Reference(self.state[:3]), self.state[:3], ZERO, ZERO)

    def run(self, seconds: float, stick: Vector3, target: Vector3) -> None:
        for _ in range(round(seconds / DT_S)):
            eta, nu = self.state[:3], self.state[3:]
            wanted = tuple(t if mine else e for t, e, mine in zip(target, eta, self.ours, strict=True))
            missing = missing_of(self.demand, self.given, ZERO, self.ours)
            disturbance = ZERO if self.law.integral else self.push
            self.demand = self.law.step(
                DT_S, Reference((wanted[0], wanted[1], wanted[2])), eta, nu, missing, disturbance
            )
            self.given = tuple(  # type: ignore[assignment]
                d if mine else s for d, s, mine in zip(self.demand, stick, self.ours, strict=True)
            )
            x, y, psi, u, v, r = self.water.step(self.state, DT_S, self.given, disturbance=self.push)
            self.state = (x, y, wrap_angle(psi), u, v, r)


def law_demand(loop: Shared) -> Vector3:
    """Return the demand before the limits cut it."""
    cut = loop.law._cut
    return tuple(d - c for d, c in zip(loop.demand, cut, strict=True))  # type: ignore[return-value]


@every_law
def test_the_heading_is_kept_against_a_moment_while_the_stick_has_the_place(name: str) -> None:
    """What engaging the law anew at each step did, as the controller did once, broke: the integral of LQR."""
    loop = Shared(made(name), (False, False, True), (0.1, -0.1, 0.02))
    loop.run(25.0, (0.8, -0.5, 9.0), (0.0, 0.0, 0.4))
    assert abs(wrap_angle(loop.state[2] - 0.4)) < 5e-3
    assert math.hypot(*loop.state[3:5]) > 0.05, "the stick drives"


@every_positioning_law
def test_the_place_is_kept_while_the_stick_turns(name: str) -> None:
    loop = Shared(made(name), (True, True, False), ZERO)
    loop.run(20.0, (0.0, 0.0, 0.05), (1.1, 0.9, 0.0))
    assert math.dist(loop.state[:2], (1.1, 0.9)) < 0.02
    assert abs(loop.state[5]) > 0.1, "the stick turns it"


@every_law
@every_share
def test_nothing_winds_up_on_the_axes_of_others(name: str, ours: tuple[bool, bool, bool]) -> None:
    law, stick = made(name), (0.6 * X, -0.3 * Y, 0.0)
    loop = Shared(law, ours, ZERO)
    loop.run(15.0, stick, loop.state[:3])
    lag = [abs(d - g) for d, g in zip(law_demand(loop), loop.given, strict=True)]
    loop.run(10.0, stick, loop.state[:3])
    later = [abs(d - g) for d, g in zip(law_demand(loop), loop.given, strict=True)]
    assert all(b < a + 0.2 * limit for a, b, limit in zip(lag, later, LIMITS, strict=True)), "what it lags is settled"
    loop.ours = (True, True, True)  # as the controller does it when axes come back
    law.follow(loop.state[:3], loop.state[3:], loop.given)
    back = law.step(0.0, Reference(loop.state[:3]), loop.state[:3], loop.state[3:], ZERO)
    assert back == pytest.approx(loop.given, abs=1e-9)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_on_our_axes_only_the_limits_count_on_others_all_that_came(demand: Vector3, given_: Vector3) -> None:
    short = (0.1, 0.2, 0.3)
    assert missing_of(demand, given_, short, (True, True, True)) == short
    got = missing_of(demand, given_, short, (False, True, False))
    assert got == pytest.approx((given_[0] - demand[0], 0.2, given_[2] - demand[2]))
