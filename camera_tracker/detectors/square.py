"""Square markers (ArUco, AprilTag) of OpenCV's dictionaries: found as dark quadrilaterals, fitted, then read.

OpenCV gives the dictionaries; candidates, outline and reading are ours, because OpenCV's refinements err by half a
pixel under motion blur and below 40 px, and because a region around a predicted pose needs no search at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.detectors.base import (
    DOUBTFUL_QUALITY,
    GOOD_QUALITY,
    Detection,
    Detector,
    Point,
    Prediction,
    Region,
    doubtful,
    one_of_several,
    upper_median,
    worst,
)
from camera_tracker.detectors.candidates import dark_quadrilaterals
from camera_tracker.detectors.edges import SETTLED_PX, Floats, Outline, fit_outline, heading_of, middle_of
from camera_tracker.detectors.template import align, homography
from camera_tracker.sources import Image
from marine.frames import wrap_angle

T = TypeVar("T")

_COARSE_WIDTH_PX, _FINE_WIDTH_PX = 960, 2000
"""A search halves the picture until it is no wider than this: each time, and when markers are missing now and then."""
_DOUBLED_WIDTH_PX = 1000
"""A picture no wider than this is doubled with the finer search: markers of 14 px become as clear as those of 28."""
_FINE_EVERY = 10
_NOISY_PX = 0.04
"""When an edge is known no better than this, the marker is fitted by its whole code."""
_DENSITY, _NOISY_DENSITY = 4, 8
"""Places per module at most, for that: more of them average more noise."""
_NEAR_PX = 0.25
"""Without noise, corners by the code and by the outline are not further apart, unless something is on the marker."""
_ROUGH_PX = 0.3
"""Where the whole code gives the place, the outline may be wrong by a small part of this: its step to there."""
_STRANGE_MODULE = 0.12
"""A module that differs by this part of the contrast may have some glare on it, or a shadow."""
_REACH_MODULES = 0.7
_GOOD_CONTRAST = 40.0
_BENT_PX = 0.15
"""An edge that is bent by this much is not seen as it is: the pose errs by 0.3 px then (benchmarks/tracker.py)."""
_BOW = 0.02
"""Lens and paper may bend an edge by this part of a module."""
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


class _Reading(NamedTuple):
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


class SquareDetector(Detector):
    """Vehicles by square markers of one dictionary; the marker's x axis (left to right as printed) is the heading.

    markers: vehicle -> (id, angle in rad from the marker's x axis to the vehicle's); none: every marker, named by id.
    """

    def __init__(self, dictionary: str, markers: Mapping[str, tuple[int, float]]) -> None:
        self.names = tuple(markers)
        self._code = load_code(dictionary)
        self._every = not markers
        self._of_id = {marker: (name, heading) for name, (marker, heading) in markers.items()}
        ids = sorted(self._of_id) or range(len(self._code.words))
        self._ids = np.asarray(ids)
        self._known = self._code.words[self._ids]
        self._misses = 0

    def look(self, image: Image, name: str, region: Region, prediction: Prediction) -> Detection | None:
        """Return a vehicle near its prediction: by fitting the predicted outline, else by a search of the region."""
        found = None
        if corners := prediction.moved(prediction.last.corners_px):
            found = self._measure(corners, image, near=True, settled_px=_ROUGH_PX)
        if found is not None and found[0] == name and found[1].quality >= GOOD_QUALITY:
            return found[1]
        grey = cv2.cvtColor(region.of(image), cv2.COLOR_BGR2GRAY)
        seen = [d for n, d in self._candidates(grey, 1, region, image) if n == name]
        if found is not None and found[0] == name:
            seen.append(found[1])
        return min(
            seen,
            key=lambda d: (d.quality < GOOD_QUALITY, math.hypot(d.x_px - prediction.x_px, d.y_px - prediction.y_px)),
            default=None,
        )

    def search(self, image: Image, names: Iterable[str]) -> dict[str, Detection]:
        """Return the vehicles found in the whole picture; where two markers are alike the pose is doubtful."""
        coarse, fine = _reduction(image, _COARSE_WIDTH_PX), _reduction(image, _FINE_WIDTH_PX)
        wanted = set(names)
        seen = self._seen(image, coarse, wanted)
        if self._every or wanted - {name for name, _ in seen}:
            if self._every or self._misses % _FINE_EVERY == 0:
                if fine < coarse:
                    seen += self._seen(image, fine, wanted)
                if image.shape[1] <= _DOUBLED_WIDTH_PX:
                    seen += self._seen(image, 0.5, wanted)
            self._misses += 1
        else:
            self._misses = 0
        found: dict[str, Detection] = {}
        for name, detection in seen:
            found[name] = _better(found[name], detection) if name in found else detection
        return found

    def _seen(self, image: Image, factor: float, wanted: set[str]) -> list[tuple[str, Detection]]:
        """Return what is found in a picture reduced by a factor."""
        height, width = image.shape[:2]
        grey = cv2.cvtColor(_reduced(image, factor), cv2.COLOR_BGR2GRAY)
        found = self._candidates(grey, factor, Region(0, 0, width, height), image)
        return [(name, detection) for name, detection in found if self._every or name in wanted]

    def _candidates(
        self, grey: NDArray[Any], factor: float, region: Region, image: Image
    ) -> list[tuple[str, Detection]]:
        """Return what is read from the dark quadrilaterals of a grey picture of the region, reduced by a factor."""
        found = []
        for corners in dark_quadrilaterals(grey):
            at = factor * (corners + 0.5) - 0.5 + (region.x0, region.y0)
            measured = self._measure([(x, y) for x, y in at.tolist()], image)
            if measured is not None:
                found.append(measured)
        return found

    def _measure(
        self, corners: Sequence[Point], image: Image, *, near: bool = False, settled_px: float = SETTLED_PX
    ) -> tuple[str, Detection] | None:
        """Fit and read a marker near corners; None when there is none that is known."""
        a, b, c, d = corners
        sides_px = (math.dist(a, b) + math.dist(c, d), math.dist(b, c) + math.dist(d, a))
        module_px = min(sides_px) / (2 * self._code.size + 4)
        part = _around(corners, module_px + 4.0 if near else 3.0 * module_px + 6.0, image)
        grey = cv2.cvtColor(part.of(image), cv2.COLOR_BGR2GRAY).astype(np.float32)
        corners = [(x - part.x0, y - part.y0) for x, y in corners]
        reach_px = min(max(_REACH_MODULES * module_px, 2.0), 9.0)
        outline = fit_outline(grey, corners, reach_px, near=near, settled_px=settled_px)
        if outline is None:
            return None
        reading = self._read(grey, outline)
        if reading is None:
            return None
        name, heading = self._of_id.get(reading.marker, (str(reading.marker), 0.0))
        aligned = self._aligned(grey, outline, reading, module_px)
        at = [(x + part.x0, y + part.y0) for x, y in aligned or reading.corners]
        if aligned is None and outline.step_px > SETTLED_PX < settled_px:
            return self._measure(at, image, near=True)
        x_px, y_px = middle_of(at)
        quality, reason = worst(_checks(outline, reading, at, image, module_px))
        return name, Detection(
            x_px=x_px,
            y_px=y_px,
            psi_rad=wrap_angle(heading_of(at) + heading),
            quality=quality,
            reason=reason,
            heading_ambiguous=False,
            extent_px=max(math.dist((x_px, y_px), corner) for corner in at),
            misfit=reading.covered,
            corners_px=tuple(at),
        )

    def _aligned(self, grey: Floats, outline: Outline, reading: _Reading, module_px: float) -> list[Point] | None:
        """Return the corners by the whole code; None where something lies on the code, and those of the outline count.

        The outline leaves out what glare or a hand changes, the code does not; noise hides the outline sooner.
        """
        noisy = max(outline.std_px) > _NOISY_PX
        if not noisy and reading.strange:
            return None
        pattern = self._code.patterns[reading.marker]
        density = min(max(round(module_px), 2), _NOISY_DENSITY if noisy else _DENSITY)
        upper, right, lower, left = _turned(outline.widths_px, reading.turns)
        blur_modules = (0.5 * (left + right) / module_px, 0.5 * (upper + lower) / module_px)
        aligned = align(grey, reading.corners, pattern, density, blur_modules)
        if aligned is None or (not noisy and max(map(math.dist, aligned, reading.corners)) > _NEAR_PX):
            return None
        return aligned

    def _nearest(self, bits: NDArray[np.bool_]) -> tuple[int, int]:
        """Return which of the known words is nearest to the bits of a marker, and how many of them differ."""
        word = np.uint64(int.from_bytes(np.packbits(bits, bitorder="little").tobytes(), "little"))
        distance = np.bitwise_count(self._known ^ word)
        best = int(distance.argmin())
        return best, int(distance.flat[best])

    def _read(self, grey: Floats, outline: Outline) -> _Reading | None:
        """Read the marker inside an outline: its code, its turn, and which modules are not as they should be."""
        size = self._code.size
        levels = _sample(grey, outline.corners, size)
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
        return _Reading(
            marker=marker,
            turns=turns,
            corners=_turned(outline.corners, turns),
            wrong_bits=wrong_bits,
            covered=covered,
            strange=max(map(abs, error)) > _STRANGE_MODULE,
            bright=sum(e for e in error if abs(e) > 0.1) >= 0.0,
        )


def _checks(
    outline: Outline, reading: _Reading, corners: Sequence[Point], image: Image, module_px: float
) -> list[tuple[float, str]]:
    """Return the qualities of a reading with their reasons."""
    height, width = image.shape[:2]
    covered = "glare" if reading.bright else "partly covered"
    inliers = min(outline.inliers)
    std_px = max(outline.std_px)
    blur = sum(outline.widths_px) / (4.0 * module_px)
    checks = [
        (min(1.0, min(outline.contrast) / _GOOD_CONTRAST), "low contrast"),
        (_or_doubt(2.0 * inliers - 0.8), covered),
        (_or_doubt(1.0 - 6.0 * reading.covered), covered),
        (_or_doubt(1.5 - outline.bent_px / max(_BENT_PX, _BOW * module_px)), f"{covered}: the edges are not straight"),
        (_or_doubt(1.2 - 2.0 * std_px), "noise"),
        (_or_doubt(1.7 - 1.5 * blur), "blurred"),
        (1.0 - 0.2 * reading.wrong_bits, f"{reading.wrong_bits} wrong bits"),
    ]
    if not outline.settled:
        checks.append(doubtful("the outline does not settle"))
    if not all(1.5 <= x <= width - 2.5 and 1.5 <= y <= height - 2.5 for x, y in corners):
        checks.append(doubtful("out of view: clipped at the edge of the picture"))
    return checks


def _or_doubt(quality: float) -> float:
    """Return a quality that leaves no middle between good and doubtful."""
    return min(quality, 1.0) if quality >= GOOD_QUALITY else DOUBTFUL_QUALITY


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


def _around(corners: Sequence[Point], margin_px: float, image: Image) -> Region:
    xs, ys = zip(*corners, strict=True)
    left, right, top, bottom = min(xs), max(xs), min(ys), max(ys)
    half_px = 0.5 * max(right - left, bottom - top) + margin_px
    return Region.around(0.5 * (left + right), 0.5 * (top + bottom), half_px, image)


def _turned(items: list[T], turns: int) -> list[T]:
    """Return corners or edges of a marker from its upper left corner as printed."""
    return items[-turns:] + items[:-turns]


def _reduction(image: Image, width_px: int) -> int:
    """Return the power of 2 by which to reduce a picture so that it is no wider than so many px."""
    factor = 1
    while image.shape[1] > width_px * factor and min(image.shape[:2]) >= 4 * factor:
        factor *= 2
    return factor


def _reduced(image: Image, factor: float) -> Image:
    """Return a picture reduced by a power of 2, or doubled (0.5)."""
    if factor == 1:
        return image
    if factor < 1:
        return np.asarray(cv2.resize(image, None, fx=1.0 / factor, fy=1.0 / factor), np.uint8)
    height, width = (int(v // factor) for v in image.shape[:2])
    whole = image[: int(height * factor), : int(width * factor)]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _better(one: Detection, other: Detection) -> Detection:
    """Return the better of two detections; a doubtful one when they are two markers of the same kind."""
    best = max(one, other, key=lambda d: d.quality)
    if math.hypot(one.x_px - other.x_px, one.y_px - other.y_px) < 0.5 * one.extent_px:
        return best
    return one_of_several(best)
