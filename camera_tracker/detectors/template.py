"""A square marker by its whole code: every edge of every module says where it lies, which noise can hide less.

Gauss-Newton, inverse compositional: Baker, Matthews, "Lucas-Kanade 20 years on", IJCV 56 (2004), section 3.2. What is
costly depends on the marker and its blur alone, and is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.detectors.base import Point

Floats = NDArray[np.float64]

_FINE = 16
"""Px per module of the picture that is blurred."""
_AROUND = 0.6
"""Modules of the white ring that are compared; further out the blur brings in what lies beyond it."""
_ITERATIONS = 8
_SETTLED = 1e-3
"""Of half the marker's side: the next iteration would move it by a tenth of that."""


def homography(corners: Sequence[Point]) -> Floats | None:
    """Return the (3, 3) matrix that takes the square -1..1 to corners in its order; None where three are in a line.

    Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989, section 2.2.3.
    """
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    sx, sy = ax - bx + cx - dx, ay - by + cy - dy
    cross = (bx - cx) * (dy - cy) - (dx - cx) * (by - cy)
    if abs(cross) < 1e-9:
        return None
    g, h = (sx * (dy - cy) - sy * (dx - cx)) / cross, (sy * (bx - cx) - sx * (by - cy)) / cross
    of_unit_square = (bx - ax + g * bx, dx - ax + h * dx, ax), (by - ay + g * by, dy - ay + h * dy, ay), (g, h, 1.0)
    return np.array([(0.5 * u, 0.5 * v, w + 0.5 * (u + v)) for u, v, w in of_unit_square])


def align(
    grey: NDArray[np.float32],
    corners: Sequence[Point],
    pattern: NDArray[np.bool_],
    density: int,
    blur_modules: tuple[float, float],
) -> list[Point] | None:
    """Return the corners where a marker fits best, from near ones; None when it does not settle.

    pattern: (modules, modules), true where white, with the white ring and the black border; its first corner is
    corners[0]. density: places compared per module, each way. blur_modules: standard deviations of the
    picture's blur along the marker's x and y.
    """
    places, solver = _model(pattern.tobytes(), len(pattern), density, *(round(10.0 * b) for b in blur_modules))
    h = homography(corners)
    if h is None:
        return None
    n = math.isqrt(places.shape[1])
    for _ in range(_ITERATIONS):
        points = h.astype(np.float32) @ places
        x, y = (points[:2] / points[2]).reshape(2, n, n)
        values = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        gain, _, *step = (solver @ values.ravel()).tolist()
        if gain <= 0:
            return None
        size = max(map(abs, step)) / gain
        h = h @ _back([s / gain for s in step])
        if size < _SETTLED:
            (a, b, c), (d, e, f), (g, k, i) = h.tolist()
            square = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            scaled = [(g * u + k * v + i, a * u + b * v + c, d * u + e * v + f) for u, v in square]
            return [(x / w, y / w) for w, x, y in scaled]
        if size > 0.3:
            return None
    return None


def _back(step: Sequence[float]) -> Floats:
    """Return the inverse of a homography, given by how its first eight numbers differ from 1 or 0, times a number."""
    a, b, c, d, e, f, g, k = step
    a, e = 1.0 + a, 1.0 + e
    return np.array(
        [
            (e - f * k, c * k - b, b * f - c * e),
            (f * g - d, a - c * g, c * d - a * f),
            (d * k - e * g, b * g - a * k, a * e - b * d),
        ]
    )


@lru_cache(maxsize=64)
def _model(
    pattern: bytes, modules: int, density: int, blur_x_tenths: int, blur_y_tenths: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the places compared (3, n * n) in half sides, and what turns grey levels there into ten numbers.

    These are contrast, black level, and contrast times the eight changes of the homography (less one) by which the
    template would have to be warped to look like the picture.
    """
    white = np.frombuffer(pattern, np.bool_).reshape(modules, modules).astype(np.float32)
    fine = np.kron(white, np.ones((_FINE, _FINE), np.float32))
    blur_x, blur_y = (max(0.1 * tenths, 0.05) * _FINE for tenths in (blur_x_tenths, blur_y_tenths))
    fine = np.asarray(cv2.GaussianBlur(fine, (0, 0), blur_x, sigmaY=blur_y), np.float32)
    half = 0.5 * (modules - 2)
    at = np.arange(-half - _AROUND, half + _AROUND, 1.0 / density)
    at -= at.mean()
    x, y = (v.astype(np.float32) for v in np.meshgrid(at, at))

    def seen(picture: NDArray[np.float32]) -> Floats:
        scale = np.float32(_FINE)
        middle = np.float32(0.5 * (modules * _FINE - 1))
        return np.asarray(cv2.remap(picture, x * scale + middle, y * scale + middle, cv2.INTER_LINEAR), float).ravel()

    down, right = np.gradient(fine, 1.0 / (_FINE * half))
    u, v = (p.ravel() / half for p in (x.astype(float), y.astype(float)))
    gu, gv, template = seen(right), seen(down), seen(fine)
    radial = -(gu * u + gv * v)
    columns = [template, np.ones_like(u), gu * u, gu * v, gu, gv * u, gv * v, gv, radial * u, radial * v]
    design = np.stack(columns)
    solver = np.linalg.solve(design @ design.T, design)
    return np.stack([u, v, np.ones_like(u)]).astype(np.float32), solver.astype(np.float32)
