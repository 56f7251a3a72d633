"""A calibration board before the simulator's camera: somebody holds it still in one pose after the other."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.boards import Charuco
from camera_tracker.sources import Image
from marine.vessel import Camera

COLUMNS, ROWS, SQUARE_M = 9, 6, 0.03
"""The board of `starboard camera print-board`."""
HELD_S, MOVED_S = 1.6, 0.4
_PX_PER_M = 2000.0
_RIM_M = 0.01
_FINE = 2
_PAPER, _INK = 215.0, 35.0

# Where its middle is in the picture (parts of width and height from the picture's middle), its tilts about x and y in
# rad, its turn in the picture, and how much of the picture's width it fills.
_POSES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.55),
    (-0.24, -0.2, 0.3, 0.35, 0.1, 0.5),
    (0.24, -0.2, 0.35, -0.3, -0.1, 0.5),
    (0.24, 0.2, -0.35, -0.35, 0.1, 0.5),
    (-0.24, 0.2, -0.3, 0.35, 0.0, 0.5),
    (0.0, -0.22, 0.55, 0.0, 0.2, 0.5),
    (0.0, 0.22, -0.55, 0.1, -0.2, 0.5),
    (0.25, 0.0, 0.0, -0.6, 0.1, 0.5),
    (-0.25, 0.0, 0.1, 0.6, -0.1, 0.5),
    (0.0, 0.0, 0.6, 0.1, 1.2, 0.4),
    (0.0, 0.0, -0.1, 0.6, -0.4, 0.45),
    (0.05, 0.0, -0.6, 0.0, 0.3, 0.6),
    (-0.05, 0.0, 0.1, -0.6, 0.6, 0.6),
    (0.3, -0.28, 0.1, 0.0, 0.0, 0.35),
    (-0.3, 0.28, 0.0, 0.1, 0.0, 0.35),
    (0.0, 0.05, 0.0, 0.0, 1.57, 0.42),
)
Place = tuple[float, float, float, float, float, float]


class HeldBoard:
    """Draws the board over pictures of a camera without distortion, with its axis in the picture's middle."""

    def __init__(self, camera: Camera) -> None:
        self._size = (camera.width_px, camera.height_px)
        self.focal_px = camera.scale_px_per_m * camera.height_m
        """What a calibration should find."""
        self._plan = _plan()
        self._drawn: tuple[Place, Image, NDArray[np.bool_]] | None = None

    def draw(self, image: Image, now_s: float) -> None:
        """Draw the board as it is held at a time: each pose for `HELD_S`, then moved on within `MOVED_S`."""
        place = _place_at(now_s)
        if self._drawn is None or self._drawn[0] != place:
            self._drawn = (place, *self._seen(place))
        _, picture, cover = self._drawn
        np.copyto(image, picture, where=cover)

    def _seen(self, place: Place) -> tuple[Image, NDArray[np.bool_]]:
        """Return the picture of the board in a place, and where it covers what is behind."""
        width, height = self._size
        x, y, about_x, about_y, turn, part = place
        length_m, depth_m = COLUMNS * SQUARE_M, ROWS * SQUARE_M
        distance_m = length_m * self.focal_px / (part * width)
        turned = cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
        tilted = cv2.Rodrigues(np.array([about_x, about_y, 0.0]))[0]
        rotation = np.asarray(tilted @ turned, np.float64)
        middle = np.array([x * width, y * height, self.focal_px]) * distance_m / self.focal_px
        corner = middle - rotation @ (0.5 * length_m, 0.5 * depth_m, 0.0)
        # Whole numbers are pixel centres, in the plan and in the fine picture alike.
        lens = np.array([[self.focal_px, 0, 0.5 * (width - 1)], [0, self.focal_px, 0.5 * (height - 1)], [0, 0, 1]])
        fine = np.array([[_FINE, 0, 0.5 * (_FINE - 1)], [0, _FINE, 0.5 * (_FINE - 1)], [0, 0, 1]])
        offset_m = 0.5 / _PX_PER_M - _RIM_M
        metres = np.array([[1 / _PX_PER_M, 0, offset_m], [0, 1 / _PX_PER_M, offset_m], [0, 0, 1]])
        seen = fine @ lens @ np.column_stack([rotation[:, 0], rotation[:, 1], corner]) @ metres
        big = cv2.warpPerspective(self._plan, seen, (_FINE * width, _FINE * height), flags=cv2.INTER_LINEAR)
        small = np.asarray(cv2.GaussianBlur(cv2.resize(big, self._size, interpolation=cv2.INTER_AREA), (0, 0), 0.7))
        picture = np.repeat(small[..., None], 3, axis=2).astype(np.uint8, copy=False)
        return picture, picture > _INK - 5.0


def _place_at(now_s: float) -> Place:
    number, phase_s = divmod(now_s, HELD_S + MOVED_S)
    pose, following = _POSES[int(number) % len(_POSES)], _POSES[(int(number) + 1) % len(_POSES)]
    part = max(0.0, (phase_s - HELD_S) / MOVED_S)
    part = 0.5 - 0.5 * math.cos(math.pi * part)
    a, b, c, d, e, f = (p + part * (q - p) for p, q in zip(pose, following, strict=True))
    return a, b, c, d, e, f


def _plan() -> Image:
    """Return the board from above with a white rim, in grey levels, `_PX_PER_M`."""
    rim = round(_RIM_M * _PX_PER_M)
    size = (round(COLUMNS * SQUARE_M * _PX_PER_M), round(ROWS * SQUARE_M * _PX_PER_M))
    drawn = Charuco(COLUMNS, ROWS, SQUARE_M).board.generateImage(size)
    white = np.pad(np.asarray(drawn, np.float32) / 255.0, rim, constant_values=1.0)
    return np.asarray(_INK + (_PAPER - _INK) * white, np.uint8)
