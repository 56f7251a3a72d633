"""Every kind of picture source, whole and damaged."""

from __future__ import annotations

import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from camera_tracker.live import CameraSource
from camera_tracker.sources import (
    Frame,
    FrameWriter,
    Image,
    Source,
    SourceError,
    open_source,
)

W, H = 32, 24


def plain(value: int, width: int = W, height: int = H) -> Image:
    return np.full((height, width, 3), value, np.uint8)


def awake(source: Source, timeout_s: float = 0.0) -> bool:
    fd = source.fileno()
    assert fd is not None
    return bool(select.select([fd], [], [], timeout_s)[0])


def wait_for_frame(source: Source) -> Frame | None:
    assert awake(source, 10.0), "nothing woke the reader"
    return source.read()


def all_frames(source: Source) -> list[Frame]:
    return list(iter(source.read, None))


@pytest.fixture
def ring(tmp_path: Path) -> Iterator[tuple[FrameWriter, Source]]:
    writer = FrameWriter(tmp_path / "camera", W, H)
    source = open_source("sim://", tmp_path)
    yield writer, source
    source.close()
    writer.close()


def test_a_written_frame_wakes_the_reader_and_is_read_once(ring: tuple[FrameWriter, Source]) -> None:
    writer, source = ring
    source.fileno()
    writer.write(plain(7), stamp_ns=123)
    frame = wait_for_frame(source)
    assert frame is not None
    assert (frame.stamp_ns, frame.index, frame.image.shape) == (123, 0, (H, W, 3))
    assert (frame.image == 7).all()
    assert source.read() is None
    assert not awake(source)


def test_only_the_newest_frame_is_read_and_the_others_are_counted(ring: tuple[FrameWriter, Source]) -> None:
    writer, source = ring
    for i in range(10):
        writer.write(plain(i), stamp_ns=i)
    frame = source.read()
    assert frame is not None
    assert frame.index == 9
    assert source.dropped == 9


def test_a_frame_drawn_in_the_ring_is_read_when_it_is_written(ring: tuple[FrameWriter, Source]) -> None:
    writer, source = ring
    for i in range(6):  # once around the ring, and further
        canvas = writer.blank()
        canvas[:] = 10 * i
        assert source.read() is None
        assert writer.write(canvas, stamp_ns=i) == i
        frame = source.read()
        assert frame is not None
        assert (frame.index, frame.stamp_ns, int(frame.image.max())) == (i, i, 10 * i)


def test_frames_from_before_the_reader_came_are_not_news(tmp_path: Path) -> None:
    writer = FrameWriter(tmp_path, W, H)
    writer.write(plain(1), stamp_ns=1)
    source = open_source(f"sim://{tmp_path}", Path("/nowhere"))
    assert source.read() is None
    writer.write(plain(2), stamp_ns=2)
    frame = source.read()
    assert frame is not None
    assert frame.stamp_ns == 2
    assert source.dropped == 0


def test_reader_survives_a_writer_that_dies_and_comes_back(ring: tuple[FrameWriter, Source], tmp_path: Path) -> None:
    writer, source = ring
    source.fileno()
    writer.write(plain(1), stamp_ns=1)
    wait_for_frame(source)
    writer.close()
    assert not awake(source), "a dead writer must not wake the reader for ever"
    again = FrameWriter(tmp_path / "camera", W, H)
    again.write(plain(2), stamp_ns=2)
    frame = wait_for_frame(source)
    assert frame is not None
    assert (frame.index, frame.stamp_ns) == (1, 2)
    again.close()


def test_writer_never_blocks_without_a_reader(tmp_path: Path) -> None:
    writer = FrameWriter(tmp_path, 2, 2)
    for i in range(9000):  # the FIFO holds 8192
        writer.write(plain(0, 2, 2), stamp_ns=i)
    source = open_source(f"sim://{tmp_path}", tmp_path)
    source.fileno()
    writer.write(plain(9, 2, 2), stamp_ns=9999)
    frame = wait_for_frame(source)
    assert frame is not None
    assert frame.stamp_ns == 9999
    assert source.read() is None


def test_a_writer_of_another_size_replaces_the_ring(ring: tuple[FrameWriter, Source], tmp_path: Path) -> None:
    _, source = ring
    other = FrameWriter(tmp_path / "camera", W + 2, H)
    with pytest.raises(SourceError, match="removed or replaced"):
        source.read()
    again = open_source("sim://", tmp_path)
    other.write(plain(5, W + 2), stamp_ns=5)
    frame = again.read()
    assert frame is not None
    assert frame.image.shape == (H, W + 2, 3)


def test_frames_of_another_process_are_never_torn(tmp_path: Path) -> None:
    FrameWriter(tmp_path, 320, 240)
    source = open_source(f"sim://{tmp_path}", tmp_path)
    script = f"""
import numpy as np
from pathlib import Path
from camera_tracker.sources import FrameWriter
writer, i = FrameWriter(Path({str(tmp_path)!r}), 320, 240), 0
while True:
    writer.write(np.full((240, 320, 3), i % 251, np.uint8), stamp_ns=i)
    i += 1
"""
    writer = subprocess.Popen([sys.executable, "-c", script])
    try:
        seen = 0
        while seen < 200:
            frame = source.read() or wait_for_frame(source)
            if frame is not None:
                seen += 1
                assert (frame.image == frame.stamp_ns % 251).all()
                assert frame.index == frame.stamp_ns
    finally:
        writer.kill()
        writer.wait()
    assert source.dropped > 0, "the writer was meant to be faster than the reader"


def test_a_frame_that_is_being_overwritten_is_refused(ring: tuple[FrameWriter, Source], tmp_path: Path) -> None:
    writer, source = ring
    writer.write(plain(1), stamp_ns=1)
    with (tmp_path / "camera" / "frames.ring").open("r+b") as file:
        file.seek(64)
        file.write((2 * 4 + 1).to_bytes(8, "little"))  # frame 4 goes into the same slot
    assert source.read() is None
    writer.write(plain(2), stamp_ns=2)
    frame = source.read()
    assert frame is not None
    assert frame.stamp_ns == 2


def test_writer_refuses_a_frame_of_the_wrong_shape(ring: tuple[FrameWriter, Source]) -> None:
    with pytest.raises(ValueError, match=r"expected \(24, 32, 3\)"):
        ring[0].write(plain(0, W + 1), stamp_ns=0)


@pytest.mark.parametrize("content", [b"", b"x" * 10, b"x" * 1000, b"STARCAM1" + b"\x01" * 200])
def test_a_file_that_is_no_ring_is_refused_by_readers_and_replaced_by_writers(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "frames.ring").write_bytes(content)
    with pytest.raises(SourceError):
        open_source(f"sim://{tmp_path}", tmp_path)
    FrameWriter(tmp_path, W, H).write(plain(0), stamp_ns=0)
    assert open_source(f"sim://{tmp_path}", tmp_path).read() is None


# --- files ------------------------------------------------------------------------------------------------------


def test_a_folder_is_read_in_natural_order_and_what_is_no_picture_is_left_out(tmp_path: Path) -> None:
    for i in (10, 9, 1):
        cv2.imwrite(str(tmp_path / f"frame{i}.png"), plain(i))
    (tmp_path / "frame2.png").write_bytes(b"not a picture")
    (tmp_path / "notes.txt").write_text("x")
    source = open_source(str(tmp_path), tmp_path)
    assert [int(frame.image[0, 0, 0]) for frame in all_frames(source)] == [1, 9, 10]
    assert source.skipped == ["frame2.png"]
    assert source.fileno() is None


@pytest.mark.parametrize(
    "picture",
    [
        np.full((4, 5, 3), 65535, np.uint16),
        np.full((4, 5), 4095, np.uint16),
        np.full((4, 5), 255, np.uint8),
        np.full((1, 1, 3), 255, np.uint8),
    ],
    ids=["16 bit", "12 of 16 bit", "grey", "1x1"],
)
def test_unusual_pictures_become_8_bit_bgr(tmp_path: Path, picture: Image) -> None:
    path = tmp_path / "picture.png"
    cv2.imwrite(str(path), picture)
    (frame,) = all_frames(open_source(str(path), tmp_path))
    assert frame.image.dtype == np.uint8
    assert frame.image.shape == (*picture.shape[:2], 3)
    assert (frame.image == 255).all()


def test_damaged_files_end_in_one_line(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "whole.bmp"), plain(1))
    (tmp_path / "half.bmp").write_bytes((tmp_path / "whole.bmp").read_bytes()[:30])
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "noise.mp4").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "nothing").mkdir()
    for name, reason in {
        "half.bmp": "not a picture",
        "empty.png": "empty",
        "noise.mp4": "not a video",
        "nothing": "no pictures",
        "absent.png": "no such file",
        "/dev/video97": "no such camera",
        "97": "no such camera",
    }.items():
        uri = name if name.startswith("/") or name.isdecimal() else str(tmp_path / name)
        with pytest.raises(SourceError, match=reason) as raised:
            all_frames(open_source(uri, tmp_path))
        assert "\n" not in str(raised.value)


def make_video(path: Path, frames: int) -> None:
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (64, 48))
    for i in range(frames):
        video.write(plain(10 * i, 64, 48))
    video.release()


def test_a_video_gives_each_frame_and_ends(tmp_path: Path) -> None:
    make_video(tmp_path / "video.mp4", 8)
    source = open_source(str(tmp_path / "video.mp4"), tmp_path)
    frames = all_frames(source)
    assert [frame.index for frame in frames] == list(range(8))
    assert frames[5].stamp_ns == pytest.approx(5 / 25.0 * 1e9)
    assert source.read() is None
    source.close()


def test_a_truncated_video_is_told(tmp_path: Path) -> None:
    make_video(tmp_path / "video.mp4", 8)
    content = (tmp_path / "video.mp4").read_bytes()
    (tmp_path / "video.mp4").write_bytes(content[: len(content) // 2])
    with pytest.raises(SourceError, match="not a video"):
        open_source(str(tmp_path / "video.mp4"), tmp_path)


def test_a_camera_hands_over_its_newest_frame_until_it_is_unplugged(tmp_path: Path) -> None:
    make_video(tmp_path / "device.mp4", 8)  # OpenCV opens it as it does a device; its end is the unplugging
    source = CameraSource(str(tmp_path / "device.mp4"))
    seen: list[int] = []

    def read_on() -> None:
        while True:
            frame = wait_for_frame(source)
            if frame is not None:
                seen.append(frame.index)

    with pytest.raises(SourceError, match="no more frames"):
        read_on()
    assert seen == sorted(set(seen))
    assert seen[-1] == 7
    assert source.dropped <= 7
    source.close()
    source.close()


def test_a_device_that_is_no_camera_is_told() -> None:
    source = open_source("/dev/null", Path("/nowhere"))
    with pytest.raises(SourceError, match="cannot be opened"):
        wait_for_frame(source)
    source.close()
