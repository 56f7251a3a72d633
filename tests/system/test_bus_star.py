"""The holding vessel does not notice that a hub is gone."""

import pytest

from benchmarks.hub_fail_over import AFTER_S, draw, run

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


def test_a_holding_vessel_does_not_notice_that_the_hub_dies_and_the_standby_hangs() -> None:
    result = run()
    steady_mm = max(result.largest_error_mm(0.0, result.killed_s), 2.5)
    assert result.largest_error_mm(result.killed_s, result.held_s + AFTER_S) < 2 * steady_mm
    assert result.longest_interval_ms(result.killed_s, result.held_s) < 250
    assert result.longest_interval_ms(result.held_s, result.held_s + AFTER_S) < 1000
    assert draw(result).startswith("<svg")
