"""Wind, gusts and first-order waves."""

from __future__ import annotations

import itertools
import math
import statistics

import pytest
from scipy.special import j1

from marine.environment import GaussMarkov, WaveField, Waves, Wind, jonswap, wind_wrench

SEA = Waves(height_m=0.4, period_s=3.0, towards_rad=0.5)


def test_significant_height_and_peak_period_are_those_asked_for() -> None:
    field = WaveField(SEA, radius_m=0.0, seed=3)
    heights = [field.elevation(1.0, 2.0, 0.25 * k) for k in range(8000)]
    assert 4.0 * statistics.pstdev(heights) == pytest.approx(0.4, rel=0.03)
    ups = sum(a < 0.0 <= b for a, b in itertools.pairwise(heights))
    assert 2000.0 / ups == pytest.approx(0.78 * 3.0, rel=0.12)  # T_z of JONSWAP, gamma = 3.3: 0.78 T_p


def test_waves_obey_deep_water_dispersion_and_run_where_they_should() -> None:
    field = WaveField(SEA, radius_m=0.0, seed=3)
    _, omega, k, _ = field.components[4]
    assert omega**2 == pytest.approx(9.81 * k)
    field.components = [(0.1, omega, k, 0.3)]
    c, dt = omega / k, 0.7
    there = field.elevation(c * dt * math.cos(0.5), c * dt * math.sin(0.5), dt)
    assert there == pytest.approx(field.elevation(0.0, 0.0, 0.0))


def test_the_water_s_acceleration_is_the_rate_of_its_velocity_and_both_fade_below() -> None:
    field, h = WaveField(SEA, radius_m=0.2, seed=1), 1e-5
    (u, v), (a_x, a_y) = field.water(3.0, 1.0, 7.0)
    after, before = field.water(3.0, 1.0, 7.0 + h)[0], field.water(3.0, 1.0, 7.0 - h)[0]
    assert (after[0] - before[0]) / (2 * h) == pytest.approx(a_x, abs=1e-7)
    assert (after[1] - before[1]) / (2 * h) == pytest.approx(a_y, abs=1e-7)
    assert v == pytest.approx(u * math.tan(0.5))
    deep = field.water(3.0, 1.0, 7.0, depth_m=30.0)[0]
    assert math.hypot(*deep) < 1e-3 * math.hypot(u, v)


@pytest.mark.parametrize("radius_m", [0.3, 1.5])
def test_a_hull_feels_the_mean_over_its_disc(radius_m: float) -> None:
    small, large = WaveField(SEA, 0.0, seed=1), WaveField(SEA, radius_m, seed=1)
    for (a, _, k, _), (felt, _, _, _) in zip(small._felt, large._felt, strict=True):
        x = k * radius_m
        expected = 2.0 * j1(x) / x if x < 3.8317 else 0.0
        assert felt / a == pytest.approx(expected, abs=1e-9)


def test_seeds_repeat_waves_and_gusts() -> None:
    def sea(seed: int) -> float:
        return WaveField(SEA, 0.3, seed).elevation(1.0, 1.0, 1.0)

    assert sea(4) == sea(4)
    assert sea(4) != sea(5)
    one, same, other = (GaussMarkov(2.0, 5.0, 0.1, seed) for seed in (1, 1, 2))
    for process in (one, same, other):
        for _ in range(50):
            process.step()
    assert one.value == same.value
    assert one.value != other.value


def test_gusts_have_their_spread_and_memory() -> None:
    process = GaussMarkov(2.0, 5.0, 0.1, seed=1)
    seen = []
    for _ in range(40_000):
        process.step()
        seen.append(process.value[0])
    assert statistics.pstdev(seen) == pytest.approx(2.0, rel=0.1)
    lagged = statistics.fmean(a * b for a, b in zip(seen, seen[50:], strict=False))
    assert lagged / statistics.pvariance(seen) == pytest.approx(math.exp(-1.0), abs=0.1)


def test_wind_pushes_with_the_square_of_what_the_vessel_feels() -> None:
    wind = Wind(drag_area_m2=0.5, lever_m=0.1)
    X, Y, N = wind_wrench(wind, (0.0, 10.0), 0.0, 0.0, 0.0)  # from port
    assert pytest.approx((0.0, 0.5 * 1.225 * 0.5 * 100.0)) == (X, Y)
    assert pytest.approx(0.1 * Y) == N
    assert wind_wrench(wind, (3.0, 0.0), 0.0, 3.0, 0.0) == (0.0, 0.0, 0.0)  # sailing with it
    X, Y, _ = wind_wrench(wind, (0.0, 10.0), math.pi / 2, 0.0, 0.0)
    assert pytest.approx((0.5 * 1.225 * 0.5 * 100.0, 0.0), abs=1e-12) == (X, Y)


def test_the_peak_of_the_spectrum_is_enhanced_by_gamma() -> None:
    assert jonswap(2.0, 2.0, 3.3) / jonswap(2.0, 2.0, 1.0) == pytest.approx(3.3)
    assert max((jonswap(0.01 * w, 2.0, 3.3), w) for w in range(50, 600))[1] == 200
