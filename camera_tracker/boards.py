"""Printed boards and markers: what is where on them, in metres, and where their corners are in a picture.

Sub-pixel corners of a board come from chessboard corners (two black squares that meet), which blur does not move; the
boards are photographed at rest.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.calibration import View
from camera_tracker.sources import Image

BOARD_DICTIONARY = "5x5_100"
"""Of the board's own markers: another one than the vessels', so that neither is taken for the other."""
MARKER_DICTIONARY = "4x4_50"
MIN_CORNERS = 8
"""A view with fewer says little; ChArUco corners may be partly covered."""
_CHESSBOARD_WIDTH_PX = 960
"""A wider picture is reduced to find a chessboard: that takes 0.2 s at this width, and four times as long at twice."""
MARKER_PART = 0.75
"""Side of a ChArUco board's markers, in squares."""


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's dictionary of a name such as 4x4_50 or apriltag_36h11; raise ValueError that lists them."""
    known = {key.removeprefix("DICT_").lower(): n for key, n in vars(cv2.aruco).items() if key.startswith("DICT_")}
    if name not in known:
        raise ValueError(f"no dictionary {name}; known: {', '.join(sorted(known))}")
    return cv2.aruco.getPredefinedDictionary(known[name])


class Board(ABC):
    """A flat board with corners at known places."""

    @abstractmethod
    def view(self, name: str, image: Image) -> View | None:
        """Return the board's corners in a picture, None when it is not seen well enough."""


@dataclass(frozen=True)
class Chessboard(Board):
    """columns x rows *inner* corners, squares of square_m. All corners must be seen."""

    columns: int
    rows: int
    square_m: float

    def view(self, name: str, image: Image) -> View | None:
        """Return all corners, or None."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        factor = math.ceil(grey.shape[1] / _CHESSBOARD_WIDTH_PX)
        small = grey
        if factor > 1:
            size = (max(grey.shape[1] // factor, 1), max(grey.shape[0] // factor, 1))
            small = cv2.resize(grey[: size[1] * factor, : size[0] * factor], size, interpolation=cv2.INTER_AREA)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCornersSB(small, (self.columns, self.rows), flags=flags)
        if not found:
            return None
        if factor > 1:
            corners = self._refined(grey, (factor * (corners + 0.5) - 0.5).astype(np.float32))
        y, x = np.mgrid[0 : self.rows, 0 : self.columns].astype(np.float32) * np.float32(self.square_m)
        board = np.stack([x.ravel(), y.ravel(), np.zeros(x.size, np.float32)], axis=1)
        return View(name, board, np.asarray(corners, np.float32).reshape(-1, 1, 2))

    def _refined(self, grey: NDArray[Any], corners: NDArray[np.float32]) -> NDArray[Any]:
        """Return corners of a reduced picture, (n, 1, 2) px, where the whole picture has them."""
        grid = corners.reshape(self.rows, self.columns, 2)
        steps = np.concatenate([np.diff(grid, axis=k).reshape(-1, 2) for k in (0, 1)])
        half = max(2, int(0.35 * float(np.hypot(steps[:, 0], steps[:, 1]).min())))  # no other corner comes into sight
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)
        return cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria)


class Charuco(Board):
    """columns x rows squares, black ones and white ones with a marker, as `starboard camera print-board` prints it."""

    def __init__(self, columns: int, rows: int, square_m: float) -> None:
        self.columns, self.rows, self.square_m = columns, rows, square_m
        markers = dictionary(BOARD_DICTIONARY)
        if columns * rows // 2 > markers.bytesList.shape[0] or min(columns, rows) < 3:
            raise ValueError(f"a board of {columns} x {rows} squares: 3 x 3 to 200 squares are possible")
        self.board = cv2.aruco.CharucoBoard((columns, rows), square_m, MARKER_PART * square_m, markers)
        self._detector = cv2.aruco.CharucoDetector(self.board)

    def view(self, name: str, image: Image) -> View | None:
        """Return the corners that are seen, or None when fewer than `MIN_CORNERS`, or all in one line."""
        corners, ids, _, _ = self._detector.detectBoard(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if ids is None or len(ids) < MIN_CORNERS:
            return None
        board, seen = self.board.matchImagePoints(corners, ids)  # type: ignore[call-overload]
        flat = np.asarray(board, np.float32).reshape(-1, 3)
        if min(len(np.unique(flat[:, 0].round(6))), len(np.unique(flat[:, 1].round(6)))) < 2:
            return None
        return View(name, flat, np.asarray(seen, np.float32).reshape(-1, 1, 2))

    def squares(self) -> list[tuple[float, float, float]]:
        """Return the black squares of the print as (x, y, side) in m from the upper left, markers' cells included."""
        side = self.square_m
        black = [
            (column * side, row * side, side)
            for row in range(self.rows)
            for column in range(self.columns)
            if (row + column) % 2 == 0
        ]
        for number, corners in zip(np.ravel(self.board.getIds()), self.board.getObjPoints(), strict=True):
            x, y = (float(v) for v in np.asarray(corners)[0, :2])
            black += marker_squares(BOARD_DICTIONARY, int(number), x, y, MARKER_PART * side)
        return black


def marker_squares(name: str, number: int, x: float, y: float, side: float) -> list[tuple[float, float, float]]:
    """Return the black cells of a marker with its upper left corner at (x, y); raise ValueError for a wrong number."""
    markers = dictionary(name)
    count = markers.bytesList.shape[0]
    if not 0 <= number < count:
        raise ValueError(f"marker {number}: dictionary {name} has 0 to {count - 1}")
    cells = markers.markerSize + 2
    bits: NDArray[np.uint8] = np.asarray(markers.generateImageMarker(number, cells), np.uint8)
    cell = side / cells
    return [(x + column * cell, y + row * cell, cell) for row, column in np.argwhere(bits == 0).tolist()]
