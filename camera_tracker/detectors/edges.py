"""The outline of a square marker to a hundredth of a pixel: a straight line through the gradient of each edge.

`cornerSubPix` looks at corners, which blur rounds off, and is half a pixel wrong under motion blur; a line through a
whole edge is moved by no blur that is the same to both sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.detectors.base import Point, upper_median

Floats = NDArray[np.float32]

_INSET = 0.1
"""This part of an edge at either end is left out: blur bends it around the corner."""
_POINTS = 40
_MIN_STEP = 8.0
"""Grey levels across an edge below which it is none."""
_OUTLIER_PX = 0.2
_ITERATIONS = 5
SETTLED_PX = 0.1


class Outline(NamedTuple):
    """Four fitted edges. Edge i goes from corner i to corner i + 1.

    corners: px, clockwise. contrast: grey levels across each edge. inliers: part of the points of each edge
    that lie on its line. std_px: of each edge's line, from the scatter of its points. noise_px: the same without the
    part of that scatter that is no noise, because neighbours have it in common; bent_px: that part, of the worst edge.
    widths_px: of each blurred edge, standard deviation. step_px: how far the last iteration moved the lines. settled:
    whether that was near enough.
    """

    corners: list[Point]
    contrast: list[float]
    inliers: list[float]
    std_px: list[float]
    noise_px: list[float]
    bent_px: float
    widths_px: list[float]
    step_px: float
    settled: bool


class _Crossing(NamedTuple):
    """Profiles across four edges. offsets (4, n): of the edge from the line, px. good: those that show a step."""

    offsets: Floats
    good: NDArray[np.bool_]
    contrast: list[float]
    widths_px: list[float]


class _Lines(NamedTuple):
    """offsets = offset + slope t of each of four edges, through the points with weight 1 (4, n), not 0."""

    coefficients: list[tuple[float, float]]
    weight: Floats
    residual: Floats

    def step_px(self) -> float:
        return max(abs(offset) + 0.5 * abs(slope) for offset, slope in self.coefficients)

    def scatter(self) -> tuple[list[float], list[float], list[float]]:
        """Return how many inliers each edge has, their variance, and what of it neighbours have in common."""
        inliers = self.residual * self.weight
        pairs = self.weight[:, 1:] * self.weight[:, :-1]
        steps = (inliers[:, 1:] - inliers[:, :-1]) * pairs
        counts, squares, pair_counts, step_squares = (
            np.add.reduce(v, axis=1).tolist() for v in (self.weight, inliers * inliers, pairs, steps * steps)
        )
        spreads = [s / max(n - 2.0, 1.0) for n, s in zip(counts, squares, strict=True)]
        white = [0.5 * s / max(n, 1.0) for n, s in zip(pair_counts, step_squares, strict=True)]
        return counts, spreads, [max(s - 1.6 * w, 0.0) for s, w in zip(spreads, white, strict=True)]


def fit_outline(
    grey: Floats, corners: Sequence[Point], reach_px: float, *, near: bool = False, settled_px: float = SETTLED_PX
) -> Outline | None:
    """Return the outline of a dark quadrilateral near corners, clockwise; None where there is none.

    `reach_px`: how far from its line each edge is looked at. It must be less than the ring of one colour on either
    side is wide. The first iteration takes the steepest place of each profile, the others the middle of its gradient;
    `near` leaves the first out: each edge is well within reach. An iteration that moves the lines by less than
    `settled_px` is the last one.
    """
    lengths = [math.dist(a, b) for a, b in _edges(corners)]
    if not 6.0 < min(lengths) <= max(lengths) < 2.0 * max(grey.shape):
        return None
    count = int(min(max(min(lengths), 10.0), _POINTS))
    if not near:
        first = _step(grey, corners, count, 1.4 * reach_px, capture=True)
        if first is None:
            return None
        corners = first[0]
    for k in range(_ITERATIONS):
        fitted = _step(grey, corners, count, reach_px, capture=False)
        if fitted is None:
            return None
        corners, crossing, lines = fitted
        step_px = lines.step_px()
        if step_px < settled_px or k == _ITERATIONS - 1:
            break
    inliers, spreads, bent = lines.scatter()
    return Outline(
        corners=list(corners),
        contrast=crossing.contrast,
        inliers=[n / count for n in inliers],
        std_px=[math.sqrt(s / max(n, 1.0)) for n, s in zip(inliers, spreads, strict=True)],
        noise_px=[math.sqrt((s - b) / max(n, 1.0)) for n, s, b in zip(inliers, spreads, bent, strict=True)],
        bent_px=math.sqrt(max(bent)),
        widths_px=crossing.widths_px,
        step_px=step_px,
        settled=step_px < 1.5 * settled_px,
    )


def _edges(corners: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Return where each edge begins and ends."""
    a, b, c, d = corners
    return [(a, b), (b, c), (c, d), (d, a)]


@lru_cache(maxsize=256)
def _places(count: int, reach_quarter_px: int) -> tuple[Floats, Floats, Floats]:
    """Return places (3, count * across): 1, part of the edge, px across; weights (4, across); middles between places.

    The weights turn a profile into sums over its gradient g(s), seen through a window w: w g, s w g, (w + s w') g and
    s^2 w g. The window sees a part of a step only, because the tails of a blurred edge leave it: when the edge moves,
    the middle of w g moves by the fraction sum((w + s w') g) / sum(w g) of that.
    """
    reach_px = 0.25 * reach_quarter_px
    across = np.linspace(-reach_px, reach_px, 2 * math.ceil(reach_px / max(0.5, reach_px / 8.0)) + 1)
    middle = 0.5 * (across[1:] + across[:-1])
    k = 0.5 * math.pi / (reach_px + 0.5)
    window = np.cos(k * middle) ** 2
    slope_window = window - k * middle * np.sin(2.0 * k * middle)
    of_gradient = np.stack([window, middle * window, slope_window, middle**2 * window])
    weights = -np.diff(np.pad(of_gradient, ((0, 0), (1, 1))), axis=1)
    along, far = (v.ravel() for v in np.meshgrid(_powers(count)[:, 1] + 0.5, across, indexing="ij"))
    places = np.stack([np.ones_like(along), along, far])
    return places.astype(np.float32), weights.astype(np.float32), middle.astype(np.float32)


@lru_cache(maxsize=64)
def _powers(count: int) -> Floats:
    """Return powers 0 to 2 (count, 3) of the places of the profiles on an edge, which go from -0.5 to 0.5."""
    t = np.linspace(_INSET - 0.5, 0.5 - _INSET, count)
    return np.stack([np.ones_like(t), t, t * t], axis=1).astype(np.float32)


def _step(
    grey: Floats, corners: Sequence[Point], count: int, reach_px: float, *, capture: bool
) -> tuple[list[Point], _Crossing, _Lines] | None:
    """Move each edge onto the line that fits the profiles across it."""
    xs, ys = [], []
    for (ax, ay), (bx, by) in _edges(corners):
        dx, dy = bx - ax, by - ay
        length = math.hypot(dx, dy)
        if length < 5.0:
            return None
        xs.append((ax, dx, dy / length))
        ys.append((ay, dy, -dx / length))
    crossing = _cross(grey, np.array(xs + ys, np.float32), count, reach_px, capture=capture)
    if crossing is None:
        return None
    lines = _lines(count, crossing)
    moved = []
    for (ax, dx, nx), (ay, dy, ny), (offset, slope) in zip(xs, ys, lines.coefficients, strict=True):
        begin = offset - 0.5 * slope
        moved.append((ax + begin * nx, ay + begin * ny, dx + slope * nx, dy + slope * ny))
    found = _intersections(moved)
    return None if found is None else (found, crossing, lines)


def _cross(grey: Floats, edges: Floats, count: int, reach_px: float, *, capture: bool) -> _Crossing | None:
    """Measure profiles across edges (8, 3): x of the beginning, side and normal of each, then y."""
    places, weights, middle = _places(count, round(4.0 * reach_px))
    x, y = (edges @ places).reshape(2, 4 * count, -1)
    profiles = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    sums = (weights @ profiles.T).reshape(4, 4, count)
    if capture:
        gradient = (profiles[:, 1:] - profiles[:, :-1]).reshape(4, count, middle.size)
        smooth = gradient[:, :, 1:-1] + 0.5 * (gradient[:, :, 2:] + gradient[:, :, :-2])
        rise = smooth.max(axis=2)
        offsets = middle[1:-1][smooth.argmax(axis=2)]
    else:
        rise = sums[0]
    middle_rise = upper_median(rise)
    contrast = middle_rise.tolist()
    if min(contrast) < _MIN_STEP:
        return None
    whole, _, seen, wide = np.add.reduce(sums, axis=2).tolist()
    if not capture:
        part = [max(s, 0.3 * w, 1e-6) / count for s, w in zip(seen, whole, strict=True)]
        offsets = sums[1] / np.array(part, np.float32)[:, None]
    good = np.abs(rise / middle_rise[:, None] - 1.0) < 0.5
    widths = [math.sqrt(max(s, 0.0) / max(w, 1e-6)) for s, w in zip(wide, whole, strict=True)]
    return _Crossing(offsets, good, contrast, widths)


def _lines(count: int, crossing: _Crossing) -> _Lines:
    """Fit offsets = offset + slope t to each edge by least squares, without outliers."""
    offsets, powers = crossing.offsets, _powers(count)
    deviation = np.abs(offsets - upper_median(offsets)[:, None])
    good = crossing.good & (deviation < np.maximum(4.0 * upper_median(deviation), 2.0 * _OUTLIER_PX)[:, None])
    for _ in range(3):
        weight = good.astype(np.float32)
        sums, weighted = (weight @ powers).tolist(), ((weight * offsets) @ powers).tolist()
        coefficients = []
        for (n, st, stt), (s, t, _) in zip(sums, weighted, strict=True):
            slope = (n * t - st * s) / max(n * stt - st * st, 1e-9)
            coefficients.append(((s - slope * st) / max(n, 1e-9), slope))
        residual = offsets - np.array(coefficients, np.float32) @ powers[:, :2].T
        size = np.abs(residual)
        inliers = size < np.maximum(4.5 * upper_median(size), _OUTLIER_PX)[:, None]
        if not np.count_nonzero(inliers != good):
            break
        good = inliers
    return _Lines(coefficients, weight, residual)


def _intersections(lines: Sequence[tuple[float, float, float, float]]) -> list[Point] | None:
    """Return where each line (a point and a direction) meets the one before it; None when two are parallel."""
    found = []
    for (px, py, ux, uy), (qx, qy, vx, vy) in zip([lines[-1], *lines], lines, strict=False):
        cross = ux * vy - uy * vx
        if abs(cross) < 1e-6:
            return None
        k = ((qx - px) * vy - (qy - py) * vx) / cross
        found.append((px + k * ux, py + k * uy))
    return found


def middle_of(corners: Sequence[Point]) -> Point:
    """Return where the diagonals of a quadrilateral meet: the picture of the square's middle, also in perspective."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    ux, uy, vx, vy = cx - ax, cy - ay, dx - bx, dy - by
    k = ((bx - ax) * vy - (by - ay) * vx) / (ux * vy - uy * vx)
    return ax + k * ux, ay + k * uy


def heading_of(corners: Sequence[Point]) -> float:
    """Return the direction of the marker's x axis (from corner 0 to corner 1), mean of the four edges, in rad."""
    a, b, c, d = corners
    x = (b[0] - a[0]) + (c[0] - d[0]) + (c[1] - b[1]) + (d[1] - a[1])
    y = (b[1] - a[1]) + (c[1] - d[1]) - (c[0] - b[0]) - (d[0] - a[0])
    return math.atan2(y, x)
