"""Where pictures come from: a camera, a stream, the bus, a video, a folder, or the simulator's shared memory (`sim://`).

Layout of `sim://DIRECTORY`, all little-endian. `frames.ring` is mapped by writer and reader:

    0   magic b"STARCAM1", u32 width, u32 height, u32 slots, u32 0, u64 count of frames written; up to byte 64
    64  slots, each: u64 lock, i64 stamp_ns, up to byte 64; then height x width x 3 bytes BGR

Frame i (from 0) is in slot i % slots. Its lock is 2 i + 1 while it is written and 2 i + 2 when it is complete: a reader
that finds another value before or after copying has a torn frame. `frames.fifo` carries 8 bytes (i) per frame, only to
wake the reader. Either side may die and come back.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import re
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bus.messages import CameraImage
from camera_tracker.settings import CameraSettings

Image = NDArray[np.uint8]
"""BGR picture, shape (height, width, 3)."""

PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm"})

# A damaged file is told in one SourceError, not beside it as well.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

_MAGIC = b"STARCAM1"
_HEADER = struct.Struct("<8sIIII")
_COUNT = struct.Struct("<Q")
_SLOT = struct.Struct("<Qq")
_COUNT_AT = 24
_BLOCK = 64
_SLOTS = 4
_RING, _FIFO = "frames.ring", "frames.fifo"


BUS_URI = "bus://camera/image"
STREAMS = ("rtsp://", "rtsps://", "http://", "https://")


class SourceError(Exception):
    """A source that cannot be opened or gives no more pictures; one line that says what is wrong."""


@dataclass(frozen=True)
class Frame:
    """One picture. `stamp_ns`: capture time, UNIX ns if the source is live, else from the start of the recording."""

    image: Image
    stamp_ns: int
    index: int


class Source(ABC):
    """A stream of pictures. `dropped` counts live frames that were overtaken by newer ones."""

    live = True
    """Whether frames come by themselves; otherwise each `read` gives the next one, and the caller sets the pace."""
    frames_total: int | None = None
    """How many frames a recording has, where known."""

    def __init__(self, uri: str) -> None:
        self.uri = uri
        self.dropped = 0
        self.skipped: list[str] = []
        """Files of a folder that are no pictures."""
        self.note = ""
        """What is wrong though pictures come, such as a setting that the camera did not take."""

    def fileno(self) -> int | None:
        """Return the descriptor that becomes readable with a new frame, None for a recording."""
        return None

    @abstractmethod
    def read(self) -> Frame | None:
        """Return the newest frame (recording: the next), None when there is none; raise SourceError on failure."""

    def close(self) -> None:  # noqa: B027 - most sources hold nothing
        """Release what the source holds; a second call does nothing."""


def open_source(
    uri: str, run_dir: Path, size_px: tuple[int, int] | None = None, settings: CameraSettings | None = None
) -> Source:
    """Open `/dev/video0` or a number, a stream, `bus://camera/image`, a video, a folder, a picture, `sim://[DIR]`.

    `size_px` (width, height) and `settings` are asked of a camera. Raises SourceError.
    """
    from camera_tracker.live import CameraSource, StreamSource  # which is made of what stands here

    settings = settings or CameraSettings()
    if uri == BUS_URI:
        return BusSource(uri)
    if uri.startswith("sim://"):
        return SharedFrames(uri, Path(uri[6:]) if uri[6:] else run_dir / "camera")
    if uri.startswith(STREAMS):
        return StreamSource(uri, settings)
    path = Path(f"/dev/video{uri}" if uri.isdecimal() else uri)
    if path.is_char_device() or str(path).startswith("/dev/"):
        return CameraSource(str(path), size_px, settings)
    if path.is_dir():
        return PictureSource(uri, [p for p in sorted(path.iterdir(), key=_natural) if _is_picture(p)])
    if not path.is_file():
        raise SourceError(f"{uri}: no such file, folder or camera")
    if path.stat().st_size == 0:
        raise SourceError(f"{uri}: the file is empty")
    return PictureSource(uri, [path]) if _is_picture(path) else VideoSource(uri)


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in PICTURE_SUFFIXES


def _natural(path: Path) -> list[Any]:
    """Sort frame2 before frame10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


class PictureSource(Source):
    """Pictures from files, in natural order of their names, one second apart."""

    live = False

    def __init__(self, uri: str, paths: list[Path]) -> None:
        super().__init__(uri)
        if not paths:
            raise SourceError(f"{uri}: no pictures in this folder ({', '.join(sorted(PICTURE_SUFFIXES))})")
        self.frames_total = len(paths)
        self._paths = paths
        self._next = 0

    def read(self) -> Frame | None:
        """Return the next picture as 8-bit BGR; raise SourceError when not one file is a picture."""
        while self._next < len(self._paths):
            index, path = self._next, self._paths[self._next]
            self._next += 1
            with contextlib.suppress(cv2.error):
                image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
                if image is not None and image.dtype in {np.dtype(np.uint8), np.dtype(np.uint16)}:
                    return Frame(as_image(_eight_bits(image)), index * 1_000_000_000, index)
            self.skipped.append(path.name)
        if len(self.skipped) == len(self._paths):
            raise SourceError(f"{self.uri}: not a picture that can be read (damaged, or another format)")
        return None


class VideoSource(Source):
    """A video file."""

    live = False

    def __init__(self, uri: str) -> None:
        super().__init__(uri)
        self._capture = cv2.VideoCapture(uri)
        if not self._capture.isOpened():
            raise SourceError(f"{uri}: not a video or picture that can be read (damaged, or another format)")
        fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.rate_hz = fps if 0.1 < fps < 1000.0 else 30.0
        self.frames_total = max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))) or None
        self._next = 0

    def read(self) -> Frame | None:
        """Return the next frame, None at the end; raise SourceError when there was not even one."""
        ok, image = self._capture.read()
        if not ok:
            if self._next == 0:
                raise SourceError(f"{self.uri}: the video has no frame that can be decoded")
            return None
        index, self._next = self._next, self._next + 1
        return Frame(as_image(image), round(index * 1e9 / self.rate_hz), index)

    def close(self) -> None:
        """Release the decoder."""
        self._capture.release()


class BusSource(Source):
    """Pictures of `camera/image`, from another machine or a replay; the service hands them over."""

    def __init__(self, uri: str) -> None:
        super().__init__(uri)
        self._next: CameraImage | None = None

    def offer(self, image: CameraImage) -> None:
        """Hand over a picture; one that was not read yet is dropped."""
        self.dropped += self._next is not None
        self._next = image

    def read(self) -> Frame | None:
        """Return the picture handed over last; None also when it cannot be decoded, which `note` tells."""
        image, self._next = self._next, None
        if image is None or not image.data:
            return None
        decoded = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
        self.note = "" if decoded is not None else "the bus carries a picture that cannot be decoded"
        return None if decoded is None else Frame(as_image(decoded), image.stamp_ns, image.frame)


class FrameWriter:
    """The simulator's end of `sim://directory`. Never blocks; an existing ring of the same size is continued."""

    def __init__(self, directory: Path, width: int, height: int) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._size = (width, height)
        ring = directory / _RING
        try:
            self._map = _map_ring(ring)
            same = _geometry(self._map) == (width, height, _SLOTS)
        except (OSError, ValueError):
            same = False
        if not same:  # in place of the old file, which a reader may still have mapped
            fresh = ring.with_suffix(f".{os.getpid()}")
            with fresh.open("wb") as file:
                file.write(_HEADER.pack(_MAGIC, width, height, _SLOTS, 0))
                file.truncate(_BLOCK + _SLOTS * (_BLOCK + width * height * 3))
            fresh.rename(ring)
            self._map = _map_ring(ring)
        self._slots = _slot_views(self._map)
        with contextlib.suppress(FileExistsError):
            os.mkfifo(directory / _FIFO)
        # Also the reading end: then opening never waits for a reader, and a reader's death raises nothing here.
        self._fifo = os.open(directory / _FIFO, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def blank(self) -> Image:
        """Return the next frame's place in the ring, with an old picture in it: what is drawn there is not copied."""
        index, slot = self._next()
        self._lock(slot, 2 * index + 1, 0)
        return self._slots[slot]

    def write(self, image: Image, stamp_ns: int) -> int:
        """Write a frame with its capture time (UNIX ns) and return its index; ValueError when its shape is wrong."""
        width, height = self._size
        if image.shape != (height, width, 3) or image.dtype != np.uint8:
            raise ValueError(f"got a frame {image.shape} {image.dtype}, expected ({height}, {width}, 3) uint8")
        index, slot = self._next()
        if image is not self._slots[slot]:
            self._lock(slot, 2 * index + 1, stamp_ns)
            np.copyto(self._slots[slot], image)
        self._lock(slot, 2 * index + 2, stamp_ns)
        _COUNT.pack_into(self._map, _COUNT_AT, index + 1)
        with contextlib.suppress(BlockingIOError):  # full: nobody has read for minutes
            os.write(self._fifo, _COUNT.pack(index))
        return index

    def _next(self) -> tuple[int, int]:
        index = int(_COUNT.unpack_from(self._map, _COUNT_AT)[0])
        return index, index % _SLOTS

    def _lock(self, slot: int, lock: int, stamp_ns: int) -> None:
        _SLOT.pack_into(self._map, _slot_at(slot, self._slots[slot].nbytes), lock, stamp_ns)

    def close(self) -> None:
        """Let go of the files; they stay, so that a reader waits for the next writer."""
        if self._fifo >= 0:
            os.close(self._fifo)
            self._fifo = -1


class SharedFrames(Source):
    """The reader's end of `sim://directory`.

    The FIFO is opened when `fileno` is first asked for: who only polls takes no wake-ups from the tracker.
    """

    def __init__(self, uri: str, directory: Path) -> None:
        super().__init__(uri)
        self._directory = directory
        self._fifo = -1
        try:
            self._map = _map_ring(directory / _RING)
            self._inode = (directory / _RING).stat().st_ino
        except OSError:
            raise SourceError(f"{uri}: no simulator has written frames in {directory}") from None
        except ValueError as error:
            raise SourceError(f"{uri}: {directory / _RING}: {error}") from None
        self._slots = _slot_views(self._map)
        self._read = self._count()  # what was written before is stale

    def _count(self) -> int:
        return int(_COUNT.unpack_from(self._map, _COUNT_AT)[0])

    def fileno(self) -> int:
        """Return the FIFO; as a writer of it as well, the reader sees no end of file when the simulator dies."""
        if self._fifo < 0:
            try:
                self._fifo = os.open(self._directory / _FIFO, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                raise SourceError(f"{self.uri}: {self._directory / _FIFO}: {error.strerror}") from None
        return self._fifo

    def read(self) -> Frame | None:
        """Return a copy of the newest frame not yet read; raise SourceError when the ring was replaced or removed."""
        if self._fifo >= 0:
            with contextlib.suppress(BlockingIOError):
                os.read(self._fifo, 65536)
        for _ in range(3):  # a torn frame means that a newer one is there
            count = self._count()
            if count <= self._read:
                self._check_ring()
                return None
            index = count - 1
            slot = index % len(self._slots)
            at = _slot_at(slot, self._slots[slot].nbytes)
            lock, stamp_ns = _SLOT.unpack_from(self._map, at)
            image = self._slots[slot].copy()
            if lock == 2 * index + 2 == _SLOT.unpack_from(self._map, at)[0]:
                self.dropped += index - self._read
                self._read = count
                return Frame(image, stamp_ns, index)
        return None

    def _check_ring(self) -> None:
        try:
            same = (self._directory / _RING).stat().st_ino == self._inode
        except OSError:
            same = False
        if not same:
            raise SourceError(f"{self.uri}: the simulator's frames were removed or replaced")

    def close(self) -> None:
        """Close the FIFO."""
        if self._fifo >= 0:
            os.close(self._fifo)
            self._fifo = -1


def _map_ring(path: Path) -> mmap.mmap:
    """Map a ring; raise OSError when it is absent, ValueError when it is none."""
    with path.open("r+b") as file:
        ring = mmap.mmap(file.fileno(), 0)
    if len(ring) < _BLOCK or ring[:8] != _MAGIC:
        raise ValueError("not a ring of frames")
    width, height, slots = _geometry(ring)
    if len(ring) != _BLOCK + slots * (_BLOCK + width * height * 3):
        raise ValueError("the ring of frames has the wrong length")
    return ring


def _geometry(ring: mmap.mmap) -> tuple[int, int, int]:
    _, width, height, slots, _ = _HEADER.unpack_from(ring, 0)
    return width, height, slots


def _slot_at(slot: int, nbytes: int) -> int:
    return _BLOCK + slot * (_BLOCK + nbytes)


def _slot_views(ring: mmap.mmap) -> list[Image]:
    width, height, slots = _geometry(ring)
    size = width * height * 3
    return [
        np.frombuffer(ring, np.uint8, size, _slot_at(slot, size) + _BLOCK).reshape(height, width, 3)
        for slot in range(slots)
    ]


def _eight_bits(image: NDArray[Any]) -> NDArray[Any]:
    """Return a picture of 8 or 16 bits with 8; cameras of 10, 12 and 14 bits fill the lower ones of 16."""
    if image.dtype == np.uint8:
        return image
    used = max(int(image.max()).bit_length(), 8)
    return image >> (used + used % 2 - 8)


def as_image(image: Any) -> Image:
    """Return a decoded picture as uint8 (rows, columns, 3)."""
    return np.ascontiguousarray(image, dtype=np.uint8)
