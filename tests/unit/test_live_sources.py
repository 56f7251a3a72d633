"""USB cameras with fixed settings, network streams that die and come back, the list of cameras, grabbing boards."""

from __future__ import annotations

import http.server
import select
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from camera_tracker import live
from camera_tracker.boards import Chessboard
from camera_tracker.devices import cameras
from camera_tracker.grabbing import grab_picture, grab_views
from camera_tracker.live import CameraSource, StreamSource, configure
from camera_tracker.settings import CameraSettings
from camera_tracker.sources import Frame, Image, Source, SourceError, open_source
from services.cli.camera import app as camera_app
from tests.rendered_board import LENS, looking, seen_flat


class FakeCapture:
    """A camera that notes what is asked of it; focus it has none, gain it rounds away."""

    def __init__(self, age_ms: float | None = None) -> None:
        self.order: list[int] = []
        self.values: dict[int, float] = {}
        self.age_ms = age_ms

    def set(self, key: int, value: float) -> bool:
        self.order.append(key)
        self.values[key] = 0.0 if key == cv2.CAP_PROP_GAIN else value
        return key != cv2.CAP_PROP_FOCUS

    def get(self, key: int) -> float:
        if key == cv2.CAP_PROP_POS_MSEC:
            return 0.0 if self.age_ms is None else time.monotonic() * 1e3 - self.age_ms
        return self.values.get(key, 0.0)


SETTINGS = CameraSettings(
    exposure_ms=5.0, gain=40.0, focus=10.0, white_balance_k=4600.0, pixel_format="MJPG", rate_hz=30.0, latency_ms=2.0
)


def test_a_camera_is_asked_for_what_is_configured_automatics_off_first() -> None:
    capture: Any = FakeCapture()
    note = configure(capture, (1280, 720), SETTINGS)
    assert note == "the camera does not take gain, focus"
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0, "V4L2's manual mode"
    assert capture.values[cv2.CAP_PROP_EXPOSURE] == 50.0, "in 0.1 ms"
    assert capture.values[cv2.CAP_PROP_AUTO_WB] == 0.0
    assert capture.values[cv2.CAP_PROP_WB_TEMPERATURE] == 4600.0
    order = capture.order
    assert order.index(cv2.CAP_PROP_AUTO_EXPOSURE) < order.index(cv2.CAP_PROP_EXPOSURE)
    assert order.index(cv2.CAP_PROP_AUTOFOCUS) < order.index(cv2.CAP_PROP_FOCUS)
    assert order.index(cv2.CAP_PROP_FOURCC) < order.index(cv2.CAP_PROP_FRAME_WIDTH)


def test_what_is_not_configured_is_left_alone() -> None:
    capture: Any = FakeCapture()
    assert configure(capture, None, CameraSettings()) == ""
    assert capture.order == []


@pytest.mark.parametrize(
    ("age_ms", "expected_ms"),
    [(20.0, -20.0 + 2.5 - 2.0), (None, -2.0), (5000.0, -2.0)],
    ids=["driver's stamp: mid-exposure", "no stamp", "another clock"],
)
def test_frames_are_stamped_at_mid_exposure_as_well_as_the_source_allows(
    age_ms: float | None, expected_ms: float, tmp_path: Path
) -> None:
    (tmp_path / "device").write_bytes(b"")
    source = CameraSource(str(tmp_path / "device"), None, SETTINGS)
    capture: Any = FakeCapture(age_ms)
    before = time.time_ns()
    stamp_ns = source._stamp_ns(capture)
    after = time.time_ns()
    assert before - 1e6 <= stamp_ns - expected_ms * 1e6 <= after + 1e6
    source.close()


class StreamServer:
    """A network camera: motion JPEG over HTTP."""

    def __init__(self, port: int = 0) -> None:
        ok, data = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))
        assert ok
        part = (
            b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data) + data.tobytes() + b"\r\n"
        )
        ended = self.ended = threading.Event()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                try:
                    while not ended.wait(0.01):
                        self.wfile.write(part)
                except OSError:
                    pass

            def log_message(self, format: str, *args: Any) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self.ended.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@pytest.fixture
def stream() -> Iterator[StreamServer]:
    server = StreamServer()
    yield server
    if not server.ended.is_set():
        server.stop()


def next_frame(source: Source, timeout_s: float = 10.0) -> Frame:
    fd = source.fileno()
    assert fd is not None
    while select.select([fd], [], [], timeout_s)[0]:
        frame = source.read()
        if frame is not None:
            return frame
    raise AssertionError("no frame")


def test_a_stream_is_read_lost_and_found_again(stream: StreamServer, tmp_path: Path) -> None:
    uri = f"http://127.0.0.1:{stream.port}/video"
    source = open_source(uri, tmp_path)
    assert isinstance(source, StreamSource)
    first, second = next_frame(source), next_frame(source)
    assert first.image.shape == (48, 64, 3)
    assert abs(int(first.image.mean()) - 90) <= 2
    assert second.index > first.index
    assert 0 <= time.time_ns() - second.stamp_ns < 2_000_000_000
    stream.stop()
    with pytest.raises(SourceError, match="gives no more frames"):
        all(next_frame(source) for _ in range(1000))
    source.close()
    back = StreamServer(stream.port)
    again = open_source(uri, tmp_path)
    assert next_frame(again).image.shape == (48, 64, 3)
    again.close()
    back.stop()


def test_a_stream_that_is_not_there_is_said_so(stream: StreamServer, tmp_path: Path) -> None:
    stream.stop()
    source = open_source(f"http://127.0.0.1:{stream.port}/video", tmp_path)
    with pytest.raises(SourceError, match="cannot be opened"):
        next_frame(source)
    source.close()


def test_cameras_are_listed_with_the_name_that_stays(tmp_path: Path) -> None:
    for number, index, name in ((0, 0, "HD Webcam"), (1, 1, "HD Webcam"), (10, 0, "Other"), (2, 0, "Third")):
        entry = tmp_path / f"sys/class/video4linux/video{number}"
        entry.mkdir(parents=True)
        (entry / "name").write_text(name + "\n")
        (entry / "index").write_text(f"{index}\n")
        (tmp_path / "dev").mkdir(exist_ok=True)
        (tmp_path / f"dev/video{number}").write_bytes(b"")
    (tmp_path / "dev/v4l/by-id").mkdir(parents=True)
    (tmp_path / "dev/v4l/by-id/usb-HD-index0").symlink_to("../../video0")
    found = cameras(tmp_path)
    assert [(Path(c.device).name, c.name) for c in found] == [
        ("video0", "HD Webcam"),
        ("video2", "Third"),
        ("video10", "Other"),
    ]
    assert found[0].stable.endswith("by-id/usb-HD-index0")
    assert found[1].stable == ""


def test_a_machine_without_cameras_has_none(tmp_path: Path) -> None:
    assert cameras(tmp_path) == []


class Showing(Source):
    """A camera that shows a list of pictures."""

    live = False

    def __init__(self, images: list[Image]) -> None:
        super().__init__("showing")
        self._images = iter(images)

    def read(self) -> Frame | None:
        image = next(self._images, None)
        return None if image is None else Frame(image, 0, 0)


def test_a_board_is_taken_when_it_is_held_still_in_a_new_pose(tmp_path: Path) -> None:
    plan = np.full((320, 440, 3), 255, np.uint8)
    for row in range(5):
        for column in range(8):
            if (row + column) % 2:
                plan[40 + 48 * row : 88 + 48 * row, 28 + 48 * column : 76 + 48 * column] = 0

    def shown(x: float, seed: int) -> Image:
        return seen_flat(plan, 1600.0, looking((0.2, x, 0.0), (0.13 + x, 0.1), 0.4), LENS, seed=seed)

    places = [0.0, 0.0, 0.0, 0.05, 0.1, 0.1, 0.0, 0.0]  # held, moved, held, back where it was
    source = Showing([shown(x, seed) for seed, x in enumerate(places)])
    steps = list(grab_views(source, Chessboard(7, 4, 0.03), tmp_path, 5))
    assert [taken for taken, _ in steps] == [1, 2]
    assert "upper right" in steps[0][1] or "right" in steps[0][1]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["board-01.png", "board-02.png"]


def test_one_picture_is_taken_for_the_cameras_place(tmp_path: Path) -> None:
    image = np.full((60, 80, 3), 77, np.uint8)
    cv2.imwrite(str(tmp_path / "in.png"), image)
    result = CliRunner().invoke(camera_app, ["picture", str(tmp_path / "in.png"), str(tmp_path / "pool.png")])
    assert result.exit_code == 0, result.output
    assert "80 x 60 px" in result.stdout
    assert np.array_equal(np.asarray(cv2.imread(str(tmp_path / "pool.png"))), image)
    with pytest.raises(SourceError, match="no picture"):
        grab_picture(Showing([]), 0.0)


def test_the_time_limits_of_a_stream_are_set() -> None:
    assert live._STREAM_TIMEOUT_MS <= 5000, "a dead camera must not hold its thread"
