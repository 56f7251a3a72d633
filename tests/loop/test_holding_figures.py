"""Issue 7's numbers of holding, against the truth; `starboard bench holding` measures all of them with pictures."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.hold import step_figures
from benchmarks.holding import BAND_M, LIMIT_MM, VARYING, Star, errors
from tests.star import build_star

CURRENT = {"current_x_m_s": 0.05, "current_std_m_s": 0.0}


def test_in_a_constant_current_with_pictures_and_radio(tmp_path: Path) -> None:
    star = Star(tmp_path, seed=1, simulator=CURRENT)
    place = (2.0, 1.8, 0.5)
    star.hold(*place)
    star.bus.run_for(18.0)
    distance_mm, angle_deg = errors(star, 8.0, place)
    star.bus.stop("simulator")
    assert distance_mm <= LIMIT_MM
    assert angle_deg <= 0.2


def test_in_a_varying_current() -> None:
    star = build_star(simulator={**CURRENT, **VARYING})
    place = (2.0, 1.8, 0.5)
    star.hold(*place)
    star.bus.run_for(20.0)
    since_s = star.bus.now_s
    star.bus.run_for(60.0)
    distance_m, angle_rad = star.rms_error(*place, since_s)
    assert distance_m <= 5e-3
    assert math.degrees(angle_rad) <= 0.5


@pytest.mark.parametrize("psi_rad", [0.0, 2.4])
def test_displaced_it_comes_back_and_a_step_hardly_overshoots(psi_rad: float) -> None:
    star = build_star(simulator=CURRENT)
    star.hold(2.0, 1.8, psi_rad)
    star.bus.run_for(15.0)
    begin_s, away = star.bus.now_s, psi_rad + 0.7
    star.fault("displace", x_m=0.5 * math.cos(away), y_m=0.5 * math.sin(away))
    star.bus.run_for(20.0)
    poses = [t for t in star.truth if t.stamp_ns * 1e-9 >= begin_s]
    assert max(math.hypot(t.x_m - 2.0, t.y_m - 1.8) for t in poses) > 0.45
    late = [t for t in poses if t.stamp_ns * 1e-9 >= begin_s + 15.0]
    assert max(math.hypot(t.x_m - 2.0, t.y_m - 1.8) for t in late) <= BAND_M
    begin_s = star.bus.now_s
    star.hold(3.0, 1.8, psi_rad)
    star.bus.run_for(25.0)
    response = [(t.stamp_ns * 1e-9, t.x_m) for t in star.truth if t.stamp_ns * 1e-9 >= begin_s]
    assert step_figures(response, 2.0, 3.0)[0] <= 0.05
    assert abs(response[-1][1] - 3.0) <= BAND_M
