"""Figures of manoeuvres (thesis 4.4) on simulated ships with known answers, and on the Esso Osaka model."""

from __future__ import annotations

from math import pi, radians, sqrt
from pathlib import Path

import numpy as np
import pytest

from marine.identification import manoeuvres
from marine.identification.result import FloatArray, IdentificationError
from services.cli.errors import CliError
from services.cli.figures_ship import DATA, LENGTH_M, circle_of, read

U, K, T = 1.0, 0.2, 3.0
"""m/s; Nomoto's (4.49): 1/s, s."""
DT = 0.05


def nomoto(rudder: FloatArray, course: float = 0.0, u_m_s: float = U) -> tuple[FloatArray, ...]:
    """Return (t, x, y, psi, r) of T r' + r = K delta at constant speed, exact between samples."""
    t = np.arange(len(rudder), dtype=float) * DT
    keep = np.exp(-DT / T)
    r = np.zeros(len(rudder))
    for k in range(len(rudder) - 1):
        r[k + 1] = keep * r[k] + (1.0 - keep) * K * rudder[k]
    psi = course + np.concatenate([[0.0], np.cumsum(0.5 * DT * (r[1:] + r[:-1]))])
    x, y = (np.concatenate([[0.0], np.cumsum(0.5 * DT * u_m_s * (c[1:] + c[:-1]))]) for c in (np.cos(psi), np.sin(psi)))
    return t, x, y, psi, r


@pytest.mark.parametrize(("side", "course"), [(1.0, 0.0), (-1.0, 2.5)])
def test_turning_circle_of_a_nomoto_ship(side: float, course: float) -> None:
    rudder = np.where(np.arange(4000) * DT >= 20.0, side * radians(35.0), 0.0)
    t, x, y, psi, _ = nomoto(rudder, course)
    found = manoeuvres.turning_circle(t, x, y, psi, rudder_s=20.0)
    r = K * radians(35.0)
    assert found.steady_rate_rad_s == pytest.approx(side * r, rel=1e-3)
    assert found.steady_diameter_m == pytest.approx(2.0 * U / r, rel=2e-3)
    assert found.approach_speed_m_s == pytest.approx(U, rel=1e-3)
    # psi = r (s - T (1 - exp(-s/T))): solved for 90 and 180 degrees, then integrated finely
    s = np.linspace(0.0, 60.0, 600_001)
    angle = r * (s - T * (1.0 - np.exp(-s / T)))
    ahead, across = (np.cumsum(f(angle)) * U * 1e-4 for f in (np.cos, np.sin))
    at_90, at_180 = (int(np.searchsorted(angle, a)) for a in (0.5 * pi, pi))
    assert found.time_90_s == pytest.approx(s[at_90], abs=0.01)
    assert found.time_180_s == pytest.approx(s[at_180], abs=0.01)
    expected = (ahead[at_90], across[at_90], across[at_180])
    assert (found.advance_m, found.transfer_m, found.tactical_diameter_m) == pytest.approx(expected, rel=2e-3)


def test_turning_circle_refuses_less_than_half_a_turn_and_a_moving_rudder() -> None:
    rudder = np.where(np.arange(700) * DT >= 20.0, radians(20.0), 0.0)
    t, x, y, psi, _ = nomoto(rudder)
    with pytest.raises(IdentificationError, match="turn for 180"):
        manoeuvres.turning_circle(t, x, y, psi, rudder_s=20.0)
    with pytest.raises(IdentificationError, match="the record is from"):
        manoeuvres.turning_circle(t, x, y, psi, rudder_s=200.0)
    assert manoeuvres.rudder_over(t, rudder) == pytest.approx(20.0, abs=2.0 * DT)
    with pytest.raises(IdentificationError, match="not held"):
        manoeuvres.rudder_over(t, np.sin(t))


def zigzag(angle: float, execute: float, duration_s: float) -> FloatArray:
    """Return the rudder of Algorithm 4.1 around the Nomoto ship, from 10 s on."""
    n = round(duration_s / DT)
    rudder = np.zeros(n)
    psi = r = 0.0
    keep, side = np.exp(-DT / T), 1.0
    for k in range(round(10.0 / DT), n):
        if side * psi >= execute:
            side = -side
        rudder[k] = side * angle
        after = keep * r + (1.0 - keep) * K * rudder[k]
        psi += 0.5 * DT * (r + after)
        r = after
    return rudder


def test_zig_zag_overshoots_of_a_nomoto_ship_are_those_of_its_equation() -> None:
    """From r_0 at the execute, r falls as (r_0 + K d) exp(-s/T) - K d: overshoot T (r_0 - K d ln(1 + r_0/(K d)))."""
    angle = execute = radians(10.0)
    rudder = zigzag(angle, execute, 120.0)
    t, x, y, psi, r = nomoto(rudder)
    found = manoeuvres.zigzag_figures(t, psi, rudder, x_m=x, y_m=y)
    ends = [round((10.0 + s) / DT) for s in found.executes_s[1:]]
    for k, overshoot in zip(ends, found.overshoots_rad, strict=False):
        r_0, turn = abs(float(r[k])), K * angle
        assert overshoot == pytest.approx(T * (r_0 - turn * np.log(1.0 + r_0 / turn)), rel=0.06)
    assert len(found.overshoots_rad) >= 4
    assert found.overshoots_rad[0] < found.overshoots_rad[1]  # the first swing begins without rate of turn
    assert found.advance_m == pytest.approx(U * found.initial_turning_s, rel=0.02)
    assert found.period_s == pytest.approx(2.0 * (found.executes_s[3] - found.executes_s[2]), rel=0.02)
    ability = manoeuvres.initial_turning_ability(t, x, y, psi, rudder_s=10.0)
    assert ability == pytest.approx(U * found.initial_turning_s, abs=2.0 * U * DT)


def test_zig_zag_says_what_is_wrong() -> None:
    rudder = zigzag(radians(10.0), radians(10.0), 60.0)
    t, _, _, psi, _ = nomoto(rudder)
    with pytest.raises(IdentificationError, match="wrong sign"):
        manoeuvres.zigzag_figures(t, -psi, rudder)
    with pytest.raises(IdentificationError, match="two at least"):
        manoeuvres.zigzag_figures(t, psi, np.where(t > 10.0, 0.1, 0.0))


def steered(a: float, levels: FloatArray, hold_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (t, r, rudder) of Norrbin's ship 3 r' = delta - a r - 400 r^3 under rudder angles held one by one."""
    rudder = np.repeat(levels, round(hold_s / DT))
    r = np.zeros(len(rudder))
    r[0] = 0.1
    for k in range(len(rudder) - 1):
        r[k + 1] = r[k] + DT * (rudder[k] - a * r[k] - 400.0 * r[k] ** 3) / 3.0
    return np.arange(len(rudder), dtype=float) * DT, r, rudder


SPIRAL = np.radians(np.concatenate([np.arange(15.0, -15.5, -0.5), np.arange(-15.0, 15.5, 0.5)]))


def test_direct_spiral_of_a_stable_ship_has_no_loop() -> None:
    found = manoeuvres.direct_spiral(*steered(2.0, SPIRAL, 60.0), hold_s=30.0)
    assert len(found.r_rad_s) == len(SPIRAL) - 1  # -15 degrees twice in a row are one hold
    assert found.loop_width_rad == 0.0
    assert found.slope_per_s == pytest.approx(1.0 / 2.0, rel=0.02)


def test_direct_spiral_of_an_unstable_ship_jumps_at_the_folds_that_the_reverse_one_follows() -> None:
    """delta = -a r + 400 r^3 folds at r^2 = a/1200, delta = (2 a/3) sqrt(a/1200): the loop is twice that."""
    a = 2.0
    fold = 2.0 * a / 3.0 * sqrt(a / 1200.0)
    found = manoeuvres.direct_spiral(*steered(-a, SPIRAL, 120.0), hold_s=30.0)
    assert found.loop_width_rad == pytest.approx(2.0 * fold, abs=2.0 * radians(0.5))
    rates = np.linspace(-0.12, 0.12, 49)
    rates = rates[np.abs(rates) > 1e-9]
    reverse = manoeuvres.reverse_spiral(rates.tolist(), (-a * rates + 400.0 * rates**3).tolist())
    assert reverse.loop_width_rad == pytest.approx(2.0 * fold, rel=0.01)
    assert reverse.slope_per_s == pytest.approx(-1.0 / a, rel=0.02)


def test_spirals_refuse_what_is_none() -> None:
    with pytest.raises(IdentificationError, match="hold it longer"):
        manoeuvres.direct_spiral(*steered(2.0, SPIRAL, 2.0), hold_s=1.0, settled=1e-4)
    with pytest.raises(IdentificationError, match="to both sides"):
        manoeuvres.reverse_spiral([0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 0.3, 0.4])


def test_real_turning_circles_are_those_of_a_tanker() -> None:
    """IMO asks for an advance of 4.5 L and a tactical diameter of 5 L at 35 degrees; less rudder turns wider."""
    if not DATA.is_dir():
        pytest.skip(f"no ship data in {DATA}")
    circles = {record.name: (circle_of(record), record) for record in read(DATA / "turning")}
    assert len(circles) == 4
    tactical: dict[int, list[float]] = {}
    for (circle, begun), record in circles.values():
        rudder = round(float(np.degrees(np.median(record.rudder_rad[begun:]))))
        tactical.setdefault(rudder, []).append(circle.tactical_diameter_m / LENGTH_M)
        assert 2.0 < circle.advance_m / LENGTH_M < 4.5
        assert 2.0 < circle.tactical_diameter_m / LENGTH_M < 5.0
        assert 0.3 * circle.tactical_diameter_m < circle.transfer_m < 0.6 * circle.tactical_diameter_m
        assert circle.approach_speed_m_s == pytest.approx(0.33, abs=0.06)
    assert max(tactical[35]) < min(tactical[20])


def test_a_folder_without_runs_is_said(tmp_path: Path) -> None:
    with pytest.raises(CliError, match="no CSV files"):
        read(tmp_path)
    (tmp_path / "a_b.csv").write_text("t [s],x\n0,1\n")
    with pytest.raises(CliError, match="no column 'x_position_mid"):
        read(tmp_path)
