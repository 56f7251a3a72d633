"""Lens calibration: on real photos, on rendered pictures with a known lens, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from bus.config import ConfigError
from camera_tracker.boards import BOARD_DICTIONARY, Charuco, Chessboard
from camera_tracker.calibration import CalibrationError, View, calibrate, coverage, project, read_json
from camera_tracker.plane import CameraFile
from services.cli.camera import app
from services.cli.errors import CliError
from tests.rendered_board import LENS, looking, seen_flat, sheet_picture

PHOTOS = Path(__file__).parents[3] / "shared/data/markers/chessboard"
SIZE = (LENS.width_px, LENS.height_px)
TILTS = [(0.0, 0.0), (0.5, 0.1), (-0.5, 0.2), (0.1, 0.55), (-0.1, -0.5), (0.4, 0.4), (-0.35, 0.35), (0.3, -0.45)]
PLACES = [(0.135, 0.09), (0.2, 0.14), (0.06, 0.14), (0.2, 0.03), (0.05, 0.03), (0.24, 0.09), (0.02, 0.09), (0.13, 0.0)]
POSES = [looking((*tilt, 0.1 * i), place, 0.36) for i, (tilt, place) in enumerate(zip(TILTS, PLACES, strict=True))]
GRID = np.array([(x * 0.03, y * 0.03, 0.0) for y in range(1, 6) for x in range(1, 9)], np.float32)


def views(std_px: float = 0.1, seed: int = 0, poses: list[np.ndarray] = POSES) -> list[View]:
    random = np.random.default_rng(seed)
    made = []
    for i, pose in enumerate(poses):
        seen = project(GRID, pose, LENS.parameters)[0]
        seen = seen + random.normal(0.0, std_px, seen.shape)
        made.append(View(f"{i}.png", GRID, seen.astype(np.float32).reshape(-1, 1, 2)))
    return made


def run(*words: str) -> str:
    result = CliRunner().invoke(app, list(words))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stdout


def test_real_photos_are_explained_within_half_a_pixel(tmp_path: Path) -> None:
    if not PHOTOS.is_dir():
        pytest.skip(f"{PHOTOS} is absent")
    out = tmp_path / "camera.json"
    found = json.loads(
        run("calibrate", str(PHOTOS), "--chessboard", "9x6", "--square-mm", "25", "--out", str(out), "--json")
    )
    assert found["lens"]["rms_px"] <= 0.25
    assert len(found["views_px"]) == 5
    assert max(found["views_px"].values()) <= 0.5
    assert found["lens"]["fx_px"] == pytest.approx(534.6, abs=3.0)
    assert any("pictures are few" in line for line in found["advice"])
    file: CameraFile = read_json(CameraFile, out)
    assert file.placement is None
    assert file.lens.width_px == 640


def test_a_lens_fitted_to_some_photos_explains_the_one_left_out() -> None:
    if not PHOTOS.is_dir():
        pytest.skip(f"{PHOTOS} is absent")
    board = Chessboard(9, 6, 0.025)
    seen = [board.view(p.name, np.asarray(cv2.imread(str(p)), np.uint8)) for p in sorted(PHOTOS.glob("*.jpg"))]
    known = [view for view in seen if view is not None]
    assert len(known) == 5
    lens = calibrate(known[:-1], (640, 480)).lens
    _, rotation, translation = cv2.solvePnP(known[-1].board_m, known[-1].seen_px, lens.matrix, lens.distortion)
    expected, _ = project(known[-1].board_m, np.concatenate([rotation.ravel(), translation.ravel()]), lens.parameters)
    assert np.sqrt(np.mean(np.sum((expected - known[-1].seen_px.reshape(-1, 2)) ** 2, axis=1))) < 0.5


def test_pictures_of_the_printed_board_give_the_lens_back(tmp_path: Path) -> None:
    run("print-board", "--out", str(tmp_path / "board.pdf"))
    plan = sheet_picture(tmp_path / "board.pdf", 4.0)
    left, top = 0.5 * (297.0 - 270.0), 0.5 * (210.0 - 10.0 - 180.0)
    plan = plan[round(4 * top) : round(4 * (top + 180)), round(4 * left) : round(4 * (left + 270))]
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i, pose in enumerate(POSES):
        cv2.imwrite(str(folder / f"{i}.png"), seen_flat(plan, 4000.0, pose, LENS, seed=i))
    cv2.imwrite(str(folder / "empty.png"), np.full((600, 800, 3), 128, np.uint8))
    (folder / "broken.png").write_bytes(b"no picture")
    found = json.loads(run("calibrate", str(folder), "--out", str(tmp_path / "camera.json"), "--json"))
    assert found["without_board"] == ["broken.png", "empty.png"]
    assert found["lens"]["rms_px"] < 0.25
    lens = read_json(CameraFile, tmp_path / "camera.json").lens
    grid = np.stack(np.meshgrid(np.linspace(40, 760, 9), np.linspace(40, 560, 7)), axis=-1).reshape(-1, 2)
    apart = LENS.fx_px * (lens.undistorted(grid) - LENS.undistorted(grid))
    apart -= apart.mean(axis=0)  # a shift is as good as a turn of the camera, which nobody knows
    assert np.abs(apart).max() < 1.5, "px, in corners where the board was not"
    assert np.median(np.abs(apart)) < 0.4, "px"


def test_a_chessboard_in_a_wide_picture_is_found_as_exactly() -> None:
    """Wide pictures are reduced to find the board; its corners are those of the whole picture."""
    plan = np.full((1280, 1760, 3), 255, np.uint8)
    for row, column in np.argwhere(np.indices((5, 8)).sum(axis=0) % 2):
        plan[160 + 192 * row : 352 + 192 * row, 112 + 192 * column : 304 + 192 * column] = 0
    wide = np.array([930.0, 936.0, 607.0, 444.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    pose = looking((0.3, -0.2, 0.1), (0.13, 0.1), 0.4)
    marks = np.array([(0.0, 0.0, 0.0), (0.275, 0.0, 0.0), (0.275, 0.2, 0.0), (0.0, 0.2, 0.0)])
    to_fine = cv2.getPerspectiveTransform(
        (6400.0 * marks[:, :2] - 0.5).astype(np.float32), (2.0 * project(marks, pose, wide)[0] + 0.5).astype(np.float32)
    )
    fine = cv2.warpPerspective(plan, to_fine, (2400, 1800), borderValue=(200, 200, 200))
    picture = np.asarray(cv2.resize(fine, (1200, 900), interpolation=cv2.INTER_AREA), np.uint8)
    seen = Chessboard(7, 4, 0.03).view("wide", picture)
    assert seen is not None
    corners = np.array([(0.0475 + 0.03 * x, 0.055 + 0.03 * y, 0.0) for y in range(4) for x in range(7)])
    expected = project(corners, pose, wide)[0]
    found = seen.seen_px.reshape(-1, 2)
    apart = min(np.hypot(*(found - order).T).max() for order in (expected, expected[::-1]))
    assert apart < 0.2, "px"


def test_the_covariance_of_the_lens_is_true() -> None:
    """Mean normalised error squared of fx fy cx cy k1 k2 p1 p2 over 60 calibrations: chi-square, 99.9 % bounds."""
    squares = []
    for seed in range(60):
        lens = calibrate(views(0.15, seed), SIZE).lens
        free = np.array(lens.covariance).diagonal() > 0.0
        error = (lens.parameters - LENS.parameters)[free]
        squares.append(error @ np.linalg.solve(np.array(lens.covariance)[np.ix_(free, free)], error) / free.sum())
    assert 0.78 < np.mean(squares) < 1.25


def test_undistorted_points_come_back_at_the_corners() -> None:
    points = np.array([(0.0, 0.0), (799.0, 0.0), (0.0, 599.0), (799.0, 599.0), (400.0, 300.0)])
    rays = np.hstack([LENS.undistorted(points), np.ones((5, 1))])
    assert np.abs(project(rays, np.zeros(6), LENS.parameters)[0] - points).max() < 1e-3


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(CalibrationError, match="in 3 pictures: take at least 4"):
        calibrate(views()[:3], SIZE)


def test_pictures_that_are_all_alike_are_refused() -> None:
    alike = [looking((0.02 * i, 0.0, 0.3 * i), (0.13 + 0.01 * i, 0.09), 0.4) for i in range(6)]
    with pytest.raises(CalibrationError, match="almost alike"):
        calibrate(views(poses=alike), SIZE)


def test_a_wrong_board_is_refused_with_the_worst_picture() -> None:
    longer = np.array([1.0, 1.05, 1.0], np.float32)
    wavy = [v.board_m * longer + np.float32(0.002) * np.sin(900 * v.board_m) for v in views()]
    bent = [replace(v, board_m=w.astype(np.float32)) for v, w in zip(views(), wavy, strict=True)]
    with pytest.raises(CalibrationError, match=r"reprojection error is .*worst: \d"):
        calibrate(bent, SIZE)


def test_coverage_tells_where_the_board_was_not() -> None:
    lone = [replace(v, seen_px=np.clip(v.seen_px, 0, 260)) for v in views()]
    counts = coverage(lone, SIZE)
    assert counts[0, 0] > 0
    assert counts[:, 2].sum() == 0
    assert "top" not in calibrate(views(), SIZE).advice[0]
    assert "upper right, lower left: hold the board there" in calibrate(views(), SIZE).advice[0]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["calibrate", "{tmp}/nothing"], "no such folder"),
        (["calibrate", "{tmp}"], "no pictures in this folder"),
        (["calibrate", "{tmp}", "--squares", "9by6"], "write columns x rows"),
        (["print-marker", "50"], "has 0 to 49"),
        (["print-marker", "3", "--dictionary", "best"], "known: .*4x4_50"),
        (["print-marker", "3", "--size-mm", "250"], "do not fit a4"),
        (["print-marker", "3", "--paper", "b7"], "known: a4"),
        (["print-board", "--square-mm", "60"], "do not fit a4"),
        (["print-marker", "3", "--out", "{tmp}/no/where.pdf"], "cannot be written"),
    ],
)
def test_mistakes_are_told_in_one_line(words: list[str], reason: str, tmp_path: Path) -> None:
    with pytest.raises(CliError, match=reason) as told:
        run(*(word.format(tmp=tmp_path) for word in words))
    assert "\n" not in str(told.value)


def test_pictures_of_two_sizes_are_refused(tmp_path: Path) -> None:
    for name, size in (("a.png", (60, 80)), ("b.png", (80, 60))):
        cv2.imwrite(str(tmp_path / name), np.zeros((*size, 3), np.uint8))
    with pytest.raises(CliError, match=r"b\.png is 60 x 80 px, a\.png 80 x 60 px"):
        run("calibrate", str(tmp_path))


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"lens": {"fx_px": 1e999}}'])
def test_a_damaged_camera_file_is_told_in_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"camera\.json"):
        read_json(CameraFile, path)


def test_a_printed_marker_has_its_true_size_and_number(tmp_path: Path) -> None:
    out = tmp_path / "m.pdf"
    run("print-marker", "7", "--size-mm", "120", "--out", str(out))
    picture = sheet_picture(out, 4.0)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(picture)
    assert np.ravel(ids).tolist() == [7]
    sides = np.linalg.norm(np.diff(np.asarray(corners[0])[0], axis=0), axis=1) / 4.0
    assert sides == pytest.approx(120.0, abs=0.6)
    assert b"PrintScaling /None" in out.read_bytes()


def test_the_printed_board_has_every_corner_where_it_should_be(tmp_path: Path) -> None:
    out = tmp_path / "b.pdf"
    run("print-board", "--squares", "7x5", "--square-mm", "35", "--out", str(out))
    view = Charuco(7, 5, 0.035).view("b", sheet_picture(out, 4.0))
    assert view is not None
    assert len(view.board_m) == 6 * 4, f"all corners, read with {BOARD_DICTIONARY}"
    seen_m = view.seen_px.reshape(-1, 2) / 4000.0
    assert np.abs((seen_m - seen_m[0]) - (view.board_m - view.board_m[0])[:, :2]).max() < 3e-4


def test_the_cross_reference_table_of_a_sheet_is_right(tmp_path: Path) -> None:
    out = tmp_path / "m.pdf"
    run("print-marker", "1", "--out", str(out))
    content = out.read_bytes()
    start = int(content.rsplit(b"startxref\n", 1)[1].split()[0])
    table = content[start:].split(b"trailer")[0].splitlines()
    assert table[0] == b"xref"
    for number, line in enumerate(table[3:], 1):
        assert content[int(line[:10]) :].startswith(b"%d 0 obj" % number)
        assert len(line) == 19, "with the newline: 20 bytes, as the format demands"
