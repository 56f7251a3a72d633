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

Floats = NDArray[np.float64]

_INSET = 0.1
"""This part of an edge at either end is left out: blur bends it around the corner."""
_POINTS = 40
_MIN_STEP = 8.0
"""Grey levels across an edge below which it is none."""
_OUTLIER_PX = 0.2
_ITERATIONS = 5
_SETTLED_PX = 0.05
_NEXT, _LAST = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


@dataclass(frozen=True)
class Outline:
    """Four fitted edges. Edge i goes from corner i to corner i + 1.

    corners: (4, 2), px, clockwise. contrast: grey levels across each edge. inliers: part of the points of each edge
    that lie on its line. std_px: of each edge's line, from the scatter of its points. bent_px: the part of that scatter
    that is no noise, because neighbours have it in common: largest of the edges. width_px: of the blurred edge,
    standard deviation. step_px: how far the last iteration moved the lines.
    """

    corners: Floats
    contrast: Floats
    inliers: Floats
    std_px: Floats
    bent_px: float
    width_px: float
    step_px: float


def fit_outline(grey: NDArray[np.float32], corners: Floats, reach_px: float) -> Outline | None:
    """Return the outline of a dark quadrilateral near corners (4, 2), clockwise; None where there is none.

    `reach_px`: how far from its line each edge is looked at. It must be less than the ring of one colour on either
    side is wide. The first iteration takes the steepest place of each profile, the others the middle of its gradient.
    """
    sides = corners[_NEXT] - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if not 6.0 < lengths.min() <= lengths.max() < 2.0 * max(grey.shape):
        return None
    along = _along(int(min(max(lengths.min(), 10.0), _POINTS)))
    outline = _fit(grey, corners, along, 1.4 * reach_px, capture=True)
    for _ in range(_ITERATIONS):
        if outline is None:
            return None
        outline = _fit(grey, outline.corners, along, reach_px, capture=False)
        if outline is not None and outline.step_px < _SETTLED_PX:
            break
    return outline


@lru_cache(maxsize=64)
def _along(count: int) -> Floats:
    return np.linspace(_INSET, 1.0 - _INSET, count)


@lru_cache(maxsize=256)
def _across(reach_quarter_px: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Return places across an edge, the middles between them, the window over those, and its slope's weight.

    The window sees a part of a step only, because the tails of a blurred edge leave it: with gradient g(s) the middle
    of w g moves by the fraction sum((w + s w') g) / sum(w g) of the step.
    """
    reach_px = 0.25 * reach_quarter_px
    across = np.linspace(-reach_px, reach_px, 2 * math.ceil(reach_px / max(0.5, reach_px / 8.0)) + 1)
    middle = 0.5 * (across[1:] + across[:-1])
    k = 0.5 * math.pi / (reach_px + 0.5)
    window = np.cos(k * middle) ** 2
    return across, middle, window, window - k * middle * np.sin(2.0 * k * middle)


def _fit(
    grey: NDArray[np.float32], corners: Floats, along: Floats, reach_px: float, *, capture: bool
) -> Outline | None:
    """Measure profiles across the edges and move each edge onto the line that fits them."""
    ends = corners[_NEXT]
    sides = ends - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if lengths.min() < 5.0:
        return None
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / lengths[:, None]
    across, middle, window, slope_window = _across(round(4.0 * reach_px))
    points = corners[:, None, :] + along[:, None] * sides[:, None, :]
    where = (points[:, :, None, :] + across[:, None] * normals[:, None, None, :]).astype(np.float32)
    flat = where.reshape(4 * along.size, across.size, 2)
    profiles = cv2.remap(grey, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    gradient = (profiles[:, 1:] - profiles[:, :-1]).reshape(4, along.size, middle.size)
    if capture:
        smooth = gradient[:, :, 1:-1] + 0.5 * (gradient[:, :, 2:] + gradient[:, :, :-2])
        rise = smooth.max(axis=2)
        offsets = middle[1:-1][smooth.argmax(axis=2)]
    else:
        rise = gradient @ window
    contrast = _median(rise)
    if contrast.min() < _MIN_STEP:
        return None
    if not capture:
        mean = gradient.mean(axis=1)
        seen = np.maximum(mean @ slope_window, 0.3 * (mean @ window))
        offsets = gradient @ (window * middle) / np.maximum(seen, 1e-6)[:, None]
    good = np.abs(rise - contrast[:, None]) < 0.5 * contrast[:, None]
    offset, slope, good, (spread, bent) = _lines(along - 0.5, offsets, good)
    profile = gradient.sum(axis=(0, 1)) * window
    width = float(profile @ middle**2) / max(float(profile.sum()), 1e-6)
    moved = _intersections(
        corners + (offset - 0.5 * slope)[:, None] * normals, ends + (offset + 0.5 * slope)[:, None] * normals
    )
    if moved is None:
        return None
    count = good.sum(axis=1)
    return Outline(
        corners=moved,
        contrast=contrast,
        inliers=count / along.size,
        std_px=np.sqrt(spread / np.maximum(count, 1)),
        bent_px=float(np.sqrt(bent.max())),
        width_px=math.sqrt(max(width, 0.0)),
        step_px=float((np.abs(offset) + 0.5 * np.abs(slope)).max()),
    )


def _median(rows: Floats) -> Floats:
    """Return the median of each row (the upper one of two), at a fifth of numpy.median's cost."""
    middle = rows.shape[1] // 2
    return np.asarray(np.partition(rows, middle, axis=1)[:, middle])


def _lines(t: Floats, offsets: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats, NDArray[np.bool_], Floats]:
    """Fit offsets = offset + slope t to each row, without outliers; return also the inliers and their scatter.

    The scatter (2, rows) is the variance of the residuals, and what of it steps between neighbours do not explain.
    """
    deviation = np.abs(offsets - _median(offsets)[:, None])
    good = good & (deviation < np.maximum(4.0 * _median(deviation), 2.0 * _OUTLIER_PX)[:, None])
    for _ in range(2):
        offset, slope = _least_squares(t, offsets, good)
        residual = np.abs(offsets - offset[:, None] - slope[:, None] * t)
        good = residual < np.maximum(4.5 * _median(residual), _OUTLIER_PX)[:, None]
    offset, slope = _least_squares(t, offsets, good)
    residual = (offsets - offset[:, None] - slope[:, None] * t) * good
    spread = (residual**2).sum(axis=1) / np.maximum(good.sum(axis=1) - 2, 1)
    pairs = good[:, 1:] & good[:, :-1]
    steps = (((residual[:, 1:] - residual[:, :-1]) * pairs) ** 2).sum(axis=1)
    white = 0.5 * steps / np.maximum(pairs.sum(axis=1), 1)
    return offset, slope, good, np.stack([spread, np.maximum(spread - 1.6 * white, 0.0)])


def _least_squares(t: Floats, offsets: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    w = good.astype(float)
    basis = np.stack([np.ones_like(t), t, t * t], axis=1)
    sums = w @ basis
    weighted = (w * offsets) @ basis[:, :2]
    n, st, stt = sums[:, 0], sums[:, 1], sums[:, 2]
    determinant = np.maximum(n * stt - st * st, 1e-9)
    slope = (n * weighted[:, 1] - st * weighted[:, 0]) / determinant
    return (weighted[:, 0] - slope * st) / np.maximum(n, 1e-9), slope


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
