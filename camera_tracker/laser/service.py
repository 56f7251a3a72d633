"""The laser distance module as a process: distance and angle to the wall ahead, from the forward camera's pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Deployment, Section
from bus.messages import SensorLaser
from bus.service import Output, Service
from camera_tracker.laser.dots import DotTracker
from camera_tracker.laser.ranging import laser_module
from camera_tracker.settings import CameraSettings
from camera_tracker.sources import Frame, Source, SourceError, open_source
from marine.vessel import Vessel

RETRY_S = 1.0
SIMULATED = "laser"
"""Folder of the simulator's forward camera in the run directory."""
_EARLY = 0.1
"""Part of the sample time that a picture may come early."""


class LaserTrackerConfig(Section):
    """Section [laser_tracker]."""

    source: str = Field(
        "sim://", description="the forward camera: device, stream, video, folder; sim://: the simulator"
    )
    calibration: Path | None = Field(
        None, description="file of `starboard camera laser calibrate`; none: the curves of thesis Table 3.1"
    )
    width_px: int = Field(640, gt=0)
    height_px: int = Field(480, gt=0)
    camera: CameraSettings = CameraSettings()


class LaserTracker(Service):
    """Publish distance and angle to the wall ahead, or which laser dot is lost, at the module's rate.

    The time between two samples is the vessel file's; pictures between them are not looked at. A recording gives a
    picture a sample, and starts again at its end. No camera: said in the heartbeat's note, tried again each second.
    """

    name = "laser_tracker"
    rate_hz = 10.0

    laser = Output(topics.SENSOR_LASER)

    def __init__(self, config: LaserTrackerConfig, vessel: Vessel, deployment: Deployment) -> None:
        folder = deployment.config_path.parent if deployment.config_path else Path()
        self._dots = DotTracker(laser_module(config.calibration and folder / config.calibration))
        self._config = config
        self._run_dir = deployment.run_dir
        sensor = vessel.sensor("laser")
        self._period_s = sensor.sample_time_s if sensor else 0.5
        self._source: Source | None = None
        self._retry_s = 0.0
        self._sampled_s = 0.0

    def files(self) -> list[int]:
        """Return the source's descriptor, while there is one."""
        fd = None if self._source is None else self._source.fileno()
        return [] if fd is None else [fd]

    def start(self, now_s: float) -> None:
        """Leave the other processor cores alone: the pictures are small."""
        cv2.setNumThreads(1)

    def step(self, now_s: float) -> None:
        """Measure in the newest picture, if a sample is due."""
        try:
            frame = self._next(now_s)
        except SourceError as error:
            self._close(str(error), now_s)
            return
        if frame is not None:
            self._publish(frame, now_s)

    def stop(self, now_s: float) -> None:
        """Close the source."""
        self._close("", now_s)

    def _next(self, now_s: float) -> Frame | None:
        """Return the picture of this sample, if it is there; raise SourceError."""
        if self._source is None:
            if now_s < self._retry_s:
                return None
            self._source = self._open()
            self._source.fileno()
        due = now_s - self._sampled_s >= (1.0 - _EARLY) * self._period_s
        if not (due or self._source.live):  # a camera's pictures are taken, lest they wake us again and again
            return None
        frame = self._source.read()
        if frame is None and not self._source.live:
            raise SourceError(f"{self._source.uri}: the recording has ended; it starts again")
        self.note = self._source.note
        return frame if due else None

    def _open(self) -> Source:
        config, uri = self._config, self._config.source
        uri = f"sim://{self._run_dir / SIMULATED}" if uri == "sim://" else uri
        return open_source(uri, self._run_dir, (config.width_px, config.height_px), config.camera)

    def _publish(self, frame: Frame, now_s: float) -> None:
        assert self._source is not None
        self._sampled_s = now_s
        stamp_ns = frame.stamp_ns if self._source.live else round(now_s * NS)
        found = self._dots.read(frame.image)
        self.laser.publish(
            SensorLaser(
                stamp_ns=stamp_ns,
                origin_ns=stamp_ns,
                distance_m=found.distance_m,
                angle_rad=found.angle_rad,
                lost=found.lost,
            )
        )

    def _close(self, problem: str, now_s: float) -> None:
        self.note, self._retry_s = problem[:400], now_s + RETRY_S
        if self._source is not None:
            self._source.close()
            self._source = None
