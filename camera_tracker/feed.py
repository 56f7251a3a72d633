"""A camera on another machine: its pictures on the bus, for a tracker with the source `bus://camera/image`.

Start it by configuration: `[system.services]` with `camera_feed = "camera_tracker.feed:CameraFeed"`.
"""

from __future__ import annotations

import cv2
from pydantic import Field

from bus import topics
from bus.config import Deployment, Section
from bus.messages import CameraImage
from bus.service import Output, Service
from camera_tracker.settings import CameraSettings
from camera_tracker.sources import Source, SourceError, open_source

RETRY_S = 1.0


class CameraFeedConfig(Section):
    """Section [camera_feed]."""

    source: str = "/dev/video0"
    width_px: int = Field(1280, gt=0)
    height_px: int = Field(720, gt=0)
    jpeg_quality: int = Field(90, ge=1, le=100)
    camera: CameraSettings = CameraSettings()


class CameraFeed(Service):
    """Publish each picture of a camera as JPEG, with its capture time. A lost camera is tried again each second."""

    name = "camera_feed"
    rate_hz = 10.0

    image = Output(topics.CAMERA_IMAGE)

    def __init__(self, config: CameraFeedConfig, deployment: Deployment) -> None:
        self._config = config
        self._run_dir = deployment.run_dir
        self._source: Source | None = None
        self._retry_s = 0.0

    def files(self) -> list[int]:
        """Return the source's descriptor, while there is one."""
        fd = None if self._source is None else self._source.fileno()
        return [] if fd is None else [fd]

    def step(self, now_s: float) -> None:
        """Publish the newest frame, if there is one."""
        try:
            if self._source is None and now_s >= self._retry_s:
                size = (self._config.width_px, self._config.height_px)
                self._source = open_source(self._config.source, self._run_dir, size, self._config.camera)
            if self._source is not None:
                self._pass_on(self._source)
        except SourceError as error:
            self.note = str(error)[:400]
            self._retry_s = now_s + RETRY_S
            self._close()

    def stop(self, now_s: float) -> None:
        """Close the source."""
        self._close()

    def _pass_on(self, source: Source) -> None:
        frame = source.read()
        if frame is None:
            return
        self.note = source.note
        height, width = frame.image.shape[:2]
        ok, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, self._config.jpeg_quality])
        if ok:
            stamp_ns = frame.stamp_ns if source.live else 0  # a recording's pictures are published as new
            content = CameraImage(frame=frame.index, width_px=width, height_px=height, data=data.tobytes())
            self.image.publish(content.model_copy(update={"stamp_ns": stamp_ns, "origin_ns": stamp_ns or None}))

    def _close(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None
