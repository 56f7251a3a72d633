"""What every detector takes and gives: picture and region in, detections with quality and reason out.

Integer pixel coordinates are pixel centres. Angles in rad, from x towards y: clockwise as one sees the picture.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any, NamedTuple

from numpy.typing import NDArray

from camera_tracker.sources import Image

GOOD_QUALITY = 0.5
"""From here on a pose is good: no more than 0.5 px wrong. A pose that is in doubt gets `DOUBTFUL_QUALITY`."""
DOUBTFUL_QUALITY = 0.2
AMBIGUOUS_QUALITY = 0.5
"""At most, while front and back are not known apart: the position is still good."""
_REASON_BELOW = 0.8


Point = tuple[float, float]
"""x, y in px."""


class Region(NamedTuple):
    """A part of a picture, in whole px: columns x0 <= x < x1, rows y0 <= y < y1."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def around(cls, x_px: float, y_px: float, half_px: float, image: Image) -> Region:
        """Return the square around a point, cut to the picture (at least one pixel of it)."""
        height, width = image.shape[:2]
        x0 = min(max(math.floor(x_px - half_px), 0), width - 1)
        y0 = min(max(math.floor(y_px - half_px), 0), height - 1)
        x1 = max(min(math.ceil(x_px + half_px) + 1, width), x0 + 1)
        y1 = max(min(math.ceil(y_px + half_px) + 1, height), y0 + 1)
        return cls(x0, y0, x1, y1)

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the view of a picture."""
        return image[self.y0 : self.y1, self.x0 : self.x1]


class Detection(NamedTuple):
    """Pose of a vehicle in a picture, with quality in 0..1 and the reason when it is low."""

    x_px: float
    y_px: float
    psi_rad: float
    quality: float
    reason: str
    heading_ambiguous: bool
    extent_px: float
    """How far the marker reaches from its middle, about."""
    misfit: float = 0.0
    """How badly it fits what was looked for, 0 (well) to 1."""
    corners_px: tuple[Point, ...] = ()
    """Corners of a square marker, clockwise from its upper left one as it was printed."""
    patches_px: tuple[Point, ...] = ()
    """Centres of the front and the rear one of two coloured patches."""
    several: bool = False
    """Two markers of this kind are in the picture: which of them it is is a guess."""
    region: Region | None = None
    """Where it was looked for; None: in the whole picture."""


class Prediction(NamedTuple):
    """Where and how a vehicle should be seen: its last detection, moved on and turned."""

    x_px: float
    y_px: float
    psi_rad: float
    last: Detection

    def moved(self, points_px: Iterable[Point]) -> list[Point]:
        """Return points of the last detection, moved and turned."""
        turn = self.psi_rad - self.last.psi_rad
        c, s = math.cos(turn), math.sin(turn)
        away = [(x - self.last.x_px, y - self.last.y_px) for x, y in points_px]
        return [(self.x_px + c * dx - s * dy, self.y_px + s * dx + c * dy) for dx, dy in away]


class Detector(ABC):
    """Finds vehicles by one kind of marker."""

    names: tuple[str, ...]
    """Vehicles it knows; empty: whatever it finds, named by itself."""

    @abstractmethod
    def look(self, image: Image, name: str, region: Region, prediction: Prediction) -> Detection | None:
        """Return a vehicle in a region of a picture (BGR) at full resolution, the one nearest to the prediction."""

    @abstractmethod
    def search(self, image: Image, names: Iterable[str]) -> dict[str, Detection]:
        """Return those of the vehicles that a search of the whole picture finds; if in doubt which, say so."""


def upper_median(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the median along the last axis (the upper one of two), at a fifth of numpy.median's cost."""
    middle = rows.shape[-1] // 2
    rows = rows.copy()
    rows.partition(middle)
    return rows[..., middle]


def worst(checks: list[tuple[float, str]]) -> tuple[float, str]:
    """Return the lowest of the qualities, and its reason when it is low."""
    quality, reason = min(checks)
    return quality, reason if quality < _REASON_BELOW else ""


def one_of_several(pose: Detection) -> Detection:
    """Return a detection that says that another one fits as well."""
    quality, reason = doubtful("two markers of this kind are in the picture")
    return pose._replace(quality=min(quality, pose.quality), reason=reason, several=True)


def doubtful(reason: str) -> tuple[float, str]:
    """Return the check of a pose that must not pass as good."""
    return DOUBTFUL_QUALITY, reason
