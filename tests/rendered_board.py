"""Pictures of a printed sheet as a camera with a known lens sees it, for tests of calibration."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.calibration import Array, Lens
from camera_tracker.sources import Image

LENS = Lens.of(
    (800, 600), np.array([620.0, 624.0, 405.0, 296.0, -0.22, 0.06, 0.0008, -0.0006, 0.0]), np.zeros((9, 9)), 0.0
)


def sheet_picture(pdf: Path, px_per_mm: float) -> Image:
    """Paint the rectangles of a PDF of ours."""
    text = pdf.read_bytes().decode("latin-1")
    box = re.search(r"MediaBox \[0 0 (\S+) (\S+)\]", text)
    assert box is not None
    width, height = (float(v) for v in box.groups())
    k = 25.4 / 72.0 * px_per_mm
    picture = np.full((round(height * k), round(width * k), 3), 255, np.uint8)
    for numbers in re.findall(r"(\S+) (\S+) (\S+) (\S+) re", text):
        x, y, w, h = (float(v) for v in numbers)
        # Neighbours meet at the same px also where an edge falls in the middle of one.
        top, bottom, left, right = (round(v * k - 0.01) for v in (height - y - h, height - y, x, x + w))
        picture[top:bottom, left:right] = 0
    return picture


@lru_cache(maxsize=4)
def _rays(lens: Lens) -> Array:
    """Return the rays of four points of each px, (4 n, 3): edges become as smooth as in a camera."""
    y, x = np.mgrid[0 : 2 * lens.height_px, 0 : 2 * lens.width_px] * 0.5 - 0.25
    flat = lens.undistorted(np.stack([x.ravel(), y.ravel()], axis=1))
    return np.hstack([flat, np.ones((len(flat), 1))])


def seen_flat(plan: Image, px_per_m: float, pose: Array, lens: Lens, *, noise_std: float = 4.0, seed: int = 0) -> Image:
    """Return a plane with a picture on it (upper left at the origin) as seen through a lens from a pose (6,)."""
    rotation = np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)
    homography = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], pose[3:]]))
    at = homography @ _rays(lens).T
    shape = (2, 2 * lens.height_px, 2 * lens.width_px)
    places: NDArray[np.float32] = (at[:2] / at[2] * px_per_m - 0.5).astype(np.float32).reshape(shape)
    fine = cv2.remap(plan, places[0], places[1], cv2.INTER_LINEAR, borderValue=(200, 200, 200))
    small = cv2.resize(fine, (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA).astype(np.float64)
    noisy = 0.7 * small + 30.0 + np.random.default_rng(seed).normal(0.0, noise_std, small.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def looking(rotation_rad: tuple[float, float, float], centre_m: tuple[float, float], distance_m: float) -> Array:
    """Return the pose (6,) of a plane that is turned and has a point of it straight ahead at a distance."""
    rotation = np.array(rotation_rad)
    matrix = np.asarray(cv2.Rodrigues(rotation)[0], np.float64)
    return np.concatenate([rotation, np.array([0.0, 0.0, distance_m]) - matrix @ (*centre_m, 0.0)])
