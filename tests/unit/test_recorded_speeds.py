"""Velocities from recorded poses (thesis Algorithm 3.2 VI, Fig. 3.16) and the command that prints them."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from marine.estimation.smoothing import CausalVelocities, body_velocities, recorded_velocities
from services.cli.camera import app
from services.cli.errors import CliError

RADIUS_M, RATE_RAD_S = 0.8, 0.4


def circle(times_s: np.ndarray) -> np.ndarray:
    """Poses on a circle: surge 0.32 m/s, no sway, yaw rate 0.4 rad/s; psi wraps."""
    psi = RATE_RAD_S * times_s
    return np.stack([RADIUS_M * np.sin(psi), -RADIUS_M * np.cos(psi), np.remainder(psi + math.pi, math.tau) - math.pi])


def test_on_even_samples_it_is_the_centred_filter() -> None:
    times = np.arange(200) / 30.0
    noisy = circle(times) + np.random.default_rng(0).normal(0.0, 0.002, (3, 200))
    here, there = recorded_velocities(times, noisy, 15, 2), body_velocities(noisy, 15, 2, 1 / 30.0)
    assert here == pytest.approx(there, abs=1e-9)


def test_causal_is_what_the_live_filter_gives() -> None:
    times = np.cumsum(np.random.default_rng(1).uniform(0.02, 0.05, 60))
    poses = circle(times)
    live = CausalVelocities(15, 2)
    expected = np.array([live.add(t, *pose) for t, pose in zip(times.tolist(), poses.T.tolist(), strict=True)]).T
    found = recorded_velocities(times, poses, 15, 2, causal=True)
    assert np.isnan(found[:, :14]).all()
    assert found[:, 14:] == pytest.approx(expected[:, 14:], abs=2e-3)


def test_uneven_samples_and_gaps_do_not_bend_the_speeds() -> None:
    random = np.random.default_rng(2)
    times = np.cumsum(random.uniform(0.02, 0.05, 400))
    times[200:] += 3.0
    found = recorded_velocities(times, circle(times), 15, 3)
    assert np.isfinite(found).all()
    assert found[0] == pytest.approx(RADIUS_M * RATE_RAD_S, abs=1e-3)
    assert found[1] == pytest.approx(0.0, abs=1e-3)
    assert found[2] == pytest.approx(RATE_RAD_S, abs=1e-6)


def test_pieces_shorter_than_the_window_give_nothing() -> None:
    times = np.concatenate([np.arange(30) / 30.0, 9.0 + np.arange(5) / 30.0])
    found = recorded_velocities(times, circle(times), 15, 2)
    assert np.isfinite(found[:, :30]).all()
    assert np.isnan(found[:, 30:]).all()
    with pytest.raises(ValueError, match="times must rise"):
        recorded_velocities(times[::-1], circle(times), 15, 2)


def tracked(path: Path, names: tuple[str, ...]) -> None:
    times = np.arange(60) / 30.0
    frames = [
        {
            "index": i,
            "stamp_s": t,
            "poses": [{"name": n, "x_px": 100 * x, "y_px": 100 * y, "psi_rad": p} for n in names],
        }
        for i, (t, (x, y, p)) in enumerate(zip(times.tolist(), circle(times).T.tolist(), strict=True))
    ]
    path.write_text(json.dumps({"frames": frames}))


def run(*words: str) -> list[dict[str, str]]:
    result = CliRunner().invoke(app, ["speeds", *words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return list(csv.DictReader(io.StringIO(result.stdout)))


def test_the_command_prints_the_speeds_of_what_track_found(tmp_path: Path) -> None:
    tracked(tmp_path / "t.json", ("v",))
    rows = run(str(tmp_path / "t.json"))
    assert len(rows) == 60
    assert float(rows[30]["surge_px_s"]) == pytest.approx(100 * RADIUS_M * RATE_RAD_S, rel=1e-3)
    assert float(rows[30]["yaw_rad_s"]) == pytest.approx(RATE_RAD_S, rel=1e-3)
    assert len(run(str(tmp_path / "t.json"), "--causal")) == 60 - 14


def test_mistakes_are_told(tmp_path: Path) -> None:
    tracked(tmp_path / "t.json", ("a", "b"))
    with pytest.raises(CliError, match="choose one with --name: a, b"):
        run(str(tmp_path / "t.json"))
    (tmp_path / "none.json").write_text("[]")
    with pytest.raises(CliError, match="neither a recording"):
        run(str(tmp_path / "none.json"))
    with pytest.raises(CliError, match="cannot be read"):
        run(str(tmp_path / "absent.json"))
    (tmp_path / "none.mcap").write_bytes(b"no recording")
    with pytest.raises(CliError, match="none\\.mcap"):
        run(str(tmp_path / "none.mcap"))
