"""The outline of a square marker to a hundredth of a pixel: a straight line through the gradient of each edge.

`cornerSubPix` looks at corners, which blur rounds off, and is half a pixel wrong under motion blur; a line through a
whole edge is moved by no blur that is the same to both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEP_PX = 0.5
_INSET = 0.1
"""This part of an edge at either end is left out: blur bends it around the corner."""
_MIN_STEP = 8.0
"""Grey levels across an edge below which it is none."""
_OUTLIER_PX = 0.2
_ITERATIONS = 7
_SETTLED_PX = 0.04
"""The window hides the tails of a blurred edge: what is left after an iteration is a part of its step."""


@dataclass(frozen=True)
class Outline:
    """Four fitted edges. Edge i goes from corner i to corner i + 1.

    corners: (4, 2), px, clockwise. contrast: grey levels across each edge. inliers: part of the points of each edge
    that lie on its line. std_px: of each edge's line, from the scatter of its points. width_px: of the blurred edge,
    standard deviation. step_px: how far the last iteration moved the lines.
    """

    corners: Floats
    contrast: Floats
    inliers: Floats
    std_px: Floats
    width_px: float
    step_px: float


def fit_outline(grey: NDArray[np.float32], corners: Floats, reach_px: float) -> Outline | None:
    """Return the outline of a dark quadrilateral near corners (4, 2), clockwise; None where there is none.

    `reach_px`: how far from its line each edge is looked at. It must be less than the ring of one colour on either
    side is wide. The first iteration takes the steepest place of each profile, the others the middle of its gradient.
    """
    sides = np.roll(corners, -1, axis=0) - corners
    shortest = float(np.hypot(sides[:, 0], sides[:, 1]).min())
    if not shortest > 6.0 or shortest > 2.0 * max(grey.shape):
        return None
    count = int(min(max(shortest, 10.0), 64.0))
    along = np.linspace(_INSET, 1.0 - _INSET, count)
    outline = _fit(grey, corners, along, 1.5 * reach_px, capture=True)
    for _ in range(_ITERATIONS):
        if outline is None:
            return None
        outline = _fit(grey, outline.corners, along, reach_px, capture=False)
        if outline is not None and outline.step_px < _SETTLED_PX:
            break
    return outline


def _fit(grey: NDArray[np.float32], corners: Floats, along: Floats, reach_px: float, *, capture: bool) -> Outline | None:
    """Measure profiles across the edges and move each edge onto the line that fits them."""
    ends = np.roll(corners, -1, axis=0)
    sides = ends - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    if lengths.min() < 5.0:
        return None
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / lengths[:, None]
    steps = math.ceil(reach_px / _STEP_PX)
    across = _STEP_PX * np.arange(-steps, steps + 1)
    points = corners[:, None, :] + along[:, None] * sides[:, None, :]
    where = (points[:, :, None, :] + across[:, None] * normals[:, None, None, :]).astype(np.float32)
    flat = where.reshape(4 * along.size, across.size, 2)
    profiles = cv2.remap(grey, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    gradient = np.diff(profiles.reshape(4, along.size, across.size), axis=2)
    middle = 0.5 * (across[1:] + across[:-1])
    window = np.cos(0.5 * math.pi * middle / (reach_px + _STEP_PX)) ** 2
    if capture:
        smooth = gradient[:, :, 1:-1] + 0.5 * (gradient[:, :, 2:] + gradient[:, :, :-2])
        rise = smooth.max(axis=2)
        offsets = middle[1:-1][smooth.argmax(axis=2)]
    else:
        rise = (gradient * window).sum(axis=2)
    contrast = np.median(rise, axis=1)
    if contrast.min() < _MIN_STEP:
        return None
    if not capture:
        offsets = (gradient * window) @ middle / contrast[:, None]
    good = np.abs(rise - contrast[:, None]) < 0.5 * contrast[:, None]
    offset, slope, good, spread = _lines(along - 0.5, offsets, good)
    mean_profile = (gradient * window * good[:, :, None]).sum(axis=(0, 1))
    width = mean_profile @ (middle**2) / max(float(mean_profile.sum()), 1e-6)
    count = np.maximum(good.sum(axis=1), 1)
    moved = _intersections(
        corners + (offset - 0.5 * slope)[:, None] * normals, ends + (offset + 0.5 * slope)[:, None] * normals
    )
    if moved is None:
        return None
    return Outline(
        corners=moved,
        contrast=contrast,
        inliers=good.mean(axis=1),
        std_px=spread / np.sqrt(count),
        width_px=math.sqrt(max(float(width), 0.0)),
        step_px=float(np.abs(offset).max()),
    )


def _lines(t: Floats, offsets: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats, NDArray[np.bool_], Floats]:
    """Fit offsets = offset + slope t to each row, without outliers; return also the inliers and their scatter."""
    deviation = np.abs(offsets - np.median(offsets, axis=1)[:, None])
    good = good & (deviation < np.maximum(4.0 * np.median(deviation, axis=1)[:, None], 2.0 * _OUTLIER_PX))
    for _ in range(2):
        offset, slope = _least_squares(t, offsets, good)
        residual = offsets - offset[:, None] - slope[:, None] * t
        typical = 1.4826 * np.median(np.abs(residual), axis=1)[:, None]
        good = np.abs(residual) < np.maximum(3.0 * typical, _OUTLIER_PX)
    offset, slope = _least_squares(t, offsets, good)
    residual = np.where(good, offsets - offset[:, None] - slope[:, None] * t, 0.0)
    spread = np.sqrt((residual**2).sum(axis=1) / np.maximum(good.sum(axis=1) - 2, 1))
    return offset, slope, good, spread


def _least_squares(t: Floats, offsets: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    w = good.astype(float)
    n = np.maximum(w.sum(axis=1), 1e-9)
    t_mean, mean = w @ t / n, (w * offsets).sum(axis=1) / n
    spread = w @ t**2 / n - t_mean**2
    slope = ((w * offsets) @ t / n - t_mean * mean) / np.maximum(spread, 1e-6)
    return mean - slope * t_mean, slope


def _intersections(starts: Floats, ends: Floats) -> Floats | None:
    """Return where each line meets the one before it, (4, 2); None when two are parallel."""
    d = ends - starts
    before, p = np.roll(d, 1, axis=0), np.roll(starts, 1, axis=0)
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
