"""Calibration with the running star: the simulator holds a board before its camera, requests come over the bus."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from bus import topics
from bus.config import ConfigError, Deployment
from bus.memory_bus import MemoryBus
from bus.messages import CalibrationRequest, CalibrationState, CameraImage, SimulationFault
from camera_tracker.calibration import read_json
from camera_tracker.calibration_service import CameraCalibration
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.plane import CameraFile, Reference, place_camera
from camera_tracker.service import CameraTracker
from services.cli.camera import app
from services.simulator.board import HELD_S, MOVED_S
from services.simulator.camera import Renderer
from services.simulator.service import Simulator, SimulatorConfig
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
VESSEL = replace(VESSEL, camera=replace(VESSEL.camera, rate_hz=10.0))  # for the sake of the test's time
CAMERA = VESSEL.camera
FOCAL_PX = CAMERA.scale_px_per_m * CAMERA.height_m


class Desk:
    """Somebody at the page: asks, and reads the state."""

    def __init__(self, bus: MemoryBus, deployment: Deployment) -> None:
        self.bus = bus
        bus.add(CameraCalibration(deployment))

    def ask(self, action: Any, **fields: Any) -> CalibrationState:
        self.bus.publish(topics.OPERATOR_CALIBRATION, CalibrationRequest(action=action, **fields))
        self.bus.run_for(0.02)
        return self.state

    @property
    def state(self) -> CalibrationState:
        state = self.bus.last(topics.CAMERA_CALIBRATION)
        assert state is not None
        return state

    def show(self, image: np.ndarray[Any, Any]) -> CalibrationState:
        """Publish a picture as the camera's."""
        height, width = image.shape[:2]
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        self.bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=1, width_px=width, height_px=height, data=data))
        self.bus.run_for(0.2)
        return self.state


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(MemoryBus(), Deployment(run_dir=tmp_path, recordings_dir=tmp_path / "recordings"))


RENDERER = Renderer(VESSEL, seed=7)


def board(pose: int) -> np.ndarray[Any, Any]:
    return RENDERER.render(2.5, 1.5, 0.3, board_at_s=pose * (HELD_S + MOVED_S)).copy()


def test_from_the_simulators_board_to_a_file_that_the_tracker_loads(tmp_path: Path) -> None:
    bus = MemoryBus()
    deployment = Deployment(run_dir=tmp_path, recordings_dir=tmp_path / "recordings")
    bus.add(Simulator(SimulatorConfig(state_file=False, link="loop://calibration"), VESSEL, deployment))
    bus.add(CameraTracker(CameraTrackerConfig(), VESSEL, deployment))
    desk = Desk(bus, deployment)
    bus.run_for(1.5)
    assert desk.state.state == "idle"
    desk.ask("start")
    bus.run_for(0.5)
    assert desk.state.hint.startswith("show the board")
    bus.publish(topics.SIMULATION_FAULT, SimulationFault(kind="board"))
    bus.run_until(lambda: len(desk.state.views) >= 7, 20.0)
    state = desk.state
    assert len(state.views) >= 7, "one in each pose in which the board is held"
    assert len({view.tilt for view in state.views}) >= 4
    assert all(view.error_px is not None and view.error_px < 0.5 for view in state.views)
    assert state.rms_px is None, "nobody has solved yet"
    state = desk.ask("solve")
    assert (state.state, state.refused, state.automatic) == ("solved", "", False)
    assert state.rms_px is not None
    assert state.rms_px < 0.3
    assert state.focal_px == pytest.approx(FOCAL_PX, rel=0.01)
    state = desk.ask("save")
    assert state.state == "saved"

    file: CameraFile = read_json(CameraFile, Path(state.file))
    assert file.lens.fx_px == state.focal_px
    # The pictures beside it give the same lens again, without the star.
    again = tmp_path / "again.json"
    result = CliRunner().invoke(app, ["calibrate", str(Path(state.file).parent), "--out", str(again)])
    assert result.exit_code == 0, result.output
    assert read_json(CameraFile, again).lens == file.lens
    # The tracker wants the camera's place as well, and then works with it.
    config = CameraTrackerConfig(calibration=Path(state.file))
    with pytest.raises(ConfigError, match="starboard camera place"):
        CameraTracker(config, VESSEL, deployment)
    scale = CAMERA.scale_px_per_m
    corners = [(0.5, 0.4), (4.2, 0.5), (4.1, 3.2), (0.6, 3.3), (2.4, 1.8)]
    seen = [Reference(str(i), x, y, 0.0, x * scale - 0.5, y * scale - 0.5) for i, (x, y) in enumerate(corners)]
    placed = file.model_copy(update={"placement": place_camera(file.lens, seen)})
    Path(state.file).write_text(placed.model_dump_json())
    CameraTracker(config, VESSEL, deployment)


def test_views_by_hand_and_taken_back(desk: Desk) -> None:
    assert "start one" in desk.ask("capture").refused
    state = desk.ask("start", automatic=False)
    assert state.refused == ""
    assert "waiting for a picture" in desk.ask("capture").refused
    desk.show(board(0))
    state = desk.show(board(0))
    assert len(state.corners_px) == 2 * 40
    assert not state.views, "nothing is taken by itself"
    assert len(desk.ask("capture").views) == 1
    assert "in this pose already" in desk.ask("capture").refused
    desk.show(board(1))
    assert [view.name for view in desk.ask("capture").views] == ["board-01.jpg", "board-02.jpg"]
    covered = desk.state.coverage
    assert len(desk.ask("undo").views) == 1
    assert sum(desk.state.coverage) < sum(covered)
    desk.ask("undo")
    assert "no view to take back" in desk.ask("undo").refused
    assert desk.ask("cancel").state == "idle"


def test_bad_sets_are_refused_with_the_reason_and_nothing_is_saved(desk: Desk, tmp_path: Path) -> None:
    desk.ask("start", automatic=False)
    assert "in 0 pictures: take at least 4" in desk.ask("solve").refused
    for pose in (0, 13, 14, 15):  # none is tilted
        desk.show(board(pose))
        desk.ask("capture")
    state = desk.ask("solve")
    assert "lies almost alike in all pictures" in state.refused
    assert len(state.views) == 4
    assert state.state == "collecting"
    assert "nothing is solved yet" in desk.ask("save").refused
    assert not (tmp_path / "recordings").exists()
    assert "3 x 3 to 200 squares" in desk.ask("start", columns=50, rows=50).refused


def test_another_view_makes_the_solution_void(desk: Desk) -> None:
    desk.ask("start", automatic=False)
    for pose in range(5):
        desk.show(board(pose))
        desk.ask("capture")
    assert desk.ask("solve").state == "solved"
    desk.show(board(6))
    state = desk.ask("capture")
    assert (state.state, state.rms_px, len(state.views)) == ("collecting", None, 6)


def test_pictures_that_show_no_board_or_are_none(desk: Desk) -> None:
    desk.ask("start")
    water = RENDERER.render(2.5, 1.5, 0.3)
    assert desk.show(water).hint.startswith("show the board")
    assert "not seen" in desk.ask("capture").refused
    for data in (b"", b"no jpeg"):
        desk.bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=2, width_px=8, height_px=6, data=data))
        desk.bus.run_for(0.2)
        assert "cannot be decoded" in desk.state.hint
    assert not desk.show(np.zeros((1, 1, 3), np.uint8)).corners_px
    desk.show(board(0))
    assert len(desk.ask("capture").views) == 1
    smaller = cv2.resize(board(1), (640, 480))
    assert "640 x 480 px now, those before 800 x 600" in desk.show(np.asarray(smaller)).hint


def test_a_moving_board_is_not_taken(desk: Desk) -> None:
    desk.ask("start")
    for i in range(8):
        at_s = i * (HELD_S + MOVED_S) + HELD_S + 0.5 * MOVED_S  # each time somewhere else, on the way
        desk.show(RENDERER.render(2.5, 1.5, 0.3, board_at_s=at_s))
    assert not desk.state.views
    assert desk.state.hint == "hold it still"
