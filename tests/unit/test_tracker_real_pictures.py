"""Square markers on photographs taken by others: ceiling camera, turned AprilTag, a sheet of markers."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from camera_tracker.config import CameraTrackerConfig
from camera_tracker.detectors.base import GOOD_QUALITY, Detection
from camera_tracker.sources import Image
from camera_tracker.tracking import Tracker

MARKERS = Path(__file__).parents[2] / ".." / "shared" / "data" / "markers"


def found_in(path: Path, dictionary: str, quality: float = GOOD_QUALITY) -> dict[str, Detection]:
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    image = np.asarray(cv2.imread(str(path)), np.uint8)
    found = Tracker(CameraTrackerConfig(every_marker_of=dictionary)).track(image, 0)
    return {name: pose for name, pose in found.items() if pose.quality >= quality}


@pytest.mark.parametrize(
    ("picture", "names"),
    [
        ("camera-alignment-center.jpg", {"10", "13", "17", "21"}),
        # The fourth of this plate, 48, is bleached to a corner of itself.
        ("camera-alignment-before-2.jpg", {"42", "45", "49"}),
    ],
)
def test_markers_of_one_plate_under_the_ceiling_agree_in_heading(picture: str, names: set[str]) -> None:
    found = found_in(MARKERS / "ceiling-aruco" / picture, "4x4_50")
    assert set(found) == names
    for one, other in itertools.combinations(found.values(), 2):
        apart = math.degrees(math.remainder(one.psi_rad - other.psi_rad, math.pi / 2))
        assert abs(apart) < 0.15
        assert 50 < math.hypot(one.x_px - other.x_px, one.y_px - other.y_px) < 150


@pytest.mark.parametrize("yaw_deg", [-60, -40, -20, 0, 20, 40, 60])
def test_yaw_of_a_turned_tag(yaw_deg: int) -> None:
    found = found_in(MARKERS / "rotation-apriltag" / f"test_image_rotation_{yaw_deg}.png", "apriltag_36h11")
    assert set(found) == {"76"}
    camera = np.array([[329.8729619143081, 0.0, 528.0], [0.0, 332.94611303946357, 396.0], [0.0, 0.0, 1.0]])
    h = 0.5 * 0.065
    square = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])
    corners = np.asarray(found["76"].corners_px)
    _, turns, places, misfits = cv2.solvePnPGeneric(square, corners, camera, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    best = int(np.argmin(np.ravel(misfits)))
    # Least squares: IPPE alone does not bring the reprojection error to its minimum.
    turn, place = cv2.solvePnPRefineLM(square, corners, camera, None, turns[best], places[best])
    normal = cv2.Rodrigues(turn)[0] @ (0.0, 0.0, 1.0)
    # Against the line of sight.
    yaw = math.degrees(math.atan2(normal[0], -normal[2]) + math.atan2(place[0, 0], place[2, 0]))
    assert abs(yaw - yaw_deg) < 3.0


HALF = 0.5 * np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5]])
"""From px of a picture to px of its half: whole numbers are pixel centres."""
SAME = np.eye(2, 3)


def spoil(image: Image, change: str) -> Image:
    """Return a picture smaller, darker, brighter, blurred or badly compressed."""
    if change == "half":
        return np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
    if change in ("dark", "bright"):
        return np.asarray(cv2.convertScaleAbs(image, alpha=0.35 if change == "dark" else 1.4), np.uint8)
    if change == "blur":
        return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5), np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 30])[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


@pytest.mark.parametrize(
    ("picture", "dictionary", "change", "found"),
    [
        ("ceiling-aruco/camera-alignment-center.jpg", "4x4_50", "half", 4),  # markers of 14 px
        ("ceiling-aruco/camera-alignment-center.jpg", "4x4_50", "dark", 4),
        ("ceiling-aruco/camera-alignment-before-2.jpg", "4x4_50", "bright", 3),
        ("aruco-sheet/singlemarkersoriginal.jpg", "6x6_250", "half", 6),
        ("aruco-sheet/singlemarkersoriginal.jpg", "6x6_250", "blur", 6),
        ("aruco-sheet/singlemarkersoriginal.jpg", "6x6_250", "jpeg", 6),
        ("rotation-apriltag/test_image_multiple_01.png", "apriltag_36h11", "jpeg", 5),
        ("rotation-apriltag/test_image_multiple_03.png", "apriltag_36h11", "dark", 5),
        ("rotation-apriltag/test_image_multiple_03.png", "apriltag_36h11", "blur", 5),
    ],
)
def test_markers_in_spoilt_pictures(picture: str, dictionary: str, change: str, found: int, tmp_path: Path) -> None:
    """As many as OpenCV finds or more, and none that is good lies half a px elsewhere than in the picture as it is."""
    known = found_in(MARKERS / picture, dictionary)
    image = np.asarray(cv2.imread(str(MARKERS / picture)), np.uint8)
    spoilt = spoil(image, change)
    cv2.imwrite(str(tmp_path / "spoilt.png"), spoilt)
    seen = found_in(tmp_path / "spoilt.png", dictionary, quality=0.0)
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary.upper()}"))
    _, numbers, _ = cv2.aruco.ArucoDetector(book).detectMarkers(spoilt)
    opencvs = set() if numbers is None else {str(n) for n in numbers.ravel()}
    assert opencvs <= set(seen) <= set(known) | opencvs
    assert len(seen) >= found
    to_spoilt = HALF if change == "half" else SAME
    for name in set(seen) & set(known):
        if seen[name].quality >= GOOD_QUALITY:
            expected = to_spoilt @ (known[name].x_px, known[name].y_px, 1.0)
            assert math.dist(expected, (seen[name].x_px, seen[name].y_px)) < 0.5


def test_six_of_six_on_a_sheet() -> None:
    folder = MARKERS / "aruco-sheet"
    found = found_in(folder / "singlemarkersoriginal.jpg", "6x6_250")
    truth = json.loads((folder / "singlemarkersoriginal.gold.json").read_text())
    assert set(found) == set(truth)
    for name, numbers in truth.items():
        corners = np.reshape(numbers, (4, 2)).astype(float)
        error = np.asarray(found[name].corners_px) - corners
        assert np.abs(error).max() < 1.2  # the list has whole px
        assert np.hypot(*error.mean(axis=0)) < 0.6


def test_track_markers_prints_every_marker_with_its_corners() -> None:
    import typer

    from services.cli.track import track

    path = MARKERS / "ceiling-aruco" / "camera-alignment-center.jpg"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    app = typer.Typer()
    app.command()(track)
    result = CliRunner().invoke(app, [str(path), "--markers", "4x4_50", "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert [vehicle["name"] for vehicle in document["summary"]["vehicles"]] == ["10", "13", "17", "21"]
    assert all(len(pose["corners_px"]) == 4 for pose in document["frames"][0]["poses"])
