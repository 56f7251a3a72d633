"""The laser distance module of thesis 3.4: curves with the printed numbers, dots, lost dots, the commands."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from camera_tracker.calibration import CalibrationError
from camera_tracker.laser.dots import REGION_PX, DotTracker
from camera_tracker.laser.ranging import VIDEORAY_LEFT, VIDEORAY_RIGHT, LaserCurve, LaserModule, fit_curve
from camera_tracker.laser.wall import WallCamera, wall_picture
from services.cli.errors import CliError
from services.cli.laser import app

MODULE = LaserModule(left=VIDEORAY_LEFT, right=VIDEORAY_RIGHT, spacing_m=0.1)
DISTANCES_M = np.arange(0.10, 1.001, 0.05)
"""Thesis 3.4: 10 cm to 100 cm in steps of 5 cm."""


def test_table_3_1_in_its_own_units() -> None:
    """L in cm at x px: a e^(b x) + c e^(d x)."""
    for x in (50.0, 100.0, 250.0):
        right = 230.2 * math.exp(-0.03876 * x) + 83.3 * math.exp(-0.007234 * x)
        left = 507.7 * math.exp(-0.03745 * x) + 88.71 * math.exp(-0.007085 * x)
        assert 100.0 * VIDEORAY_RIGHT.length_m(x) == pytest.approx(right)
        assert 100.0 * VIDEORAY_LEFT.length_m(x) == pytest.approx(left)


def test_table_3_1_covers_10_to_100_cm_within_a_video_picture() -> None:
    """Its b and d are per px: "1/cm" as printed would put all dots within 3 mm of the middle."""
    for curve in (VIDEORAY_LEFT, VIDEORAY_RIGHT):
        assert 40.0 < curve.x_px(1.0) < 70.0
        assert 280.0 < curve.x_px(0.1) < 320.0
        assert curve.length_m(curve.x_px(0.37)) == pytest.approx(0.37)


def test_before_the_wall_the_angle_is_zero_and_the_distance_the_mean() -> None:
    distance_m, angle_rad = MODULE.range(VIDEORAY_LEFT.x_px(0.6), VIDEORAY_RIGHT.x_px(0.6))
    assert distance_m == pytest.approx(0.6)
    assert angle_rad == pytest.approx(0.0, abs=1e-9), "(3.7) as printed gives 90 degrees"


@pytest.mark.parametrize("angle_deg", [-35.0, -10.0, 20.0, 45.0])
def test_3_7_and_3_8_turn_lengths_into_distance_and_angle(angle_deg: float) -> None:
    left_m, right_m = MODULE.lengths_m(0.5, math.radians(angle_deg))
    assert right_m - left_m == pytest.approx(0.1 * math.tan(math.radians(angle_deg)))
    distance_m, angle_rad = MODULE.range(VIDEORAY_LEFT.x_px(left_m), VIDEORAY_RIGHT.x_px(right_m))
    assert distance_m == pytest.approx(0.5)
    assert math.degrees(angle_rad) == pytest.approx(angle_deg)


@pytest.mark.parametrize("curve", [VIDEORAY_LEFT, VIDEORAY_RIGHT], ids=["left", "right"])
def test_the_thesis_own_calibration_points_give_its_curve_back(curve: LaserCurve) -> None:
    x_px = np.array([curve.x_px(length) for length in DISTANCES_M])
    fitted, rms_m = fit_curve(x_px, DISTANCES_M)
    assert rms_m < 1e-5
    for name in ("a_m", "b_per_px", "c_m", "d_per_px"):
        assert getattr(fitted, name) == pytest.approx(getattr(curve, name), rel=0.02)


def test_a_fit_to_noisy_points_stays_within_the_noise() -> None:
    random = np.random.default_rng(3)
    x_px = np.array([VIDEORAY_RIGHT.x_px(length) for length in DISTANCES_M]) + random.normal(0.0, 0.5, len(DISTANCES_M))
    fitted, _ = fit_curve(x_px, DISTANCES_M + random.normal(0.0, 0.001, len(DISTANCES_M)))
    for length in DISTANCES_M:
        assert fitted.length_m(VIDEORAY_RIGHT.x_px(length)) == pytest.approx(length, rel=0.015)


@pytest.mark.parametrize(
    ("x_px", "length_m", "reason"),
    [
        (np.arange(1.0, 6.0), np.arange(1.0, 6.0), "at least 6"),
        (np.arange(-2.0, 8.0), np.arange(1.0, 11.0), "its own side"),
        (np.arange(50.0, 60.0), np.arange(0.1, 1.05, 0.1), "misses the points"),
    ],
)
def test_points_that_no_curve_fits_are_refused(x_px: np.ndarray, length_m: np.ndarray, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        fit_curve(x_px, length_m)


@pytest.mark.parametrize("distance_m", [0.12, 0.3, 0.6, 0.95])
@pytest.mark.parametrize("angle_deg", [0.0, -12.0])
def test_distance_and_angle_from_pictures(distance_m: float, angle_deg: float) -> None:
    found = DotTracker(MODULE).read(wall_picture(MODULE, distance_m, math.radians(angle_deg), seed=5))
    assert found.lost == ""
    assert found.distance_m == pytest.approx(distance_m, rel=0.005)
    assert found.angle_rad is not None
    assert math.degrees(found.angle_rad) == pytest.approx(angle_deg, abs=0.6 + 2.0 * distance_m)


def test_dots_are_found_within_a_tenth_of_a_pixel() -> None:
    camera, errors = WallCamera(MODULE), []
    for k in range(20):
        distance_m = 0.2 + 0.03 * k
        found = DotTracker(MODULE).read(camera.picture(distance_m))
        assert found.left is not None
        assert found.right is not None
        errors += [
            319.5 - found.left.x_px - VIDEORAY_LEFT.x_px(distance_m),
            found.right.x_px - 319.5 - VIDEORAY_RIGHT.x_px(distance_m),
        ]
    assert np.sqrt(np.mean(np.square(errors))) < 0.1


def test_after_the_first_picture_only_regions_are_searched_until_a_dot_is_lost() -> None:
    tracker = DotTracker(MODULE)
    assert tracker.read(wall_picture(MODULE, 0.50)).whole_picture
    assert not tracker.read(wall_picture(MODULE, 0.48, seed=1)).whole_picture
    lost = tracker.read(wall_picture(MODULE, 0.48, seed=2, shown=(True, False)))
    assert lost.lost == "right dot lost"
    assert lost.left is not None
    assert lost.distance_m is None
    assert tracker.read(wall_picture(MODULE, 0.48, seed=3)).whole_picture
    assert not tracker.read(wall_picture(MODULE, 0.48, seed=4)).whole_picture


def test_a_dot_that_jumps_out_of_its_region_is_found_in_the_same_picture() -> None:
    tracker = DotTracker(MODULE)
    tracker.read(wall_picture(MODULE, 0.50))
    assert VIDEORAY_LEFT.x_px(0.3) - VIDEORAY_LEFT.x_px(0.5) > REGION_PX / 2
    found = tracker.read(wall_picture(MODULE, 0.30, seed=1))
    assert found.whole_picture
    assert found.distance_m == pytest.approx(0.30, rel=0.01)


def test_a_dot_that_its_region_cuts_is_looked_for_in_the_whole_picture() -> None:
    camera, begin_px = WallCamera(MODULE), VIDEORAY_LEFT.x_px(0.5)
    for distance_m in np.arange(0.36, 0.46, 0.005).tolist():
        tracker = DotTracker(MODULE)
        tracker.read(camera.picture(0.5))
        found = tracker.read(camera.picture(distance_m))
        assert found.left is not None
        x_px = VIDEORAY_LEFT.x_px(distance_m)
        assert 319.5 - found.left.x_px == pytest.approx(x_px, abs=0.25), f"moved by {x_px - begin_px:.1f} px"


def test_a_dot_that_the_edge_of_the_picture_cuts_is_lost() -> None:
    for inside_px in (0.5, 2.0, 4.0, 12.0):
        width = 2 * round(VIDEORAY_LEFT.x_px(0.3) + inside_px)
        picture = wall_picture(MODULE.model_copy(update={"centre_x_px": 0.5 * (width - 1)}), 0.3, size_px=(width, 480))
        found = DotTracker(MODULE).read(picture)
        if inside_px < 3.0:
            assert "left" in found.lost
        if found.left is not None:
            assert 0.5 * (width - 1) - found.left.x_px == pytest.approx(VIDEORAY_LEFT.x_px(0.3), abs=0.25)


@pytest.mark.parametrize(
    ("shown", "lost"), [((False, True), "left dot lost"), ((False, False), "left and right dot lost")]
)
def test_lost_dots_are_reported(shown: tuple[bool, bool], lost: str) -> None:
    assert DotTracker(MODULE).read(wall_picture(MODULE, 0.4, shown=shown)).lost == lost


@pytest.mark.parametrize("value", [0, 255])
@pytest.mark.parametrize("size", [(1, 1), (480, 640)])
def test_pictures_without_anything_lose_both_dots(value: int, size: tuple[int, int]) -> None:
    assert DotTracker(MODULE).read(np.full((*size, 3), value, np.uint8)).lost == "left and right dot lost"


def test_a_red_area_and_a_reflection_in_another_row_are_no_dots() -> None:
    picture = wall_picture(MODULE, 0.5, seed=9)
    picture[300:460, 20:240] = (40, 40, 200)
    cv2.circle(picture, (400, 60), 3, (60, 60, 255), -1)
    assert DotTracker(MODULE).read(picture).distance_m == pytest.approx(0.5, rel=0.01)


def run(*words: str) -> str:
    result = CliRunner().invoke(app, list(words))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.stdout


def test_from_pictures_at_known_distances_to_a_calibration_that_measures(tmp_path: Path) -> None:
    rows = ["distance_m,x_left_px,x_right_px"]
    for distance_m in DISTANCES_M:
        picture = tmp_path / "wall.png"
        run("render", str(picture), "--distance-m", str(distance_m))
        frame = json.loads(run("measure", str(picture), "--json"))["frames"][0]
        rows.append(f"{distance_m},{frame['x_left_px']},{frame['x_right_px']}")
    (tmp_path / "dots.csv").write_text("\n".join(rows))
    told = run("calibrate", str(tmp_path / "dots.csv"), "--out", str(tmp_path / "laser.json"))
    assert "19 distances" in told
    run("render", str(tmp_path / "wall.png"), "--distance-m", "0.42", "--angle-deg", "8")
    words = ["measure", str(tmp_path / "wall.png"), "--calibration", str(tmp_path / "laser.json"), "--json"]
    frame = json.loads(run(*words))["frames"][0]
    assert frame["distance_m"] == pytest.approx(0.42, rel=0.01)
    assert math.degrees(frame["angle_rad"]) == pytest.approx(8.0, abs=2.0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no columns"),
        ("distance_m,x_left_px\n1,2", "no columns"),
        ("distance_m,x_left_px,x_right_px\n0.1,2,many", "line 2: x_right_px is no number"),
        ("distance_m,x_left_px,x_right_px\n0.1,2", "line 2: x_right_px is no number"),
        ("distance_m,x_left_px,x_right_px\n0.1,2,400", "left laser: 1 different places"),
    ],
)
def test_a_bad_table_is_told_in_one_line(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "dots.csv").write_text(text)
    with pytest.raises(CliError, match=reason):
        run("calibrate", str(tmp_path / "dots.csv"), "--out", str(tmp_path / "laser.json"))
    assert not (tmp_path / "laser.json").exists()


def test_measuring_needs_pictures(tmp_path: Path) -> None:
    with pytest.raises(CliError, match="no such file"):
        run("measure", str(tmp_path / "none.png"))
    with pytest.raises(CliError, match="is not on the curve"):
        run("render", str(tmp_path / "far.png"), "--distance-m", "20")
