"""Live pictures that OpenCV reads: USB cameras with fixed settings, network streams."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from abc import abstractmethod

import cv2

from bus.clock import CLOCK
from camera_tracker.settings import CameraSettings
from camera_tracker.sources import Frame, Source, SourceError, as_image


class CaptureSource(Source):
    """A live source that OpenCV reads.

    OpenCV gives neither a descriptor nor a wait with a time limit, and opening takes up to seconds: so a thread opens
    and grabs, keeps the newest frame and writes an eventfd. No frame waits behind another.
    """

    def __init__(self, uri: str, settings: CameraSettings) -> None:
        super().__init__(uri)
        self._settings = settings
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._newest: Frame | None = None
        self._last = -1
        self._error = ""
        self._open = True
        self._thread = threading.Thread(target=self._grab, name=f"camera {uri}", daemon=True)
        self._thread.start()

    def fileno(self) -> int:
        """Return the eventfd."""
        return self._event

    def read(self) -> Frame | None:
        """Return the newest frame not yet read; raise SourceError when the source gives no more."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._event)
        with self._lock:
            frame, self._newest = self._newest, None
            error = self._error
        if frame is not None:
            self.dropped += frame.index - self._last - 1
            self._last = frame.index
            if error:  # after the last frame, the next call tells it
                os.eventfd_write(self._event, 1)
        elif error:
            raise SourceError(error)
        return frame

    def close(self) -> None:
        """Stop the thread; it releases the capture, if need be after the driver's own time limit."""
        with self._lock:
            if not self._open:
                return
            self._open = False
            os.close(self._event)
        self._thread.join(timeout=0.5)

    @abstractmethod
    def _opened(self) -> cv2.VideoCapture:
        """Open the capture; called in the thread."""

    def _stamp_ns(self, capture: cv2.VideoCapture) -> int:
        """Return when the frame just grabbed was exposed, as well as is known: now, less the latency that is set."""
        return CLOCK.now_ns() - round(self._settings.latency_ms * 1e6)

    def _grab(self) -> None:
        capture = self._opened()
        index = 0
        while self._open and capture.grab():
            stamp_ns = self._stamp_ns(capture)
            ok, image = capture.retrieve()
            if not ok:
                break
            self._hand_over(Frame(as_image(image), stamp_ns, index), "")
            index += 1
        self._hand_over(None, f"{self.uri}: the camera {'gives no more frames' if index else 'cannot be opened'}")
        capture.release()

    def _hand_over(self, frame: Frame | None, error: str) -> None:
        with self._lock:
            if self._open:
                self._newest = frame or self._newest
                self._error = error
                os.eventfd_write(self._event, 1)


class CameraSource(CaptureSource):
    """A camera by its device, with exposure, gain, focus and white balance as configured.

    The driver stamps a frame on the monotonic clock; on UVC at the start of the exposure, half of which is added.
    `note` names the settings that the camera did not take.
    """

    def __init__(
        self, device: str, size_px: tuple[int, int] | None = None, settings: CameraSettings | None = None
    ) -> None:
        if not os.path.exists(device):
            raise SourceError(
                f"{device}: no such camera; is it plugged in? `starboard camera list` shows those there are"
            )
        if not os.access(device, os.R_OK):
            raise SourceError(f"{device}: no right to read; add the user to the group 'video'")
        self._size_px = size_px
        super().__init__(device, settings or CameraSettings())

    def _opened(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(self.uri)
        if capture.isOpened():
            self.note = configure(capture, self._size_px, self._settings)
        return capture

    def _stamp_ns(self, capture: cv2.VideoCapture) -> int:
        latency_ns = round(self._settings.latency_ms * 1e6)
        now_ns, age_ns = CLOCK.now_ns(), time.monotonic_ns() - round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if not 0 <= age_ns < _OLDEST_STAMP_NS:  # no stamp by the driver, or on another clock
            age_ns = 0
        elif self._settings.exposure_ms is not None:
            latency_ns -= round(0.5e6 * self._settings.exposure_ms)
        return now_ns - age_ns - latency_ns


_OLDEST_STAMP_NS = 1_000_000_000
_MANUAL_EXPOSURE = 1.0  # V4L2_EXPOSURE_MANUAL
_EXPOSURE_UNIT_MS = 0.1  # of V4L2_CID_EXPOSURE_ABSOLUTE
_TOLERANCE = 0.1
"""A camera rounds what it is asked for."""


def configure(capture: cv2.VideoCapture, size_px: tuple[int, int] | None, settings: CameraSettings) -> str:
    """Ask a camera for size and settings; return one line that names what it did not take, or nothing.

    The automatics go off before the value they would change is set; the format comes before the size it allows.
    """
    asked: list[tuple[str, int, float | None]] = []
    if settings.pixel_format is not None:
        asked.append(("pixel_format", cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.pixel_format)))
    if size_px is not None:
        asked += [("width", cv2.CAP_PROP_FRAME_WIDTH, size_px[0]), ("height", cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])]
    asked.append(("rate_hz", cv2.CAP_PROP_FPS, settings.rate_hz))
    if settings.exposure_ms is not None:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
        asked.append(("exposure_ms", cv2.CAP_PROP_EXPOSURE, settings.exposure_ms / _EXPOSURE_UNIT_MS))
    if settings.focus is not None:
        capture.set(cv2.CAP_PROP_AUTOFOCUS, 0.0)
    if settings.white_balance_k is not None:
        capture.set(cv2.CAP_PROP_AUTO_WB, 0.0)
    asked += [
        ("gain", cv2.CAP_PROP_GAIN, settings.gain),
        ("focus", cv2.CAP_PROP_FOCUS, settings.focus),
        ("white_balance_k", cv2.CAP_PROP_WB_TEMPERATURE, settings.white_balance_k),
    ]
    refused = []
    for name, key, value in asked:
        if value is None:
            continue
        taken = capture.set(key, value)
        if not taken or abs(capture.get(key) - value) > _TOLERANCE * max(abs(value), 1.0):
            refused.append(name)
    return f"the camera does not take {', '.join(refused)}" if refused else ""


_STREAM_TIMEOUT_MS = 3000


class StreamSource(CaptureSource):
    """A network camera. Stamped when a frame arrives, less `latency_ms`: the camera's own delay has to be measured."""

    def _opened(self) -> cv2.VideoCapture:
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            _STREAM_TIMEOUT_MS,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            _STREAM_TIMEOUT_MS,
        ]
        return cv2.VideoCapture(self.uri, cv2.CAP_FFMPEG, limits)
