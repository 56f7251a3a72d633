"""What is on a square marker: OpenCV's dictionaries, and reading one of their codes from a grey picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.detectors.base import Point, upper_median
from camera_tracker.detectors.edges import Floats
from camera_tracker.detectors.template import homography

T = TypeVar("T")

_STRANGE_MODULE = 0.12
"""A module that differs by this part of the contrast may have some glare on it, or a shadow."""
_WRONG_MODULE = 0.25
"""A module that differs from what the code says by this part of the contrast is covered or shone upon."""
_MOST_COVERED = 0.08
"""A code that could only be read from sharpened modules has no more wrong ones: else anything dark were a marker."""


@dataclass(frozen=True)
class Code:
    """Dictionary of markers with `size` x `size` bits. words: (ids, 4) bits as numbers, by id and quarter turns."""

    size: int
    words: NDArray[np.uint64]
    patterns: NDArray[np.bool_]
    """(ids, size + 4, size + 4): true where white, with the black border and a white ring around it."""
    correctable: int
    """Wrong bits that are put up with: 60 % of what the dictionary can correct, as OpenCV does."""
    models: dict[tuple[int, int], tuple[Floats, Floats]] = field(default_factory=dict)

    def model(self, marker: int, turns: int) -> tuple[Floats, Floats]:
        """Return a marker's linear model (modules, 3): its own white, its neighbours', one; and the inverse."""
        if (marker, turns) not in self.models:
            pattern = np.rot90(self.patterns[marker], turns).astype(np.float32)
            padded = np.pad(pattern, 1, mode="edge")
            around = 0.25 * (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:])
            design = np.stack([pattern.ravel(), around.ravel(), np.ones(pattern.size)], axis=1)
            self.models[marker, turns] = (design, np.linalg.pinv(design))
        return self.models[marker, turns]


@lru_cache(maxsize=8)
def load_code(name: str) -> Code:
    """Return a dictionary by OpenCV's name without DICT_, in lower case: 4x4_50, apriltag_36h11."""
    number = next(v for k, v in vars(cv2.aruco).items() if k.lower() == f"dict_{name}")
    book = cv2.aruco.getPredefinedDictionary(number)
    size, count = book.markerSize, book.bytesList.shape[0]
    patterns = np.ones((count, size + 4, size + 4), np.bool_)
    for i in range(count):
        patterns[i, 1:-1, 1:-1] = cv2.aruco.generateImageMarker(book, i, size + 2) > 127
    words = np.stack([_words(np.rot90(patterns[:, 2:-2, 2:-2], k, axes=(1, 2))) for k in range(4)], axis=1)
    return Code(size, words, patterns, int(0.6 * book.maxCorrectionBits))


def _words(bits: NDArray[np.bool_]) -> NDArray[np.uint64]:
    flat = bits.reshape(len(bits), -1)
    return np.asarray((flat * (np.uint64(1) << np.arange(flat.shape[1], dtype=np.uint64))).sum(axis=1), np.uint64)


class Reading(NamedTuple):
    """A marker that was read: its id, and what speaks against it."""

    marker: int
    turns: int
    corners: list[Point]
    wrong_bits: int
    covered: float
    """Part of the modules that are not as the code says."""
    strange: bool
    """Whether a module is not quite as the code says."""
    bright: bool
    """Whether those are too bright rather than too dark."""


class Reader:
    """Reads markers of a dictionary; ids: those that are known, none: all."""

    def __init__(self, code: Code, ids: Iterable[int] = ()) -> None:
        self._code = code
        self._ids = np.asarray(sorted(ids) or range(len(code.words)))
        self._known = code.words[self._ids]

    def read(self, grey: Floats, corners: list[Point]) -> Reading | None:
        """Read the marker inside corners: its code, its turn, and which modules are not as they should be."""
        size = self._code.size
        levels = _sample(grey, corners, size)
        if levels is None:
            return None
        black, white = (float(upper_median(levels[ring])) for ring in _rings(size))
        if white - black < 8.0:
            return None
        inner = levels.reshape(size + 4, -1)[2:-2, 2:-2]
        best, wrong_bits = self._nearest(inner > 0.5 * (black + white))
        sure = wrong_bits <= self._code.correctable
        if not sure:
            best, wrong_bits = min(
                map(self._nearest, _other_bits(levels, size, white, black)), key=lambda found: found[1]
            )
            if wrong_bits > self._code.correctable // 2:
                return None
        marker, turns = int(self._ids[best // 4]), best % 4
        error = _misfit(levels, *self._code.model(marker, turns))
        covered = sum(abs(e) > _WRONG_MODULE for e in error) / len(error)
        if not sure and covered > _MOST_COVERED:
            return None
        return Reading(
            marker=marker,
            turns=turns,
            corners=turned(corners, turns),
            wrong_bits=wrong_bits,
            covered=covered,
            strange=max(map(abs, error)) > _STRANGE_MODULE,
            bright=sum(e for e in error if abs(e) > 0.1) >= 0.0,
        )

    def _nearest(self, bits: NDArray[np.bool_]) -> tuple[int, int]:
        """Return which of the known words is nearest to the bits of a marker, and how many of them differ."""
        word = np.uint64(int.from_bytes(np.packbits(bits, bitorder="little").tobytes(), "little"))
        distance = np.bitwise_count(self._known ^ word)
        best = int(distance.argmin())
        return best, int(distance.flat[best])


def turned(items: list[T], turns: int) -> list[T]:
    """Return corners or edges of a marker from its upper left corner as printed."""
    return items[-turns:] + items[:-turns]


def _other_bits(levels: Floats, size: int, white: float, black: float) -> list[NDArray[np.bool_]]:
    """Return the bits as blur or uneven light may hide them: modules against their neighbours, and by their own range.

    Blur mixes a module with its neighbours, which is taken back; a glossy marker's white may be darker than its rim's.
    """
    square = levels.reshape(size + 4, -1)
    around = 0.25 * (square[:-2, 1:-1] + square[2:, 1:-1] + square[1:-1, :-2] + square[1:-1, 2:])
    sharp = (2.0 * square[1:-1, 1:-1] - around)[1:-1, 1:-1]
    inner = square[2:-2, 2:-2]
    return [sharp > 0.5 * (black + white), inner > 0.5 * (inner.min() + inner.max())]


def _misfit(levels: Floats, design: Floats, solver: Floats) -> list[float]:
    """Return how much each module is brighter than its code and its neighbours explain, as a part of the contrast.

    The neighbours stand for blur: it mixes a module with what lies around it.
    """
    factors = solver @ levels
    contrast = max(float(factors[0] + factors[1]), 1e-6)
    errors: list[float] = ((levels - design @ factors) / contrast).tolist()
    return errors


@lru_cache(maxsize=8)
def _rings(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which of the (size + 4)^2 modules are the black border and which the white ring around it."""
    at = np.arange(size + 4)
    far = np.minimum(np.minimum(at, at[::-1])[:, None], np.minimum(at, at[::-1])).ravel()
    return np.flatnonzero(far == 1), np.flatnonzero(far == 0)


@lru_cache(maxsize=8)
def _grid(size: int) -> NDArray[np.float32]:
    """Return nine points in each module, white ring included, in half sides of the marker: (x, y, 1)."""
    at = np.arange(-1, size + 3) + 0.5
    inside = np.array([-0.25, 0.0, 0.25])
    x, y, dx, dy = np.meshgrid(at, at, inside, inside, indexing="xy")
    half = 0.5 * size + 1.0
    return np.stack([(x + dx).ravel() / half - 1.0, (y + dy).ravel() / half - 1.0, np.ones(x.size)]).astype(np.float32)


def _sample(grey: Floats, corners: Sequence[Point], size: int) -> Floats | None:
    """Return the mean grey level of each of the (size + 4)^2 modules, the ring around the marker included."""
    h = homography(corners)
    if h is None:
        return None
    points = h.astype(np.float32) @ _grid(size)
    x, y = (points[:2] / points[2]).reshape(2, -1, 9)
    values = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(np.add.reduce(values, axis=1) / 9.0)
