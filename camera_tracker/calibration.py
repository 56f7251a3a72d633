"""The lens of a camera from pictures of a board: camera matrix, distortion, and how well they are known.

Pinhole model of OpenCV (`cv2.calibrateCamera`) with distortion k1 k2 p1 p2 k3; whole pixel coordinates are pixel
centres. Points are undistorted, never frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from bus.config import ConfigError, Section
from bus.service import first_line

Array = NDArray[np.float64]

LENS_PARAMETERS = 9
"""fx fy cx cy k1 k2 p1 p2 k3, the order of every covariance."""
MIN_VIEWS = 4
MIN_TILT_DEG = 10.0
"""Between the two most different views: boards that all lie alike leave focal length and distance undetermined."""
MAX_RMS_PX = 1.0
MAX_FOCAL_STD = 0.02
COVERAGE_CELLS = 3
_CELL_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)

Row = Annotated[tuple[float, ...], Field(min_length=LENS_PARAMETERS, max_length=LENS_PARAMETERS)]


class CalibrationError(ValueError):
    """Pictures or points that give no trustworthy calibration; one line with the reason and what to do.

    `views_px`: reprojection error of each view in px, where they could be explained at all.
    """

    def __init__(self, reason: str, views_px: dict[str, float] | None = None) -> None:
        super().__init__(reason)
        self.views_px = views_px or {}


class Lens(Section):
    """Camera matrix and distortion, with the covariance of both."""

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    fx_px: float = Field(gt=0)
    fy_px: float = Field(gt=0)
    cx_px: float
    cy_px: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    rms_px: float = Field(0.0, ge=0, description="reprojection error of the calibration")
    covariance: Annotated[tuple[Row, ...], Field(min_length=LENS_PARAMETERS, max_length=LENS_PARAMETERS)] = tuple(
        (0.0,) * LENS_PARAMETERS for _ in range(LENS_PARAMETERS)
    )

    @property
    def parameters(self) -> Array:
        """fx fy cx cy k1 k2 p1 p2 k3."""
        return np.array([getattr(self, name) for name in _NAMES])

    @classmethod
    def of(cls, size_px: tuple[int, int], parameters: Array, covariance: Array, rms_px: float) -> Lens:
        """Return the lens of nine parameters and their (9, 9) covariance."""
        rows = tuple(tuple(float(v) for v in row) for row in covariance)
        values = {name: float(v) for name, v in zip(_NAMES, parameters, strict=True)}
        return cls(width_px=size_px[0], height_px=size_px[1], rms_px=rms_px, covariance=rows, **values)

    @property
    def matrix(self) -> Array:
        """Camera matrix (3, 3)."""
        return camera_matrix(self.parameters)

    @property
    def distortion(self) -> Array:
        """k1 k2 p1 p2 k3."""
        return self.parameters[4:]

    def undistorted(self, points_px: Array) -> Array:
        """Return where points (n, 2) lie on the plane at distance 1 before a camera without distortion, (n, 2)."""
        # With the default 5 iterations a wide lens leaves 0.1 px at the corners.
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
        points = np.ascontiguousarray(points_px, dtype=np.float64).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, self.distortion, None, None, None, criteria)
        return np.asarray(found, np.float64).reshape(-1, 2)


_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")


def camera_matrix(parameters: Array) -> Array:
    """Return the (3, 3) matrix of fx fy cx cy (...)."""
    fx, fy, cx, cy = parameters[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def project(points: NDArray[np.floating[Any]], pose: Array, parameters: Array) -> tuple[Array, Array]:
    """Return where points (n, 3) are seen, (n, 2) px, and the derivative (n, 2, 15).

    pose: rotation vector and translation into the camera's frame (6,). Columns of the derivative: the nine lens
    parameters, then the pose.
    """
    seen, jacobian = cv2.projectPoints(
        np.ascontiguousarray(points, dtype=np.float64), pose[:3], pose[3:], camera_matrix(parameters), parameters[4:]
    )
    by = np.asarray(jacobian, np.float64).reshape(-1, 2, 15)  # OpenCV: pose, f, c, distortion
    return np.asarray(seen, np.float64).reshape(-1, 2), np.concatenate([by[:, :, 6:], by[:, :, :6]], axis=2)


@dataclass(frozen=True)
class View:
    """The board in one picture: corners on it (n, 3) in m, where they are seen (n, 2) in px."""

    name: str
    board_m: NDArray[np.float32]
    seen_px: NDArray[np.float32]


@dataclass(frozen=True)
class Calibrated:
    """A lens, the reprojection error of each view, and what would make it better."""

    lens: Lens
    views_px: dict[str, float]
    advice: tuple[str, ...]


def calibrate(views: Sequence[View], size_px: tuple[int, int]) -> Calibrated:
    """Return the lens that explains the views of a board; raise CalibrationError when they do not suffice.

    k3 is freed only if the pictures determine it (3 standard deviations): otherwise it bends the corners at will.
    """
    if len(views) < MIN_VIEWS:
        raise CalibrationError(f"the board was found in {len(views)} pictures: take at least {MIN_VIEWS}, better 15")
    solved = _solve(views, size_px, 0)
    if abs(solved.parameters[8]) < 3.0 * math.sqrt(solved.covariance[8, 8]):
        solved = _solve(views, size_px, cv2.CALIB_FIX_K3)
    _refuse_bad(solved, views)
    lens = Lens.of(size_px, solved.parameters, solved.covariance, solved.rms_px)
    return Calibrated(lens, solved.views_px, tuple(_advice(solved, views, size_px)))


@dataclass(frozen=True)
class _Solved:
    parameters: Array
    covariance: Array
    poses: Array
    rms_px: float
    views_px: dict[str, float]

    @property
    def tilt_deg(self) -> float:
        """Largest angle between the normals of two boards."""
        normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in self.poses])
        return math.degrees(math.acos(float(np.clip((normals @ normals.T).min(), -1.0, 1.0))))


def _solve(views: Sequence[View], size_px: tuple[int, int], flags: int) -> _Solved:
    try:
        _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
            [v.board_m for v in views],
            [v.seen_px for v in views],
            size_px,
            None,
            None,
            flags=flags,
        )
    except cv2.error as error:
        raise CalibrationError(f"no camera explains these pictures: {str(error).strip()[:120]}") from None
    parameters = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(distortion)[:5]])
    poses = np.concatenate([np.reshape(rotations, (-1, 3)), np.reshape(translations, (-1, 3))], axis=1)
    free = np.arange(LENS_PARAMETERS - bool(flags & cv2.CALIB_FIX_K3))
    information = np.zeros((len(free), len(free)))
    errors: dict[str, float] = {}
    squares, count = 0.0, 0
    for view, pose in zip(views, poses, strict=True):
        seen, by = project(view.board_m, pose, parameters)
        square = float(np.sum((seen - view.seen_px.reshape(-1, 2)) ** 2))
        errors[view.name] = math.sqrt(square / len(seen))
        squares, count = squares + square, count + len(seen)
        a, b = by[:, :, free].reshape(-1, len(free)), by[:, :, LENS_PARAMETERS:].reshape(-1, 6)
        information += a.T @ a - (a.T @ b) @ np.linalg.pinv(b.T @ b) @ (b.T @ a)  # the view's pose is free as well
    variance = squares / max(2 * count - len(free) - 6 * len(views), 1)
    covariance = np.zeros((LENS_PARAMETERS, LENS_PARAMETERS))
    covariance[np.ix_(free, free)] = variance * np.linalg.pinv(information, hermitian=True)
    return _Solved(parameters, covariance, poses, math.sqrt(squares / count), errors)


def _refuse_bad(solved: _Solved, views: Sequence[View]) -> None:
    tilt_deg = solved.tilt_deg
    if tilt_deg < MIN_TILT_DEG:
        raise CalibrationError(
            f"the board lies almost alike in all pictures (tilted by {tilt_deg:.0f} deg at most): tilt it by 20 to"
            " 40 deg to different sides",
            solved.views_px,
        )
    if solved.rms_px > MAX_RMS_PX:
        worst = max(solved.views_px, key=lambda name: solved.views_px[name])
        raise CalibrationError(
            f"the reprojection error is {solved.rms_px:.2f} px, more than {MAX_RMS_PX:.1f} px (worst: {worst}, "
            f"{solved.views_px[worst]:.2f} px): is the board flat and the right one, are the pictures sharp?",
            solved.views_px,
        )
    focal_std = math.sqrt(max(solved.covariance[0, 0], 0.0)) / solved.parameters[0]
    if not focal_std < MAX_FOCAL_STD:
        raise CalibrationError(
            f"the focal length is only known to {100.0 * focal_std:.1f} %: take more pictures ({len(views)} now),"
            " tilted more, and fill the picture",
            solved.views_px,
        )


def coverage(views: Sequence[View], size_px: tuple[int, int]) -> NDArray[np.int64]:
    """Return how many corners were seen in each of 3 x 3 parts of the picture."""
    counts = np.zeros((COVERAGE_CELLS, COVERAGE_CELLS), np.int64)
    for view in views:
        np.add.at(counts, _cells(view, size_px), 1)
    return counts


def _cells(view: View, size_px: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column of the part of the picture in which each corner lies."""
    parts = (view.seen_px.reshape(-1, 2) + 0.5) / size_px * COVERAGE_CELLS
    column, row = np.clip(parts, 0, COVERAGE_CELLS - 1).astype(np.int64).T
    return row, column


def of_cell(view: View, size_px: tuple[int, int]) -> list[str]:
    """Return the name of the part of the picture in which each corner lies."""
    return [_CELL_NAMES[row][column] for row, column in zip(*_cells(view, size_px), strict=True)]


def missing_cells(views: Sequence[View], size_px: tuple[int, int]) -> list[str]:
    """Return the names of the parts of the picture in which almost no corners were seen."""
    counts = coverage(views, size_px)
    return [_CELL_NAMES[row][column] for row, column in np.argwhere(counts <= 0.02 * counts.sum())]


def _advice(solved: _Solved, views: Sequence[View], size_px: tuple[int, int]) -> list[str]:
    missing = missing_cells(views, size_px)
    advice = []
    if missing:
        advice.append(f"no or few corners in the picture's {', '.join(missing)}: hold the board there")
    if len(views) < 10:
        advice.append(f"{len(views)} pictures are few: 15 make the result surer")
    if solved.tilt_deg < 2.0 * MIN_TILT_DEG:
        advice.append(f"the board is tilted by {solved.tilt_deg:.0f} deg at most: up to 40 deg would help")
    typical = float(np.median(list(solved.views_px.values())))
    bad = [name for name, error in solved.views_px.items() if error > max(3.0 * typical, 0.3)]
    if bad:
        advice.append(f"much worse than the others: {', '.join(bad)}: blurred? leave them out")
    return advice


def read_json(model: type[Section], path: Path) -> Any:
    """Return the content of a file written by `write_json`; raise ConfigError, one line."""
    try:
        return model.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; `starboard camera calibrate` writes it") from None
    except ValidationError as error:
        raise ConfigError(f"{path}: {first_line(error)}; is it written by `starboard camera`?") from None
