"""Thesis Algorithm 3.1: two laser dots, looked for in the whole picture first and in two small regions from then on."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.laser.ranging import LaserModule
from camera_tracker.sources import Image

REGION_PX = 41
"""n* = m* of Algorithm 3.1: a dot may move 20 px from one picture to the next."""
_BLUR_PX = 1.5
"""A dot is white in its middle and coloured around it: blurred, both are one spot."""
_MIN_EXCESS = 12.0
_NOISES = 6.0
"""A dot is so many standard deviations above the rest of the picture, in blurred colour excess."""
_MAX_CANDIDATES = 6
_MAX_AREA = 0.02
"""A dot covers no more of the picture."""
_ROWS_APART = 0.05
"""The dots are in one row, within this part of the picture's height."""

_CHANNELS = {"red": (2, (0, 1)), "green": (1, (0, 2))}


@dataclass(frozen=True)
class Dot:
    """A laser's dot: its centroid, and how much it stands out in grey levels."""

    x_px: float
    y_px: float
    strength: float


@dataclass(frozen=True)
class Reading:
    """What one picture gives. Without both dots it has no distance and no angle; `lost` says which is missing."""

    left: Dot | None
    right: Dot | None
    distance_m: float | None
    angle_rad: float | None
    lost: str
    whole_picture: bool
    """Whether the whole picture had to be searched (steps I and VI)."""


class DotTracker:
    """Reads one picture after the other."""

    def __init__(self, module: LaserModule) -> None:
        self._module = module
        self._last: tuple[Dot, Dot] | None = None

    def read(self, image: Image) -> Reading:
        """Find the dots in a picture (BGR), and their distance and angle."""
        middle = self._module.centre_x_px
        middle = 0.5 * (image.shape[1] - 1) if middle is None else middle
        pair = self._follow(image)
        whole = pair is None
        left, right = self._search(image, middle) if pair is None else pair
        self._last = (left, right) if left and right else None
        if left is None or right is None:
            lost = " and ".join(name for name, dot in (("left", left), ("right", right)) if dot is None)
            return Reading(left, right, None, None, f"{lost} dot lost", whole)
        distance_m, angle_rad = self._module.range(middle - left.x_px, right.x_px - middle)
        return Reading(left, right, distance_m, angle_rad, "", whole)

    def _follow(self, image: Image) -> tuple[Dot, Dot] | None:
        """Steps III to V: look around the last dots; None when one of them is not there."""
        if self._last is None:
            return None
        found = []
        for last in self._last:
            dots = _dots(image, _around(last, image), self._module.colour, 0.5 * last.strength)
            found.append(min(dots, key=lambda d: math.hypot(d.x_px - last.x_px, d.y_px - last.y_px), default=None))
        left, right = found
        if left is None or right is None or right.x_px - left.x_px < 3.0:
            return None
        return left, right

    def _search(self, image: Image, middle: float) -> tuple[Dot | None, Dot | None]:
        """Step I: the strongest pair in one row, one on each side of the middle; else the one dot that is there."""
        height, width = image.shape[:2]
        dots = _dots(image, (0, 0, width, height), self._module.colour, 0.0)[:_MAX_CANDIDATES]
        lefts, rights = [d for d in dots if d.x_px < middle], [d for d in dots if d.x_px > middle]
        pairs = [
            (left, right)
            for left, right in itertools.product(lefts, rights)
            if abs(left.y_px - right.y_px) <= _ROWS_APART * height
        ]
        if pairs:
            return max(pairs, key=lambda pair: min(pair[0].strength, pair[1].strength))
        if not dots:
            return None, None
        return (dots[0], None) if dots[0].x_px < middle else (None, dots[0])


def _around(dot: Dot, image: Image) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    half = REGION_PX // 2
    x, y = round(dot.x_px), round(dot.y_px)
    return max(x - half, 0), max(y - half, 0), min(x + half + 1, width), min(y + half + 1, height)


def _dots(image: Image, box: tuple[int, int, int, int], colour: str, at_least: float) -> list[Dot]:
    """Return the spots of a laser's colour in a part of a picture (x0, y0, x1, y1), strongest first.

    A spot that the edge of that part cuts is left out: the middle of what is left of it is px beside the dot's.
    """
    x0, y0, x1, y1 = box
    excess = _excess(image[y0:y1, x0:x1], colour)
    level = float(np.median(excess))
    noise = 1.4826 * float(np.median(np.abs(excess - level)))
    threshold = level + max(_MIN_EXCESS, _NOISES * noise)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((excess > threshold).astype(np.uint8), connectivity=8)
    dots = []
    for label in range(1, count):
        left, top, width, height, area = (int(v) for v in stats[label])
        cut_off = min(left, top) == 0 or left + width == x1 - x0 or top + height == y1 - y0
        if cut_off or area > _MAX_AREA * image.shape[0] * image.shape[1]:
            continue
        cut = np.s_[top : top + height, left : left + width]
        weights = np.where(labels[cut] == label, excess[cut] - threshold, 0.0)
        strength = float(weights.max()) + threshold - level
        if strength >= at_least:
            y, x = np.mgrid[top : top + height, left : left + width]
            total = float(weights.sum())
            dots.append(Dot(x0 + float((x * weights).sum()) / total, y0 + float((y * weights).sum()) / total, strength))
    return sorted(dots, key=lambda dot: -dot.strength)


def _excess(part: Image, colour: str) -> NDArray[np.float32]:
    """Return how much the laser's channel stands out over the mean of the others, blurred."""
    channel, others = _CHANNELS[colour]
    planes = part.astype(np.float32)
    excess = planes[:, :, channel] - 0.5 * (planes[:, :, others[0]] + planes[:, :, others[1]])
    return np.asarray(cv2.GaussianBlur(excess, (0, 0), _BLUR_PX), np.float32)
