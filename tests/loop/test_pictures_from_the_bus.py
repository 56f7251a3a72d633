"""A camera on another machine: its pictures come over the bus, with their capture time."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bus import topics
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import CameraImage, CameraPose
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.feed import CameraFeed, CameraFeedConfig
from camera_tracker.service import CameraTracker
from camera_tracker.sources import FrameWriter
from services.simulator.camera import Renderer
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
RENDERER = Renderer(VESSEL, seed=4)


def tracker(tmp_path: Path, source: str = "bus://camera/image") -> CameraTracker:
    return CameraTracker(CameraTrackerConfig(source=source), VESSEL, Deployment(run_dir=tmp_path))


@pytest.mark.parametrize("json", [False, True])
def test_the_tracker_follows_pictures_that_another_machine_publishes(tmp_path: Path, json: bool) -> None:
    bus = MemoryBus(json=json)
    poses: list[CameraPose] = []
    images: list[CameraImage] = []
    bus.tap(topics.CAMERA_POSE, poses.append)
    bus.tap(topics.CAMERA_IMAGE, images.append)
    bus.add(CameraFeed(CameraFeedConfig(source="sim://", jpeg_quality=95), Deployment(run_dir=tmp_path)))
    bus.add(tracker(tmp_path))
    bus.run_for(1.5)
    assert not poses, "no camera yet"
    writer = FrameWriter(tmp_path / "camera", 800, 600)
    bus.run_for(1.5)  # the feed tries again
    for i in range(3):
        stamp_ns = bus.clock.now_ns() + 60_000_000
        writer.write(RENDERER.render(2.0 + 0.02 * i, 1.5, 0.3), stamp_ns)
        bus.run_for(0.1)
    assert [p.stamp_ns for p in poses][-1] == stamp_ns, "the capture time, not the arrival"
    assert len(poses) == len(images) == 3, "the tracker publishes no pictures of its own"
    assert poses[-1].x_m == pytest.approx(2.04, abs=0.002)
    status = bus.last(topics.CAMERA_STATUS)
    assert status is not None
    assert status.state == "tracking"


def test_pictures_with_another_clock_are_refused_and_said_so(tmp_path: Path) -> None:
    bus = MemoryBus()
    bus.add(tracker(tmp_path))
    bus.run_for(20.0)
    ok, data = cv2.imencode(".jpg", RENDERER.render(2.0, 1.5, 0.3))
    assert ok
    picture = CameraImage(
        frame=1, width_px=800, height_px=600, data=data.tobytes(), stamp_ns=bus.clock.now_ns() - 5 * 10**9
    )
    bus.publish(topics.CAMERA_IMAGE, picture)
    bus.run_for(0.05)
    status = bus.last(topics.CAMERA_STATUS)
    assert status is not None
    assert bus.last(topics.CAMERA_POSE) is None
    assert "are the machines' clocks alike" in status.error


@pytest.mark.parametrize("data", [b"", b"no jpeg", cv2.imencode(".jpg", np.zeros((1, 1, 3), np.uint8))[1].tobytes()])
def test_damaged_pictures_do_no_harm(tmp_path: Path, data: bytes) -> None:
    bus = MemoryBus()
    bus.add(tracker(tmp_path))
    bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=1, width_px=800, height_px=600, data=data))
    bus.run_for(2.0)
    status = bus.last(topics.CAMERA_STATUS)
    assert status is not None
    assert status.state == "no_camera"
    assert bus.last(topics.CAMERA_POSE) is None


def test_a_tracker_with_a_camera_of_its_own_does_not_listen_to_pictures(tmp_path: Path) -> None:
    keys = {port.topic.key for port in tracker(tmp_path, "sim://").inputs}
    assert "camera/image" not in keys
    assert "camera/image" in {port.topic.key for port in tracker(tmp_path).inputs}
    assert "camera/image" not in {port.topic.key for port in tracker(tmp_path).outputs}
