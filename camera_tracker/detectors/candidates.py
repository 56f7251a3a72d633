"""Where square markers may be: the dark four-cornered shapes of a picture, cheaply and roughly."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_MIN_SIDE_PX = 7
"""Smallest side of a candidate in the reduced picture."""
_MAX_CANDIDATES = 150
_BLOCK_PX, _BELOW, _DEPTH = 25, 8, 16
"""Adaptive threshold: darker than the mean of a block by so many grey levels, and somewhere by so many."""
_EDGE_PX = 1.5
"""A candidate is darker so far inside its edges than so far outside, at two thirds of the places looked at."""


def dark_quadrilaterals(grey: NDArray[np.uint8]) -> list[Floats]:
    """Return the corners (4, 2), clockwise, of the dark four-cornered shapes in a picture, largest first."""
    if min(grey.shape) < _MIN_SIDE_PX:
        return []
    smooth = cv2.blur(grey, (3, 3), borderType=cv2.BORDER_REPLICATE)  # else noise alone makes thousands of pieces
    depth = cv2.subtract(cv2.blur(grey, (_BLOCK_PX, _BLOCK_PX), borderType=cv2.BORDER_REPLICATE), smooth)
    _, dark = cv2.threshold(depth, _BELOW, 1, cv2.THRESH_BINARY)
    contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    long_enough = sorted((c for c in contours if len(c) >= 4 * (_MIN_SIDE_PX - 1)), key=len, reverse=True)
    found = []
    for contour in long_enough[:_MAX_CANDIDATES]:
        x, y, w, h = cv2.boundingRect(contour)
        if min(w, h) < _MIN_SIDE_PX or max(w, h) >= 5 * min(w, h) or depth[y : y + h, x : x + w].max() < _DEPTH:
            continue
        corners = _quadrilateral(contour)
        if corners is not None:
            found.append(corners)
    return _dark_inside(np.asarray(smooth, np.uint8), found)


def _dark_inside(grey: NDArray[np.uint8], found: list[Floats]) -> list[Floats]:
    """Return those quadrilaterals that are darker just inside their edges than just outside, on most of them."""
    if not found:
        return found
    corners = np.stack(found)[:, :, None, :]
    after = np.roll(corners, -1, axis=1)
    middle = corners.mean(axis=1, keepdims=True)
    at = corners + np.array([0.2, 0.5, 0.8])[:, None] * (after - corners) - middle
    far = np.maximum(np.hypot(at[..., :1], at[..., 1:]), 1e-6)

    def level(out_px: float) -> NDArray[np.int16]:
        places = (middle + at * (1.0 + out_px / far)).reshape(len(found), 12, 2).astype(np.float32)
        x, y = np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])
        return cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.int16)

    steps = (level(_EDGE_PX) - level(-_EDGE_PX) > _BELOW).sum(axis=1)
    return [one for one, count in zip(found, steps.tolist(), strict=True) if count >= 8]


def _quadrilateral(contour: NDArray[Any]) -> Floats | None:
    """Return the corners of a contour whose hull is a quadrilateral, half a px outside its outermost px centres."""
    hull = cv2.convexHull(contour, clockwise=True)
    length, area = cv2.arcLength(hull, True), cv2.contourArea(hull)
    for tolerance in (0.04, 0.07, 0.1):
        corners = cv2.approxPolyDP(hull, tolerance * length, True)
        if len(corners) == 4 and cv2.contourArea(corners) > 0.75 * area > 10.0:
            q = corners[:, 0].astype(np.float64)
            if _area(q) < 0:
                q = q[::-1]
            middle = q.mean(axis=0)
            out = q - middle
            return np.asarray(q + 0.7 * out / np.maximum(np.hypot(out[:, 0], out[:, 1]), 1e-6)[:, None])
    return None


def _area(corners: Floats) -> float:
    """Return the area inside corners, positive when they go clockwise in the picture."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners.tolist()
    return 0.5 * float((cx - ax) * (dy - by) - (cy - ay) * (dx - bx))
