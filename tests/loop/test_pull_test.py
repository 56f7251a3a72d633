"""Thruster mapping with the vessel at a balance: the curve that comes out, the vessel file, through the whole loop."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from bus import topics
from bus.messages import OperatorJoystick
from marine.actuators import Drive
from marine.identification.result import IdentificationError
from services.pull_test import Pull, drive, fitted, pulling, shares, write_thrusters
from services.vessels import VESSELS_DIR, load_vessel
from tests.star import Star

PLADYPOS = load_vessel("pladypos")
K_T = Drive(PLADYPOS.thrusters[0]).thrust(10.0) / 100.0


class Helper:
    """Pushes the stick of a star on MemoryBus, reads the simulated thrusters through a balance of 0.02 N."""

    def __init__(self, star: Star) -> None:
        self.star = star
        self.noise = np.random.default_rng(1)

    def push(self, share: float) -> Mapping[str, float]:
        for _ in range(10):
            self.star.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", surge=share))
            self.star.bus.run_for(0.1)
        command = self.star.bus.last(topics.ACTUATOR_COMMAND)
        assert command is not None
        return command.commands

    def reading(self, share: float, commands: Mapping[str, float]) -> float | None:
        assert set(commands) == {a.name for a in PLADYPOS.actuators}
        if share == 1.0:
            return None  # out of the balance's range
        return abs(self.star.truth[-1].surge_n + self.noise.normal(0.0, 0.02))


def test_the_thrust_curve_comes_out_of_the_whole_loop_and_goes_into_a_vessel_file(tmp_path: Path) -> None:
    star = Star(simulator={"current_x_m_s": 0.0, "current_std_m_s": 0.0})
    star.bus.run_for(3.0)
    assert star.request("manual").accepted
    pulls = drive(PLADYPOS, "surge", 8, Helper(star))
    assert len(pulls) == 15
    found, dead_zone = fitted(pulls, "quadratic")
    k_t = found.identified.parameter("k_t")
    assert k_t.value == pytest.approx(K_T, rel=0.02)
    assert 0.0 < k_t.std < 0.02 * K_T
    target = tmp_path / "pulled.toml"
    names = set(pulling(PLADYPOS, "surge"))
    write_thrusters(VESSELS_DIR / "pladypos.toml", target, names, found.identified, dead_zone)
    saved = load_vessel(str(target))
    for before, after in zip(PLADYPOS.thrusters, saved.thrusters, strict=True):
        assert Drive(after).thrust(10.0) == pytest.approx(100.0 * k_t.value, rel=1e-6)
        assert (after.name, after.n_max, after.column) == (before.name, before.n_max, before.column)
    assert saved.model == PLADYPOS.model


def test_a_curve_with_two_branches_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    def thrust(n: float) -> float:
        return 0.05 * n * abs(n) + 0.1 * n if n > 0 else 0.03 * n * abs(n) + 0.08 * n

    pulls = [Pull(n, thrust(n)) for n in np.linspace(-15.0, 15.0, 13).tolist()]
    found, dead_zone = fitted(pulls)
    assert found.identified.model == "asymmetric"
    names = set(pulling(PLADYPOS, "sway"))
    write_thrusters(VESSELS_DIR / "pladypos.toml", tmp_path / "v.toml", names, found.identified, dead_zone)
    saved = load_vessel(str(tmp_path / "v.toml")).thrusters[0]
    assert Drive(saved).thrust(10.0) == pytest.approx(thrust(10.0), rel=1e-6)
    assert Drive(saved).thrust(-10.0) == pytest.approx(thrust(-10.0), rel=1e-6)


def test_thrusters_that_one_balance_cannot_tell_apart_are_refused() -> None:
    with pytest.raises(IdentificationError, match="no thruster that pulls along heave"):
        pulling(PLADYPOS, "heave")
    assert set(pulling(load_vessel("videoray"), "heave")) == {"vertical"}
    assert list(shares(2)) == [0.25, -0.25, 1.0, -1.0]
