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
_ITERATIONS, _BENT_ITERATIONS = 8, 20
_SETTLED, _NEARLY_SETTLED = 1e-3, 5e-3
"""Of half the marker's side: the next iteration would move it by a tenth of that; the last one may be the other."""


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
    *,
    bent: bool = False,
) -> tuple[list[Point], Point] | None:
    """Return the corners and the middle where a marker fits best, from near corners; None when it does not settle.

    pattern: (modules, modules), true where white, with the white ring and the black border; its first corner is
    corners[0]. density: places compared per module, each way. blur_modules: standard deviations of the
    picture's blur along the marker's x and y. bent: by a lens, to second order (what the homography has not of that is
    one bend along u^2 and one along v^2): the middle is then not where the diagonals meet.
    """
    blur_tenths = round(10.0 * blur_modules[0]), round(10.0 * blur_modules[1])
    places, squares, solver = _model(pattern.tobytes(), len(pattern), density, blur_tenths, bent)
    h = homography(corners)
    if h is None:
        return None
    n = math.isqrt(places.shape[1])
    bend = np.zeros((3, 2), np.float32)
    iterations = _BENT_ITERATIONS if bent else _ITERATIONS
    for k in range(iterations):
        points = h.astype(np.float32) @ (places + bend @ squares if bent else places)
        x, y = (points[:2] / points[2]).reshape(2, n, n)
        values = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        gain, _, *step = (solver @ values.ravel()).tolist()
        if gain <= 0:
            return None
        size = max(map(abs, step)) / gain
        h = h @ _back([s / gain for s in step[:8]])
        if bent:
            bend[:2] -= np.reshape(step[8:], (2, 2)) / gain
        if size < (_SETTLED if k < iterations - 1 else _NEARLY_SETTLED):
            (a, b, c), (d, e, f), (g, p, i) = h.tolist()
            du, dv = bend[:2].sum(axis=1).tolist() if bent else (0.0, 0.0)
            square = [(u + du, v + dv) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))] + [(0.0, 0.0)]
            scaled = [(g * u + p * v + i, a * u + b * v + c, d * u + e * v + f) for u, v in square]
            *ends, middle = [(x / w, y / w) for w, x, y in scaled]
            return ends, middle
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
    pattern: bytes, modules: int, density: int, blur_tenths: tuple[int, int], bent: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return the places compared (3, n * n) in half sides, their squares, and what turns grey levels into ten numbers.

    These are contrast, black level, and contrast times the eight changes of the homography (less one) by which the
    template would have to be warped to look like the picture; bent: and the four of (u, v) with u^2 and v^2.
    """
    white = np.frombuffer(pattern, np.bool_).reshape(modules, modules).astype(np.float32)
    fine = np.kron(white, np.ones((_FINE, _FINE), np.float32))
    blur_x, blur_y = (max(0.1 * tenths, 0.05) * _FINE for tenths in blur_tenths)
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
    if bent:
        columns += [gu * u * u, gu * v * v, gv * u * u, gv * v * v]
    design = np.stack(columns)
    solver = np.linalg.solve(design @ design.T, design)
    places, squares = np.stack([u, v, np.ones_like(u)]), np.stack([u * u, v * v])
    return places.astype(np.float32), squares.astype(np.float32), solver.astype(np.float32)
