"""The camera tracker as a process: a pose for each frame, and the picture for page and log."""

from __future__ import annotations

import cv2

from bus import topics
from bus.clock import NS
from bus.config import Deployment
from bus.messages import CameraImage, CameraPose, CameraStatus
from bus.service import Input, Output, Service
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.detectors.base import Detection
from camera_tracker.metres import metres_for
from camera_tracker.sources import BUS_URI, BusSource, Frame, Source, SourceError, open_source
from camera_tracker.tracking import Tracker
from marine.vessel import Vessel

JPEG_QUALITY = 80
RETRY_S = 1.0
SILENCE_S = 1.0
"""A live source without a frame for so long counts as missing; it stays open."""
TOLD_AFTER_S = 3.0
"""No picture for so long is a line in the log: longer than a recording takes to begin again."""
STATUS_PERIOD_S = 1.0


class CameraTracker(Service):
    """Publish the pose of each vehicle in each frame, stamped with the frame's capture time.

    A frame wakes the loop. The picture is compressed after the pose is out. A recording gives one frame a step, stamped
    with the time of the step, and starts again at its end. No camera: said in the status, tried again each second.
    """

    name = "camera_tracker"
    rate_hz = 10.0

    pose = Output(topics.CAMERA_POSE)
    status = Output(topics.CAMERA_STATUS)
    image = Output(topics.CAMERA_IMAGE)
    feed = Input(topics.CAMERA_IMAGE, max_age_s=SILENCE_S, wakes=True)
    """Another machine's pictures; read only when the source is `bus://camera/image`, and then none are published."""

    def __init__(self, config: CameraTrackerConfig, vessel: Vessel, deployment: Deployment) -> None:
        self._metres = metres_for(config, vessel, deployment.config_path)
        self._config = config.with_default_marker(vessel.name, self._metres.scale_px_per_m)
        self._run_dir = deployment.run_dir
        unused = "image" if config.source == BUS_URI else "feed"
        self.ports = {n: p for n, p in self.ports.items() if n != unused}  # type: ignore[misc]  # of this object alone
        self._image_rate_hz = 0.0 if config.source == BUS_URI else config.image_rate_hz
        self._source: Source | None = None
        self._tracker = Tracker(self._config)
        self._error = ""
        self._state: tuple[str, str] = ("", "")  # state and error as told last
        self._retry_s = 0.0
        self._last_frame_s = 0.0
        self._picture_s = 0.0
        self._blind = False
        self._last_image_s = 0.0
        self._size = (0, 0)
        self._visible = False
        self._frames = self._poses = self._dropped = 0
        self._window = _Window()

    def files(self) -> list[int]:
        """Return the source's descriptor, while there is one."""
        fd = None if self._source is None else self._source.fileno()
        return [] if fd is None else [fd]

    def start(self, now_s: float) -> None:
        """Open the source, if it is there."""
        cv2.setNumThreads(1)  # the pictures are small: more threads cost more than they give
        self._window = _Window(now_s)
        self._picture_s = now_s
        self._open(now_s)

    def step(self, now_s: float) -> None:
        """Track the newest frame, if there is one."""
        if self._source is None and now_s >= self._retry_s:
            self._open(now_s)
        if isinstance(self._source, BusSource) and self.feed.updated:
            self._feed(self._source, now_s)
        frame = self._read(now_s)
        if frame is not None:
            self._take(frame, now_s)
            self._picture_s = now_s
        self._note(now_s)
        self._tell(now_s)

    def stop(self, now_s: float) -> None:
        """Close the source."""
        self._close()

    def _feed(self, source: BusSource, now_s: float) -> None:
        image = self.feed.fresh(now_s)
        if image is not None:
            source.offer(image)
        elif self.feed.latest is not None:
            age_s = now_s - self.feed.latest.stamp_ns / NS
            source.note = f"{source.uri}: pictures are {age_s:.1f} s old: are the machines' clocks alike?"

    def _open(self, now_s: float) -> None:
        self._retry_s = now_s + RETRY_S
        try:
            self._source = open_source(self._config.source, self._run_dir, self._metres.size_px, self._config.camera)
            self._source.fileno()
            self._last_frame_s = now_s
        except SourceError as error:
            self._lose(str(error))

    def _lose(self, error: str) -> None:
        self._close()
        self._error, self._visible = error, False

    def _close(self) -> None:
        if self._source is not None:
            self._dropped += self._source.dropped
            self._source.close()
            self._source = None

    def _read(self, now_s: float) -> Frame | None:
        """Return the frame to work on; note what is wrong when there is none."""
        if self._source is None:
            return None
        try:
            frame = self._source.read()
        except SourceError as error:
            self._retry_s = now_s + RETRY_S
            self._lose(str(error))
            return None
        if frame is not None:
            self._last_frame_s = now_s
            self._error = self._source.note
        elif not self._source.live:
            self._retry_s = now_s + RETRY_S
            self._lose(f"{self._source.uri}: the recording has ended; it starts again")
        elif now_s - self._last_frame_s > SILENCE_S:
            silence = f"{self._source.uri}: no frame for {SILENCE_S:.0f} s"
            self._error, self._visible = self._source.note or silence, False
        return frame

    def _take(self, frame: Frame, now_s: float) -> None:
        """Publish what is seen in a frame."""
        assert self._source is not None
        stamp_ns = frame.stamp_ns if self._source.live else round(now_s * NS)
        found = self._tracker.track(frame.image, stamp_ns)
        for name, detection in found.items():
            self._publish(name, detection, frame.index, stamp_ns)
        height, width = frame.image.shape[:2]
        if (width, height) != self._metres.size_px and self._config.scale_px_per_m is None:
            expected, teller = " x ".join(str(v) for v in self._metres.size_px), self._metres.told_by
            self._error = f"the picture has {width} x {height} px, {teller} says {expected}: metres are wrong"
        self._size, self._visible = (width, height), bool(found)
        self._frames += 1
        self._poses += len(found)
        self._window.add(now_s - stamp_ns / NS)
        if self._image_rate_hz > 0 and now_s - self._last_image_s > 0.99 / self._image_rate_hz:
            self._last_image_s = now_s
            self._publish_image(frame, stamp_ns)

    def _publish(self, name: str, found: Detection, index: int, stamp_ns: int) -> None:
        self.pose.publish(
            CameraPose(
                stamp_ns=stamp_ns,
                origin_ns=stamp_ns,
                name=name,
                frame=index,
                x_px=found.x_px,
                y_px=found.y_px,
                heading_ambiguous=found.heading_ambiguous,
                region_px=found.region,
                **{"quality": found.quality, "reason": found.reason, **self._metres.fields(name, found)},
            )
        )

    def _publish_image(self, frame: Frame, stamp_ns: int) -> None:
        height, width = frame.image.shape[:2]
        ok, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if ok:
            self.image.publish(
                CameraImage(
                    stamp_ns=stamp_ns,
                    origin_ns=stamp_ns,
                    frame=frame.index,
                    width_px=width,
                    height_px=height,
                    data=data.tobytes(),
                )
            )

    def _note(self, now_s: float) -> None:
        """Say once in the log that there are no pictures and why, and once that they are back."""
        blind = now_s - self._picture_s > TOLD_AFTER_S
        if blind and not self._blind:
            self.log.warning("%s", self._error or f"{self._config.source}: no frame for {TOLD_AFTER_S:.0f} s")
        elif self._blind and not blind:
            self.log.info("%s: pictures again", self._config.source)
        self._blind = blind

    def _tell(self, now_s: float) -> None:
        """Publish the status once a second and at every change."""
        silent = self._source is None or now_s - self._last_frame_s > SILENCE_S
        state = "no_camera" if silent else "tracking" if self._visible else "searching"
        due = self._window.close(now_s)
        if not due and self._state == (state, self._error):
            return
        self._state = (state, self._error)
        self.status.publish(
            CameraStatus(
                state=state,
                error=self._error[:400],
                camera=self._config.source[:400],
                frames=self._frames,
                frames_dropped=self._dropped + (0 if self._source is None else self._source.dropped),
                poses=self._poses,
                rate_hz=self._window.rate_hz,
                latency_s=self._window.latency_s,
                width_px=self._size[0],
                height_px=self._size[1],
                scale_px_per_m=self._metres.scale_px_per_m,
            )
        )


class _Window:
    """Rate and mean latency of the frames of the last second."""

    def __init__(self, begin_s: float = 0.0) -> None:
        self.rate_hz = 0.0
        self.latency_s = 0.0
        self._begin_s = begin_s
        self._latencies: list[float] = []

    def add(self, latency_s: float) -> None:
        self._latencies.append(latency_s)

    def close(self, now_s: float) -> bool:
        """Work out the numbers if the second is over; return whether it is."""
        seconds = now_s - self._begin_s
        if seconds < STATUS_PERIOD_S:
            return False
        count = len(self._latencies)
        self.rate_hz = count / seconds
        self.latency_s = sum(self._latencies) / count if count else 0.0
        self._begin_s, self._latencies = now_s, []
        return True
