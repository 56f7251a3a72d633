"""What is fed forward beside an integral: what changes, not what lasts."""

import math

import pytest

from marine.control.base import ZERO
from marine.control.washout import Washout


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
