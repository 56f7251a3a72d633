"""The outline of a square marker to a hundredth of a pixel: a straight line through the gradient of each edge.

`cornerSubPix` looks at corners, which blur rounds off, and is half a pixel wrong under motion blur; a line through a
whole edge is moved by no blur that is the same to both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.detectors.base import upper_median

Floats = NDArray[np.float64]

_INSET = 0.1
"""This part of an edge at either end is left out: blur bends it around the corner."""
_POINTS = 40
_MIN_STEP = 8.0
"""Grey levels across an edge below which it is none."""
_OUTLIER_PX = 0.2
_ITERATIONS = 5
_SETTLED_PX = 0.1
_NEXT, _LAST = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


@dataclass(frozen=True)
class Outline:
    """Four fitted edges. Edge i goes from corner i to corner i + 1.

    corners: (4, 2), px, clockwise. contrast: grey levels across each edge. inliers: part of the points of each edge
    that lie on its line. std_px: of each edge's line, from the scatter of its points. bent_px: the part of that scatter
    that is no noise, because neighbours have it in common: largest of the edges. widths_px: of each blurred edge,
    standard deviation. step_px: how far the last iteration moved the lines.
    """

    corners: Floats
    contrast: Floats
    inliers: Floats
    std_px: Floats
    bent_px: float
    widths_px: Floats
    step_px: float


@dataclass(frozen=True)
class _Crossing:
    """Profiles across four edges. offsets (4, n): of the edge from the line, px. good: those that show a step."""

    offsets: Floats
    good: NDArray[np.bool_]
    contrast: Floats
    widths_px: Floats


@dataclass(frozen=True)
class _Line:
    """offsets = offset + slope t of each of four edges, and which points it goes through."""

    offset: Floats
    slope: Floats
    good: NDArray[np.bool_]
    residual: Floats

    def step_px(self) -> float:
        return float((np.abs(self.offset) + 0.5 * np.abs(self.slope)).max())

    def scatter(self) -> tuple[Floats, Floats]:
        """Return the variance of each edge's inliers, and what of it steps between neighbours do not explain."""
        inliers = self.residual * self.good
        spread = np.einsum("ij,ij->i", inliers, inliers) / np.maximum(self.good.sum(axis=1) - 2, 1)
        pairs = self.good[:, 1:] & self.good[:, :-1]
        steps = (inliers[:, 1:] - inliers[:, :-1]) * pairs
        white = 0.5 * np.einsum("ij,ij->i", steps, steps) / np.maximum(pairs.sum(axis=1), 1)
        return spread, np.maximum(spread - 1.6 * white, 0.0)


def fit_outline(grey: NDArray[np.float32], corners: Floats, reach_px: float, *, near: bool = False) -> Outline | None:
    """Return the outline of a dark quadrilateral near corners (4, 2), clockwise; None where there is none.

    `reach_px`: how far from its line each edge is looked at. It must be less than the ring of one colour on either
    side is wide. The first iteration takes the steepest place of each profile, the others the middle of its gradient;
    `near` leaves the first out: each edge is well within reach.
    """
    sides = corners[_NEXT] - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if not 6.0 < lengths.min() <= lengths.max() < 2.0 * max(grey.shape):
        return None
    count = int(min(max(lengths.min(), 10.0), _POINTS))
    if not near:
        first = _step(grey, corners, count, 1.4 * reach_px, capture=True)
        if first is None:
            return None
        corners = first[0]
    for k in range(_ITERATIONS):
        fitted = _step(grey, corners, count, reach_px, capture=False)
        if fitted is None:
            return None
        corners, crossing, line = fitted
        step_px = line.step_px()
        if step_px < _SETTLED_PX or k == _ITERATIONS - 1:
            break
    inliers = line.good.sum(axis=1)
    spread, bent = line.scatter()
    return Outline(
        corners=corners,
        contrast=crossing.contrast,
        inliers=inliers / count,
        std_px=np.sqrt(spread / np.maximum(inliers, 1)),
        bent_px=math.sqrt(float(bent.max())),
        widths_px=crossing.widths_px,
        step_px=step_px,
    )


@lru_cache(maxsize=256)
def _places(count: int, reach_quarter_px: int) -> tuple[NDArray[np.float32], NDArray[np.float32], Floats]:
    """Return places (3, count * across): 1, part of the edge, px across; weights (across, 4); middles between places.

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
    of_gradient = np.stack([window, middle * window, slope_window, middle**2 * window], axis=1)
    weights = -np.diff(np.pad(of_gradient, ((1, 1), (0, 0))), axis=0)
    along, far = (v.ravel() for v in np.meshgrid(_along(count) + 0.5, across, indexing="ij"))
    return np.stack([np.ones_like(along), along, far]).astype(np.float32), weights.astype(np.float32), middle


@lru_cache(maxsize=64)
def _along(count: int) -> Floats:
    """Return the places of the profiles on an edge, -0.5 to 0.5."""
    return np.linspace(_INSET - 0.5, 0.5 - _INSET, count)


@lru_cache(maxsize=64)
def _powers(count: int) -> NDArray[np.float32]:
    t = _along(count)
    return np.stack([np.ones_like(t), t, t * t], axis=1).astype(np.float32)


def _step(
    grey: NDArray[np.float32], corners: Floats, count: int, reach_px: float, *, capture: bool
) -> tuple[Floats, _Crossing, _Line] | None:
    """Move each edge onto the line that fits the profiles across it."""
    ends = corners[_NEXT]
    sides = ends - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if lengths.min() < 5.0:
        return None
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / lengths[:, None]
    crossing = _cross(grey, np.stack([corners, sides, normals]).astype(np.float32), count, reach_px, capture=capture)
    if crossing is None:
        return None
    line = _lines(count, crossing)
    begin, end = (line.offset - 0.5 * line.slope)[:, None], (line.offset + 0.5 * line.slope)[:, None]
    moved = _intersections(corners + begin * normals, ends + end * normals)
    return None if moved is None else (moved, crossing, line)


def _cross(
    grey: NDArray[np.float32], edges: NDArray[np.float32], count: int, reach_px: float, *, capture: bool
) -> _Crossing | None:
    """Measure profiles across edges (3, 4, 2): their beginnings, sides and normals."""
    places, weights, middle = _places(count, round(4.0 * reach_px))
    x, y = (edges[:, :, k].T @ places for k in (0, 1))
    shape = (4 * count, middle.size + 1)
    profiles = cv2.remap(grey, x.reshape(shape), y.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    sums = (profiles @ weights).reshape(4, count, 4)
    if capture:
        gradient = (profiles[:, 1:] - profiles[:, :-1]).reshape(4, count, middle.size)
        smooth = gradient[:, :, 1:-1] + 0.5 * (gradient[:, :, 2:] + gradient[:, :, :-2])
        rise = smooth.max(axis=2)
        offsets = middle[1:-1][smooth.argmax(axis=2)].astype(np.float32)
    else:
        rise = np.ascontiguousarray(sums[:, :, 0])
    contrast = upper_median(rise)
    if contrast.min() < _MIN_STEP:
        return None
    whole = sums.sum(axis=1)
    if not capture:
        seen = np.maximum(np.maximum(whole[:, 2], 0.3 * whole[:, 0]) / count, 1e-6)
        offsets = sums[:, :, 1] / seen[:, None]
    good = np.abs(rise - contrast[:, None]) < 0.5 * contrast[:, None]
    widths = np.sqrt(np.maximum(whole[:, 3], 0.0) / np.maximum(whole[:, 0], 1e-6)).astype(np.float64)
    return _Crossing(np.asarray(offsets), good, np.asarray(contrast, np.float64), widths)


def _lines(count: int, crossing: _Crossing) -> _Line:
    """Fit offsets = offset + slope t to each edge, without outliers."""
    offsets, powers = crossing.offsets, _powers(count)
    deviation = np.abs(offsets - upper_median(offsets)[:, None])
    good = crossing.good & (deviation < np.maximum(4.0 * upper_median(deviation), 2.0 * _OUTLIER_PX)[:, None])
    for _ in range(3):
        line = _least_squares(offsets, good, powers)
        residual = np.abs(line.residual)
        inliers = residual < np.maximum(4.5 * upper_median(residual), _OUTLIER_PX)[:, None]
        if (inliers == good).all():
            break
        good = inliers
    return line


def _least_squares(offsets: Floats, good: NDArray[np.bool_], powers: NDArray[np.float32]) -> _Line:
    w = good.astype(np.float32)
    sums = w @ powers
    weighted = (w * offsets) @ powers[:, :2]
    n, st, stt = sums.T
    s, t = weighted.T
    slope = (n * t - st * s) / np.maximum(n * stt - st * st, 1e-9)
    offset = (s - slope * st) / np.maximum(n, 1e-9)
    residual = offsets - offset[:, None] - slope[:, None] * powers[:, 1]
    return _Line(offset.astype(np.float64), slope.astype(np.float64), good, residual)


def _intersections(starts: Floats, ends: Floats) -> Floats | None:
    """Return where each line meets the one before it, (4, 2); None when two are parallel."""
    d = ends - starts
    before, p = d[_LAST], starts[_LAST]
    cross = before[:, 0] * d[:, 1] - before[:, 1] * d[:, 0]
    if np.abs(cross).min() < 1e-6:
        return None
    delta = starts - p
    k = (delta[:, 0] * d[:, 1] - delta[:, 1] * d[:, 0]) / cross
    return np.asarray(p + k[:, None] * before)


def middle_of(corners: Floats) -> tuple[float, float]:
    """Return where the diagonals of a quadrilateral meet: the picture of the square's middle, also in perspective."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners.tolist()
    ux, uy, vx, vy = cx - ax, cy - ay, dx - bx, dy - by
    k = ((bx - ax) * vy - (by - ay) * vx) / (ux * vy - uy * vx)
    return ax + k * ux, ay + k * uy


def heading_of(corners: Floats) -> float:
    """Return the direction of the marker's x axis (from corner 0 to corner 1), mean of the four edges, in rad."""
    a, b, c, d = corners.tolist()
    x = (b[0] - a[0]) + (c[0] - d[0]) + (c[1] - b[1]) + (d[1] - a[1])
    y = (b[1] - a[1]) + (c[1] - d[1]) - (c[0] - b[0]) - (d[0] - a[0])
    return math.atan2(y, x)
