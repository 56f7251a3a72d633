"""Square markers (ArUco, AprilTag) of OpenCV's dictionaries: found as dark quadrilaterals, fitted, then read.

OpenCV gives the dictionaries; candidates, outline and reading are ours, because OpenCV's refinements err by half a
pixel under motion blur and below 40 px, and because a region around a predicted pose needs no search at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

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
    worst,
)
from camera_tracker.detectors.candidates import dark_quadrilaterals
from camera_tracker.detectors.codes import Reader, Reading, load_code, turned
from camera_tracker.detectors.edges import SETTLED_PX, Floats, Outline, fit_outline, heading_of, middle_of
from camera_tracker.detectors.template import align
from camera_tracker.sources import Image
from marine.frames import wrap_angle

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
_APART_PX = 0.3
"""By the code and by the outline the middle is not further apart, whatever lies on the marker, if it is to be good."""
_LARGE_PX = 90.0
"""Two sides of a marker that is large enough to see a bend."""
_BEND = 0.25
"""A lens moves no corner further than this part of a module from where straight edges would meet."""
_COARSE_PX, _SOFT, _SOFTEST = 8.0, 0.15, 0.2
"""Modules larger than this many px are blurred by so much of the larger side, or of the smaller one, of a module."""
_REACH_MODULES = 0.7
_GOOD_CONTRAST = 40.0
_BENT_PX = 0.15
"""An edge that is bent by this much is not seen as it is: the pose errs by 0.3 px then (benchmarks/tracker.py)."""
_BOW = 0.02
"""Lens and paper may bend an edge by this part of a module."""


class _Place(NamedTuple):
    """Where a marker lies, px."""

    corners: list[Point]
    middle: Point
    by_outline: bool = False
    """Whether the outline says so, not the whole code."""
    bent: bool = False
    """Whether the edges are not straight, and the middle is right all the same."""
    doubted: bool = False
    """Whether the whole code says something else than the outline, or nothing."""
    elsewhere: Sequence[Point] = ()
    """Corners by the code, if it says something else."""


def _placed(aligned: tuple[list[Point], Point] | None) -> _Place | None:
    return None if aligned is None else _Place(*aligned)


class SquareDetector(Detector):
    """Vehicles by square markers of one dictionary; the marker's x axis (left to right as printed) is the heading.

    markers: vehicle -> (id, angle in rad from the marker's x axis to the vehicle's); none: every marker, named by id.
    """

    def __init__(self, dictionary: str, markers: Mapping[str, tuple[int, float]]) -> None:
        self.names = tuple(markers)
        self._code = load_code(dictionary)
        self._every = not markers
        self._of_id = {marker: (name, heading) for name, (marker, heading) in markers.items()}
        self._reader = Reader(self._code, self._of_id)
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
        self,
        corners: Sequence[Point],
        image: Image,
        *,
        near: bool = False,
        settled_px: float = SETTLED_PX,
        again: bool = False,
    ) -> tuple[str, Detection] | None:
        """Fit and read a marker near corners; None when there is none that is known.

        again: the corners are those of the whole code, because an outline elsewhere did not agree with it.
        """
        a, b, c, d = corners
        sides_px = (math.dist(a, b) + math.dist(c, d), math.dist(b, c) + math.dist(d, a))
        module_px = min(sides_px) / (2 * self._code.size + 4)
        part = _around(corners, module_px + 2.0 if near else 3.0 * module_px + 6.0, image)
        grey = cv2.cvtColor(part.of(image), cv2.COLOR_BGR2GRAY).astype(np.float32)
        corners = [(x - part.x0, y - part.y0) for x, y in corners]
        reach_px = min(max(_REACH_MODULES * module_px, 2.0), 9.0)
        outline = fit_outline(grey, corners, reach_px, near=near, settled_px=settled_px)
        if outline is None:
            return None
        reading = self._reader.read(grey, outline.corners)
        if reading is None:
            return None
        name, heading = self._of_id.get(reading.marker, (str(reading.marker), 0.0))
        place = self._place(grey, outline, reading, sides_px)
        at = [(x + part.x0, y + part.y0) for x, y in place.corners]
        if place.by_outline and outline.step_px > SETTLED_PX < settled_px:
            return self._measure(at, image, near=True)
        if place.elsewhere and not again:
            near_code = [(x + part.x0, y + part.y0) for x, y in place.elsewhere]
            if (found := self._measure(near_code, image, near=True, again=True)) is not None:
                return found
        x_px, y_px = place.middle[0] + part.x0, place.middle[1] + part.y0
        quality, reason = worst(_checks((outline, reading, place), at, image, module_px))
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

    def _place(self, grey: Floats, outline: Outline, reading: Reading, sides_px: tuple[float, float]) -> _Place:
        """Return where a marker lies by its whole code, but by its outline where something lies on the code.

        The outline leaves out what glare or a hand changes, the code does not; noise hides the outline sooner. When
        nothing lies on the code and both disagree all the same, a lens has bent the marker.
        """
        by_outline = _Place(reading.corners, middle_of(reading.corners), by_outline=True)
        noisy = max(outline.std_px) > _NOISY_PX
        fit = partial(align, *self._template(grey, outline, reading, sides_px, noisy=noisy))
        by_code = _placed(fit())
        agrees = by_code is not None and max(map(math.dist, by_code.corners, by_outline.corners)) < _NEAR_PX
        if by_code is not None and agrees and not reading.strange:
            return by_code
        clear = max(outline.noise_px) <= _NOISY_PX
        if (
            clear
            and not agrees
            and min(sides_px) > _LARGE_PX
            and not (reading.strange and self._is_strange(grey, by_code))
        ):
            bent = _placed(fit(bent=True))
            reach_px = _BEND * min(sides_px) / (2 * self._code.size + 4)
            if bent is not None and max(map(math.dist, bent.corners, by_outline.corners)) < reach_px:
                return bent._replace(bent=True)
        doubted = by_code is None or (clear and math.dist(by_code.middle, by_outline.middle) > _APART_PX)
        elsewhere = by_code.corners if by_code is not None and doubted else ()
        best = by_code if by_code is not None and noisy else by_outline
        return best._replace(doubted=doubted, elsewhere=elsewhere)

    def _template(
        self, grey: Floats, outline: Outline, reading: Reading, sides_px: tuple[float, float], *, noisy: bool
    ) -> tuple[Floats, list[Point], NDArray[np.bool_], int, tuple[float, float]]:
        """Return what `align` takes; of large modules, whose edges would fall between its places, a softer picture."""
        modules = 2 * self._code.size + 4
        module_px, largest_px = min(sides_px) / modules, max(sides_px) / modules
        density = min(max(round(module_px), 2), _NOISY_DENSITY if noisy else _DENSITY)
        upper, right, lower, left = turned(outline.widths_px, reading.turns)
        blur_modules = (0.5 * (left + right) / module_px, 0.5 * (upper + lower) / module_px)
        if largest_px > _COARSE_PX:
            soft_px = min(_SOFT * largest_px, _SOFTEST * module_px)
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), soft_px), np.float32)
            a, b, c, d = reading.corners
            along = (math.dist(a, b) + math.dist(c, d), math.dist(b, c) + math.dist(d, a))
            x, y = (math.hypot(blur, modules * soft_px / side) for blur, side in zip(blur_modules, along, strict=True))
            blur_modules = (x, y)
        return grey, reading.corners, self._code.patterns[reading.marker], density, blur_modules

    def _is_strange(self, grey: Floats, place: _Place | None) -> bool:
        """Tell whether modules are not as the code says, where the code itself says that they are."""
        reading = None if place is None else self._reader.read(grey, place.corners)
        return reading is None or reading.strange


def _checks(
    fitted: tuple[Outline, Reading, _Place], corners: Sequence[Point], image: Image, module_px: float
) -> list[tuple[float, str]]:
    """Return the qualities of a reading with their reasons."""
    outline, reading, place = fitted
    height, width = image.shape[:2]
    covered = "glare" if reading.bright else "partly covered"
    inliers = min(outline.inliers)
    std_px = max(outline.std_px)
    blur = sum(outline.widths_px) / (4.0 * module_px)
    bent = outline.bent_px / max(_BENT_PX, _BOW * module_px)
    checks = [
        (min(1.0, min(outline.contrast) / _GOOD_CONTRAST), "low contrast"),
        (_or_doubt(2.0 * inliers - 0.8), covered),
        (_or_doubt(1.0 - 6.0 * reading.covered), covered),
        (1.0 if place.bent else _or_doubt(1.5 - bent), f"{covered}: the edges are not straight"),
        (_or_doubt(1.2 - 2.0 * std_px), "noise"),
        (_or_doubt(1.7 - 1.5 * blur), "blurred"),
        (1.0 - 0.2 * reading.wrong_bits, f"{reading.wrong_bits} wrong bits"),
    ]
    if not outline.settled:
        checks.append(doubtful("the outline does not settle"))
    if place.doubted:
        checks.append(doubtful(f"{covered}: the edges are not where the code says"))
    if not all(1.5 <= x <= width - 2.5 and 1.5 <= y <= height - 2.5 for x, y in corners):
        checks.append(doubtful("out of view: clipped at the edge of the picture"))
    return checks


def _or_doubt(quality: float) -> float:
    """Return a quality that leaves no middle between good and doubtful."""
    return min(quality, 1.0) if quality >= GOOD_QUALITY else DOUBTFUL_QUALITY


def _around(corners: Sequence[Point], margin_px: float, image: Image) -> Region:
    xs, ys = zip(*corners, strict=True)
    left, right, top, bottom = min(xs), max(xs), min(ys), max(ys)
    half_px = 0.5 * max(right - left, bottom - top) + margin_px
    return Region.around(0.5 * (left + right), 0.5 * (top + bottom), half_px, image)


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
