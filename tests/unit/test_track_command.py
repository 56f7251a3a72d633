"""`starboard track`, and the tracker on a video that was not made for it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from bus.config import ConfigError
from camera_tracker.sources import FrameWriter
from services.cli.errors import CliError
from services.cli.track import track
from services.simulator.camera import Renderer
from services.vessels import load_vessel

ROOT = Path(__file__).parents[2]
VIDEO = ROOT / ".." / "shared" / "data" / "markers" / "overhead-video" / "robot_move.mp4"
CONFIG = ROOT / "config" / "overhead-video.toml"


def run(*arguments: str | Path) -> Result:
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(track)
    return CliRunner().invoke(app, [str(a) for a in arguments])


def run_json(*arguments: str | Path) -> dict[str, Any]:
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return dict(json.loads(result.stdout))


def make_video(path: Path, frames: int) -> None:
    renderer = Renderer(load_vessel("pladypos"))
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (800, 600))
    for i in range(frames):
        video.write(renderer.render(1.0 + 0.01 * i, 1.5, 0.02 * i))
    video.release()


def test_overhead_video_five_vehicles_filmed_by_others() -> None:
    if not VIDEO.is_file():
        pytest.skip(f"{VIDEO} is absent")
    document = run_json(VIDEO, "--config", CONFIG)
    assert [frame["index"] for frame in document["frames"]] == list(range(502))
    vehicles = {vehicle.pop("name"): vehicle for vehicle in document["summary"]["vehicles"]}
    assert len(vehicles) == 5
    assert min(vehicle["found"] for vehicle in vehicles.values()) >= 0.98
    moving = vehicles.pop("blue-green")
    for standing in vehicles.values():
        assert standing["median_step_px"] <= 0.1
        assert standing["median_step_deg"] <= 0.3
    path = [p for frame in document["frames"] for p in frame["poses"] if p["name"] == "blue-green"]
    assert np.ptp([p["x_px"] for p in path]) == pytest.approx(164, abs=10)
    assert moving["found"] < 1.0  # a stick covers it for four frames


def test_json_has_the_agreed_form(tmp_path: Path) -> None:
    make_video(tmp_path / "pool.mp4", 5)
    document = run_json(tmp_path / "pool.mp4")
    assert set(document) == {"source", "frames", "summary"}
    assert len(document["frames"]) == 5
    last = document["frames"][-1]
    assert (last["index"], last["stamp_s"]) == (4, pytest.approx(4 / 30))
    (pose,) = last["poses"]
    assert set(pose) == {"name", "x_px", "y_px", "psi_rad", "quality"}
    assert (pose["x_px"], pose["y_px"]) == pytest.approx((1.04 * 160 - 0.5, 1.5 * 160 - 0.5), abs=0.3)
    assert pose["psi_rad"] == pytest.approx(0.08, abs=0.02)
    assert document["summary"]["vehicles"][0]["median_step_px"] == pytest.approx(1.6, abs=0.3)


def test_table_and_a_video_with_the_poses_drawn_in(tmp_path: Path) -> None:
    make_video(tmp_path / "pool.mp4", 5)
    result = run(tmp_path / "pool.mp4", "--show", tmp_path / "out.mp4")
    assert result.exit_code == 0
    assert "100.0%" in result.stdout
    shown = cv2.VideoCapture(str(tmp_path / "out.mp4"))
    assert shown.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    ok, picture = shown.read()
    assert ok
    b, g, r = (int(v) for v in picture[round(1.5 * 160), round(1.0 * 160) + 4])
    assert g > 150
    assert g > max(b, r) + 40, "the green circle"


def test_a_single_picture_and_the_number_of_frames(tmp_path: Path) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), Renderer(load_vessel("pladypos")).render(2.0, 1.5, 0.0))
    assert run_json(tmp_path / "1.png")["summary"]["vehicles"][0] == {
        "name": "vessel",
        "found": 1.0,
        "median_step_px": None,
        "median_step_deg": None,
    }
    assert len(run_json(tmp_path, "--frames", "2")["frames"]) == 2


def test_a_running_camera_until_enough_frames_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = FrameWriter(tmp_path, 800, 600)
    picture = Renderer(load_vessel("pladypos")).render(2.0, 1.5, 0.0)
    monkeypatch.setattr("time.sleep", lambda _: writer.write(picture, stamp_ns=5))  # each time the command waits
    document = run_json(f"sim://{tmp_path}", "--frames", "3")
    assert [len(frame["poses"]) for frame in document["frames"]] == [1, 1, 1]


def test_nothing_found_says_what_to_do(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((60, 80, 3), np.uint8))
    result = run(tmp_path / "black.png", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["frames"][0]["poses"] == []
    assert "[camera_tracker]" in result.stderr


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("[other]", r"no section \[camera_tracker\]"),
        ("[camera_tracker]\ncolour = 1", "camera_tracker.colour: no such key"),
        ("[camera_tracker", "not valid TOML"),
    ],
)
def test_a_wrong_configuration_is_one_line(tmp_path: Path, toml: str, message: str) -> None:
    (tmp_path / "c.toml").write_text(toml)
    result = run(tmp_path, "--config", tmp_path / "c.toml")
    assert isinstance(result.exception, ConfigError)
    assert result.exception.args[0].count("\n") == 0
    with pytest.raises(ConfigError, match=message):
        raise result.exception


def test_a_wrong_source_or_target_is_one_line(tmp_path: Path) -> None:
    make_video(tmp_path / "pool.mp4", 2)
    for arguments, message in (
        (("absent.mp4",), "no such file"),
        ((tmp_path / "pool.mp4", "--show", tmp_path / "absent" / "out.mp4"), "cannot be written"),
    ):
        result = run(*arguments)
        assert isinstance(result.exception, CliError)
        assert message in str(result.exception)
