"""Where the camera hangs, and whether metres and their covariance are true."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from scipy.stats import chi2
from typer.testing import CliRunner

from bus.config import ConfigError, Deployment
from camera_tracker.boards import marker_squares
from camera_tracker.calibration import Array, CalibrationError, Lens, project
from camera_tracker.config import CameraTrackerConfig, Vehicle
from camera_tracker.detectors.base import Detection
from camera_tracker.metres import metres_for
from camera_tracker.plane import CameraFile, Placement, PlaneMap, Reference, place_camera
from services.cli.camera import app
from services.cli.track import track
from services.vessels import load_vessel
from tests.rendered_board import LENS, seen_flat

SIZE = (1280, 720)
TRUTH = np.array([900.0, 905.0, 650.0, 350.0, -0.25, 0.08, 0.001, -0.0005, 0.0])
SPREAD = np.diag(np.array([2.0, 2.0, 2.0, 2.0, 0.003, 0.005, 2e-4, 2e-4, 0.0]) ** 2)
KNOWN = np.array(
    [(0.3, 0.3, 0.0), (3.6, 0.4, 0.0), (3.5, 2.6, -0.3), (0.4, 2.7, 0.0), (2.0, 1.5, -0.1), (1.0, 2.0, 0.0)]
)
"""z down: the third is 0.3 m above the water."""


def hanging(camera_m: tuple[float, float, float], turns_rad: tuple[float, float, float]) -> Array:
    """Return the pose (6,) of a camera above the water, turned about x, y and z from looking straight down."""
    rotation = np.eye(3)
    for axis, turn in zip(np.eye(3), turns_rad, strict=True):
        rotation = np.asarray(cv2.Rodrigues(axis * turn)[0], np.float64) @ rotation
    return np.concatenate([cv2.Rodrigues(rotation)[0].ravel(), -rotation @ camera_m])


POSE = hanging((2.0, 1.5, -3.0), (0.2, -0.1, 0.05))


def references(seen: Array, known: Array = KNOWN) -> list[Reference]:
    return [Reference(f"marker {i}", x, y, -z, *px) for i, ((x, y, z), px) in enumerate(zip(known, seen, strict=True))]


def placed(pose: Array = POSE) -> Placement:
    lens = Lens.of(SIZE, TRUTH, np.zeros((9, 9)), 0.0)
    return place_camera(lens, references(project(KNOWN, pose, TRUTH)[0]))


def seen_pose(x_m: float, y_m: float, psi_rad: float, height_m: float = 0.0) -> tuple[float, float, float]:
    """Return x_px, y_px and the heading in the picture of a marker."""
    at = np.array([x_m, y_m, -height_m])
    ahead = 1e-3 * np.array([math.cos(psi_rad), math.sin(psi_rad), 0.0])
    rear, middle, front = project(np.stack([at - ahead, at, at + ahead]), POSE, TRUTH)[0]
    return float(middle[0]), float(middle[1]), math.atan2(front[1] - rear[1], front[0] - rear[0])


def test_exact_points_give_the_exact_place_and_exact_metres() -> None:
    placement = placed()
    assert placement.camera_m == pytest.approx([2.0, 1.5, -3.0], abs=1e-6)
    assert placement.rms_m < 1e-7
    plane = PlaneMap(placement, 0.15)
    for x_m, y_m, psi_rad in [(0.3, 0.3, 0.0), (3.5, 2.6, 3.0), (2.0, 1.5, -1.5), (0.5, 2.5, 0.7)]:
        pose = plane.pose(*seen_pose(x_m, y_m, psi_rad, 0.15), 0.1, 0.002)
        assert pose is not None
        assert (pose.x_m, pose.y_m) == pytest.approx((x_m, y_m), abs=1e-6)
        assert math.remainder(pose.psi_rad - psi_rad, math.tau) == pytest.approx(0.0, abs=1e-5)


def test_a_marker_above_the_water_is_a_tenth_of_a_metre_off_at_the_edge_unless_its_height_is_told() -> None:
    px = seen_pose(0.1, 1.5, 0.0, 0.15)
    wrong = PlaneMap(placed(), 0.0).pose(*px, 0.1, 0.002)
    right = PlaneMap(placed(), 0.15).pose(*px, 0.1, 0.002)
    assert wrong is not None
    assert right is not None
    assert wrong.x_m - 0.1 == pytest.approx(-1.9 * 0.15 / 2.85, abs=1e-4), (
        "parallax: distance from the nadir times h/(H-h)"
    )
    assert right.x_m == pytest.approx(0.1, abs=1e-6)


def test_the_covariance_is_true() -> None:
    """Normalised error squared over 300 cameras with lens, tape, marker height and pixels all in error."""
    random = np.random.default_rng(1)
    root = np.sqrt(SPREAD)
    squares, own = [], []
    for _ in range(300):
        lens = Lens.of(SIZE, TRUTH + root @ random.normal(size=9), SPREAD, 0.2)
        seen = project(KNOWN, POSE, TRUTH)[0] + 0.2 * random.normal(size=(6, 2))
        try:
            placement = place_camera(lens, references(seen, KNOWN + 0.003 * random.normal(size=(6, 3))))
        except CalibrationError:
            continue  # one in a thousand
        truth = np.array([random.uniform(0.4, 3.5), random.uniform(0.4, 2.6), random.uniform(-3.1, 3.1)])
        x_px, y_px, psi = seen_pose(truth[0], truth[1], truth[2], 0.15 + 0.005 * random.normal())
        noisy = (x_px + 0.1 * random.normal(), y_px + 0.1 * random.normal(), psi + 0.002 * random.normal())
        pose = PlaneMap(placement, 0.15, 0.005).pose(*noisy, 0.1, 0.002)
        assert pose is not None
        error = np.array([pose.x_m, pose.y_m, pose.psi_rad]) - truth
        error[2] = math.remainder(error[2], math.tau)
        squares.append(error @ np.linalg.solve(pose.noise + pose.map_error, error))
        own.append(error**2 / (pose.noise + pose.map_error).diagonal())
    n = len(squares)
    assert n >= 297
    for mean, freedom in ((np.mean(squares), 3), *((value, 1) for value in np.mean(own, axis=0))):
        assert chi2.ppf(0.0005, freedom * n) < n * mean < chi2.ppf(0.9995, freedom * n), "all, then x, y, psi each"


def test_the_noise_part_is_what_changes_from_frame_to_frame() -> None:
    random = np.random.default_rng(2)
    plane = PlaneMap(placed(), 0.15, 0.005)
    x_px, y_px, psi = seen_pose(1.0, 2.0, 0.5, 0.15)
    samples = []
    for _ in range(800):
        dx, dy, turn = random.normal(size=3) * (0.3, 0.3, 0.004)
        pose = plane.pose(x_px + dx, y_px + dy, psi + turn, 0.3, 0.004)
        assert pose is not None
        samples.append((pose.x_m, pose.y_m, pose.psi_rad))
    expected = plane.pose(x_px, y_px, psi, 0.3, 0.004)
    assert expected is not None
    whitened = np.linalg.solve(expected.noise, np.cov(np.array(samples).T))
    assert np.linalg.eigvals(whitened).real == pytest.approx(1.0, abs=0.25)


def test_where_there_is_no_water_there_is_no_pose() -> None:
    lens = Lens.of(SIZE, TRUTH, np.zeros((9, 9)), 0.0)
    flat = Placement(
        lens=lens,
        rotation_rad=tuple(hanging((0.0, 0.0, -2.0), (1.4, 0.0, 0.0))[:3].tolist()),
        translation_m=tuple(hanging((0.0, 0.0, -2.0), (1.4, 0.0, 0.0))[3:].tolist()),
        covariance=tuple((0.0,) * 15 for _ in range(15)),
        rms_m=0.0,
    )
    assert [PlaneMap(flat).pose(640.0, y, 0.0, 0.1, 0.002) is None for y in (10.0, 700.0)].count(True) == 1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda known: known[:3], "3 points are seen: at least 4"),
        (lambda known: known * (1, 0, 0), "on one line"),
        (lambda known: known * (1, -1, 1), "y downwards"),
        (lambda known: known + np.eye(6, 3) * (0.05, 0, 0), "without marker 0 they do"),
    ],
)
def test_points_with_a_mistake_are_refused(change: object, reason: str) -> None:
    lens = Lens.of(SIZE, TRUTH, SPREAD, 0.2)
    flat = KNOWN * (1, 1, 0)
    known = change(flat)  # type: ignore[operator]
    seen = project(flat, POSE, TRUTH)[0]
    with pytest.raises(CalibrationError, match=reason):
        place_camera(lens, references(seen[: len(known)], known))


def pool_picture(pose: Array, markers: dict[int, tuple[float, float]], side_m: float = 0.16) -> np.ndarray:
    plan = np.full((1500, 2000, 3), 235, np.uint8)  # 500 px/m: 4 m x 3 m
    for number, (x, y) in markers.items():
        for left, top, side in marker_squares("4x4_50", number, x - side_m / 2, y - side_m / 2, side_m):
            edges = [round(500 * v) for v in (top, top + side, left, left + side)]
            plan[edges[0] : edges[1], edges[2] : edges[3]] = 0
    return seen_flat(plan, 500.0, pose, LENS)


def test_the_place_from_a_picture_with_markers(tmp_path: Path) -> None:
    pose = hanging((2.1, 1.4, -3.2), (0.12, -0.08, 0.1))
    markers = {1: (0.6, 0.5), 2: (3.4, 0.5), 3: (3.3, 2.4), 4: (0.7, 2.5), 5: (2.0, 1.3), 6: (1.3, 2.0)}
    cv2.imwrite(str(tmp_path / "pool.png"), pool_picture(pose, markers))
    points = "".join(
        f"[[point]]\nmarker = {n}\nx_m = {x}\ny_m = {y}\n" for n, (x, y) in [*markers.items(), (9, (0, 0))]
    )
    (tmp_path / "points.toml").write_text(points)
    camera = tmp_path / "camera.json"
    camera.write_text(CameraFile(lens=LENS).model_dump_json())
    words = ["place", str(camera), str(tmp_path / "pool.png"), str(tmp_path / "points.toml"), "--json"]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    found = json.loads(result.stdout)
    assert found["not_seen"] == ["marker 9"]
    assert found["points"] == 6
    assert (found["camera_x_m"], found["camera_y_m"], found["camera_height_m"]) == pytest.approx(
        (2.1, 1.4, 3.2), abs=0.02
    )
    assert found["rms_m"] < 0.001

    config = CameraTrackerConfig(calibration=camera, vehicles=(Vehicle(name="v", front="red"),), colours={"red": RED})
    metres = metres_for(config, load_vessel("pladypos"), None)
    (x_px, y_px), _, _ = project(np.array([(3.0, 1.0, 0.0)] * 3), pose, LENS.parameters)[0]
    fields = metres.fields("v", Detection(float(x_px), float(y_px), 0.0, 1.0, "", False, 10.0))
    assert (fields["x_m"], fields["y_m"]) == pytest.approx((3.0, 1.0), abs=0.003)
    assert metres.size_px == (800, 600)
    assert metres.scale_px_per_m == pytest.approx(620 / 3.2, rel=0.02)

    (tmp_path / "pool.toml").write_text(
        '[camera_tracker]\ncalibration = "camera.json"\n'
        '[[camera_tracker.vehicles]]\nname = "v"\ndictionary = "4x4_50"\nmarker = 5\n'
    )
    tracking = typer.Typer(pretty_exceptions_enable=False)
    tracking.command()(track)
    words = [str(tmp_path / "pool.png"), "--config", str(tmp_path / "pool.toml"), "--json"]
    result = CliRunner().invoke(tracking, words, catch_exceptions=False)
    (tracked,) = json.loads(result.stdout)["frames"][0]["poses"]
    assert (tracked["x_m"], tracked["y_m"]) == pytest.approx((2.0, 1.3), abs=0.003)
    assert tracked["psi_rad"] == pytest.approx(0.0, abs=0.01)
    assert tracked["psi_image_rad"] == pytest.approx(0.1, abs=0.1)
    assert 0.0 < tracked["covariance"][0] < 0.01**2
    cv2.imwrite(str(tmp_path / "half.png"), np.zeros((300, 400, 3), np.uint8))
    result = CliRunner().invoke(tracking, [str(tmp_path / "half.png"), *words[1:]])
    assert "calibrated at 800 x 600 px" in str(result.exception)


RED = {"low": (0, 0, 110), "high": (90, 80, 255)}


def test_a_calibration_without_a_place_is_a_mistake_of_configuration(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(CameraFile(lens=LENS).model_dump_json())
    config = CameraTrackerConfig(calibration=Path("camera.json"))
    with pytest.raises(ConfigError, match="run `starboard camera place`"):
        metres_for(config, load_vessel("pladypos"), tmp_path / "pool.toml")
    with pytest.raises(ConfigError, match="cannot be read"):
        metres_for(config, load_vessel("pladypos"), Deployment().config_path)
    with pytest.raises(ValueError, match="give one of them"):
        CameraTrackerConfig(calibration=Path("camera.json"), scale_px_per_m=100.0)
