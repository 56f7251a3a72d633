"""The tracker as a service, in front of the rendered camera."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bus import topics
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import CameraImage, CameraPose, CameraStatus
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.service import CameraTracker
from camera_tracker.sources import FrameWriter
from marine.vessel import Vessel
from services.simulator.camera import Renderer
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
RENDERER = Renderer(VESSEL, seed=2)
PERIOD_S = 0.1  # nothing wakes the loop on MemoryBus: a frame per step


@dataclass
class Scene:
    """A tracker on a bus, and a rendered camera in its run directory."""

    run_dir: Path
    vessel: Vessel = VESSEL
    bus: MemoryBus = field(default_factory=MemoryBus)
    poses: list[CameraPose] = field(default_factory=list)
    statuses: list[CameraStatus] = field(default_factory=list)
    images: list[CameraImage] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.writer: FrameWriter | None = None
        self.bus.tap(topics.CAMERA_POSE, self.poses.append)
        self.bus.tap(topics.CAMERA_STATUS, self.statuses.append)
        self.bus.tap(topics.CAMERA_IMAGE, self.images.append)

    def track(self, **config: Any) -> CameraTracker:
        deployment = Deployment(run_dir=self.run_dir)
        tracker = CameraTracker(CameraTrackerConfig.model_validate(config), self.vessel, deployment)
        self.bus.add(tracker)
        self.bus.run_for(0.0)  # the first step
        return tracker

    def state(self) -> str:
        return self.statuses[-1].state

    def plug_in(self, width: int = 800, height: int = 600) -> None:
        self.writer = FrameWriter(self.run_dir / "camera", width, height)

    def show(self, x_m: float = 2.0, y_m: float = 1.5, psi_rad: float = 0.3, frames: int = 1, **more: Any) -> int:
        """Let the camera give frames; return the capture time of the last."""
        for _ in range(frames):
            assert self.writer is not None
            stamp_ns = self.bus.clock.now_ns() + 70_000_000  # 30 ms before the step that reads it
            self.writer.write(RENDERER.render(x_m, y_m, psi_rad, **more), stamp_ns)
            self.bus.run_for(PERIOD_S)
        return stamp_ns


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


def test_a_pose_has_capture_time_metres_and_quality(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    scene.show(frames=2)
    stamp_ns = scene.show(2.5, 1.25, -2.0)
    pose = scene.poses[-1]
    assert (pose.stamp_ns, pose.origin_ns, pose.name) == (stamp_ns, stamp_ns, "pladypos")
    assert (pose.x_m, pose.y_m) == pytest.approx((2.5, 1.25), abs=0.001)
    assert (pose.x_px, pose.y_px) == pytest.approx((2.5 * 160 - 0.5, 1.25 * 160 - 0.5), abs=0.1)
    assert pose.psi_rad == pytest.approx(-2.0, abs=0.005)
    assert pose.quality > 0.9
    assert [p.frame for p in scene.poses] == [0, 1, 2]
    assert pose.region_px is None, "the vessel was moved to where it could not be: found by a search"
    scene.show(2.51, 1.25, -2.0)
    left, top, right, bottom = scene.poses[-1].region_px or (0, 0, 0, 0)
    assert left < scene.poses[-1].x_px < right <= left + 200
    assert top < scene.poses[-1].y_px < bottom <= top + 200
    scene.show(frames=10)
    status = scene.statuses[-1]
    assert (status.state, status.error, status.frames_dropped) == ("tracking", "", 0)
    assert status.rate_hz == pytest.approx(10.0, rel=0.1)
    assert status.latency_s == pytest.approx(0.03, abs=0.001)
    assert (status.width_px, status.height_px, status.scale_px_per_m) == (800, 600, 160.0)


def test_a_shifted_camera_shifts_the_pose(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    scene.show()
    scene.show(shift_px=(10.0, 0.0))
    x_m = scene.poses[-1].x_m
    assert x_m is not None
    assert x_m - 2.0 == pytest.approx(10 / 160, abs=0.001)


def test_black_frames_end_the_poses_and_the_vessel_is_found_again(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    scene.show(frames=3)
    scene.show(frames=5, black=True)
    assert len(scene.poses) == 3
    assert scene.state() == "searching"
    scene.show(4.0, 3.0, 1.0)
    assert len(scene.poses) == 4
    assert scene.state() == "tracking"


def test_no_pictures_are_one_line_in_the_log_and_another_when_they_are_back(
    scene: Scene, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    scene.track(source="/dev/video97")
    scene.bus.run_for(10.0)
    (line,) = caplog.messages
    assert "/dev/video97: no such camera" in line
    caplog.clear()
    scene.track()
    scene.bus.run_for(10.0)
    scene.plug_in()
    scene.bus.run_for(1.1)
    scene.show(frames=2)
    assert [m for m in caplog.messages if "sim://" in m] == [caplog.messages[0], "sim://: pictures again"]


def test_a_camera_that_is_missing_then_silent_then_back(scene: Scene) -> None:
    scene.track()
    scene.bus.run_for(2.5)
    assert scene.state() == "no_camera"
    assert "no simulator has written frames" in scene.statuses[-1].error
    assert len(scene.statuses) <= 4, "once a second and at changes, not every step"
    scene.plug_in()
    scene.bus.run_for(1.1)
    scene.show(frames=2)
    assert scene.state() == "tracking"
    assert scene.statuses[-1].error == ""
    scene.bus.run_for(1.5)
    assert scene.state() == "no_camera"
    assert "no frame for 1 s" in scene.statuses[-1].error
    scene.show()
    assert scene.state() == "tracking"


def test_a_camera_of_another_size_is_taken_up_and_the_scale_doubted(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    scene.show()
    scene.plug_in(400, 300)
    scene.bus.run_for(2.0)
    assert scene.writer is not None
    scene.writer.write(np.zeros((300, 400, 3), np.uint8), scene.bus.clock.now_ns())
    scene.bus.run_for(0.2)
    assert scene.state() == "searching"
    assert "400 x 300 px, the vessel file says 800 x 600" in scene.statuses[-1].error


def test_a_scale_of_its_own_makes_other_metres(scene: Scene) -> None:
    scene.plug_in()
    scene.vessel = replace(VESSEL, camera=replace(VESSEL.camera, scale_px_per_m=100.0))
    scene.track(scale_px_per_m=160.0)
    scene.show(2.0, 1.5)
    assert scene.poses[-1].x_m == pytest.approx(2.0, abs=0.001)


def test_frames_that_came_too_fast_are_counted(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    assert scene.writer is not None
    for _ in range(4):
        scene.writer.write(RENDERER.render(2.0, 1.5, 0.0), scene.bus.clock.now_ns())
    scene.show(frames=11)
    assert scene.statuses[-1].frames_dropped == 4
    assert scene.poses[0].frame == 4


@pytest.mark.parametrize(("rate_hz", "expected"), [(5.0, 10), (0.0, 0)])
def test_pictures_come_at_their_own_rate(scene: Scene, rate_hz: float, expected: int) -> None:
    scene.plug_in()
    scene.track(image_rate_hz=rate_hz)
    scene.show(frames=20)
    assert len(scene.images) == expected
    for image in scene.images:
        picture = cv2.imdecode(np.frombuffer(CameraImage.decode(image.encode()).data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (image.height_px, image.width_px, 3) == (600, 800, 3)
        assert image.stamp_ns in [pose.stamp_ns for pose in scene.poses]


def test_a_folder_of_pictures_as_source_is_paced_and_starts_again(scene: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i in range(5):
        cv2.imwrite(str(folder / f"{i}.png"), RENDERER.render(2.0, 1.5, 0.1 * i))
    scene.track(source=str(folder))
    scene.bus.run_for(0.45)
    assert [round(pose.psi_rad, 1) for pose in scene.poses] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert len({pose.stamp_ns for pose in scene.poses}) == 5
    scene.bus.run_for(0.5)
    assert "the recording has ended; it starts again" in scene.statuses[-1].error
    scene.bus.run_for(1.0)
    assert len(scene.poses) > 5


@pytest.mark.parametrize("source", ["absent.mp4", "/dev/video97", "sim:///nowhere"])
def test_a_wrong_source_is_told_and_tried_again(scene: Scene, source: str) -> None:
    tracker = scene.track(source=source)
    scene.bus.run_for(3.0)
    assert scene.state() == "no_camera"
    assert source in scene.statuses[-1].error
    assert "\n" not in scene.statuses[-1].error
    assert tracker.files() == []


def test_a_descriptor_wakes_the_loop_while_the_source_is_open(scene: Scene) -> None:
    scene.plug_in()
    tracker = scene.track()
    assert len(tracker.files()) == 1
    scene.bus.stop("camera_tracker")
    assert tracker.files() == []


def test_the_pose_follows_a_turn_through_pi(scene: Scene) -> None:
    scene.plug_in()
    scene.track()
    for k in range(12):
        psi_rad = math.remainder(3.0 + 0.05 * k, math.tau)
        scene.show(psi_rad=psi_rad)
        assert math.remainder(scene.poses[-1].psi_rad - psi_rad, math.tau) == pytest.approx(0.0, abs=0.005)
    assert len(scene.poses) == 12
