"""A calibrated camera that looks at the pool aslant: poses in metres with covariance, and the estimator uses it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bus import topics
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import CameraPose
from camera_tracker.calibration import Lens, project
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.plane import CameraFile, Reference, place_camera
from camera_tracker.service import CameraTracker
from camera_tracker.sources import FrameWriter, Image
from services.estimator import Estimator, EstimatorConfig
from services.simulator.camera import Renderer
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
RENDERER = Renderer(VESSEL, seed=6, noise_std=3.0)
SCALE = VESSEL.camera.scale_px_per_m
CORNERS_M = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 3.75), (0.0, 3.75)])
LENS = Lens.of(
    (800, 600), np.array([480.0, 480.0, 399.5, 299.5, 0, 0, 0, 0, 0]), np.diag([4.0, 4.0, 4.0, 4.0] + [0.0] * 5), 0.2
)
ROTATION = np.asarray(cv2.Rodrigues(np.array([0.15, -0.1, 0.2]))[0], np.float64)
POSE = np.concatenate([cv2.Rodrigues(ROTATION)[0].ravel(), -ROTATION @ (2.5, 1.9, -3.4)])


def aslant(picture: Image) -> Image:
    """Return the picture of the camera that looks straight down as this one sees it."""
    seen = project(np.hstack([CORNERS_M, np.zeros((4, 1))]), POSE, LENS.parameters)[0]
    warp = cv2.getPerspectiveTransform((CORNERS_M * SCALE - 0.5).astype(np.float32), seen.astype(np.float32))
    return np.asarray(cv2.warpPerspective(picture, warp, (800, 600), flags=cv2.INTER_LINEAR), np.uint8)


@pytest.fixture
def camera_file(tmp_path: Path) -> Path:
    known = np.array([(0.5, 0.5), (4.5, 0.5), (4.5, 3.2), (0.5, 3.2), (2.5, 1.9), (1.5, 2.8)])
    seen = project(np.hstack([known, np.zeros((6, 1))]), POSE, LENS.parameters)[0]
    points = [
        Reference(str(i), m[0], m[1], 0.0, px[0], px[1]) for i, (m, px) in enumerate(zip(known, seen, strict=True))
    ]
    path = tmp_path / "camera.json"
    path.write_text(CameraFile(lens=LENS, placement=place_camera(LENS, points)).model_dump_json())
    return path


def test_poses_are_in_metres_with_a_covariance_and_the_estimator_follows(camera_file: Path, tmp_path: Path) -> None:
    bus = MemoryBus(json=True)
    poses: list[CameraPose] = []
    bus.tap(topics.CAMERA_POSE, poses.append)
    config = CameraTrackerConfig(calibration=Path("camera.json"))
    bus.add(CameraTracker(config, VESSEL, Deployment(run_dir=tmp_path, config_path=tmp_path / "pool.toml")))
    bus.add(Estimator(EstimatorConfig(), VESSEL))
    writer = FrameWriter(tmp_path / "camera", 800, 600)
    bus.run_for(1.1)
    for _ in range(20):
        writer.write(aslant(RENDERER.render(3.2, 1.2, 0.7)), bus.clock.now_ns() + 60_000_000)
        bus.run_for(0.1)
    pose = poses[-1]
    assert (pose.x_m, pose.y_m) == pytest.approx((3.2, 1.2), abs=0.004)
    assert pose.psi_rad == pytest.approx(0.7, abs=0.01)
    assert pose.psi_image_rad is not None
    assert pose.psi_image_rad - pose.psi_rad > 0.1, "the camera is turned"
    assert pose.covariance is not None
    assert pose.noise_covariance is not None
    assert pose.covariance[0] > pose.noise_covariance[0] > 0.0
    state = bus.last(topics.NAVIGATION_STATE)
    assert state is not None
    assert state.status == "tracking"
    assert (state.x_m, state.y_m) == pytest.approx((3.2, 1.2), abs=0.004)
    status = bus.last(topics.CAMERA_STATUS)
    assert status is not None
    assert status.error == ""


def test_a_picture_of_another_size_than_calibrated_is_said(camera_file: Path, tmp_path: Path) -> None:
    bus = MemoryBus()
    config = CameraTrackerConfig(calibration=camera_file)
    bus.add(CameraTracker(config, VESSEL, Deployment(run_dir=tmp_path)))
    writer = FrameWriter(tmp_path / "camera", 640, 480)
    bus.run_for(1.1)
    writer.write(np.zeros((480, 640, 3), np.uint8), bus.clock.now_ns())
    bus.run_for(0.2)
    status = bus.last(topics.CAMERA_STATUS)
    assert status is not None
    assert status.error == "the picture has 640 x 480 px, its calibration says 800 x 600: metres are wrong"


def test_the_estimator_trusts_a_pose_as_much_as_its_covariance_says() -> None:
    spreads = []
    for variance in (1e-6, 1e-3):
        bus = MemoryBus()
        bus.add(Estimator(EstimatorConfig(), VESSEL))
        for frame in range(30):
            covariance = (variance, 0.0, 0.0, variance, 0.0, 1e-5)
            pose = CameraPose(
                frame=frame, x_px=0, y_px=0, x_m=2.0, y_m=1.0, psi_rad=0.1, quality=1.0, noise_covariance=covariance
            )
            bus.publish(topics.CAMERA_POSE, pose)
            bus.run_for(1 / 30)
        state = bus.last(topics.NAVIGATION_STATE)
        assert state is not None
        assert state.x_std_m is not None
        spreads.append(state.x_std_m)
    assert spreads[1] > 2.0 * spreads[0]
