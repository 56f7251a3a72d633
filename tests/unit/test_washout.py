"""What is fed forward beside an integral: what changes, not what lasts."""

import math

import pytest

from marine.control.base import ZERO
from marine.control.feed_forward import FeedForward
from marine.control.laws import known_laws
from marine.control.washout import Washout
from services.tuning import horizontal_limits
from services.vessels import load_vessel


def test_a_step_passes_and_fades_with_its_time() -> None:
    washout, dt_s = Washout(2.0), 0.01
    washout.start((1.0, 0.0, 0.0))
    assert washout.step(0.0, (1.0, 0.0, 0.0)) == ZERO
    news = [washout.step(dt_s, (1.5, 0.0, -0.2)) for _ in range(600)]
    assert news[0] == pytest.approx((0.5, 0.0, -0.2), rel=0.01)
    for t_s in (1.0, 2.0, 4.0):
        left = math.exp(-t_s / 2.0)
        assert news[round(t_s / dt_s)] == pytest.approx((0.5 * left, 0.0, -0.2 * left), rel=0.02)


def test_after_a_long_gap_it_begins_anew() -> None:
    washout = Washout(2.0)
    assert washout.step(60.0, (0.3, 0.2, 0.1)) == ZERO


@pytest.mark.parametrize("name", ["ipd", "p_d"])
def test_a_law_without_an_integral_gets_what_lasts_too(name: str) -> None:
    vessel, kind = load_vessel("pladypos"), known_laws()[name]
    law = kind.for_vessel(kind.Parameters(), vessel, horizontal_limits(vessel))
    fed, lasting = FeedForward(2.0), (1.0, 0.0, 0.1)
    fed.start(lasting)
    assert fed.step(law, 0.1, lasting) == (ZERO if law.integral else lasting)
    assert fed.step(law, 0.0, (1.5, 0.0, 0.1)) == ((0.5, 0.0, 0.0) if law.integral else (1.5, 0.0, 0.1))
