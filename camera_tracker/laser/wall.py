"""A wall with two laser dots as the forward camera sees it: stands in for pictures, with the truth known."""

from __future__ import annotations

import numpy as np

from camera_tracker.laser.ranging import LaserModule
from camera_tracker.sources import Image

_WALL_BGR = (96.0, 104.0, 92.0)
_HALO_PX = 3.0
_CORE_PX = 1.2


def wall_picture(
    module: LaserModule,
    distance_m: float,
    angle_rad: float = 0.0,
    *,
    size_px: tuple[int, int] = (640, 480),
    seed: int = 0,
    noise_std: float = 6.0,
    shown: tuple[bool, bool] = (True, True),
) -> Image:
    """Return a picture (height, width, 3) of a wall at a distance and angle: uneven light, noise, saturated dots.

    The dots are where the module's curves say. shown: whether the left and the right dot are there. Raises ValueError
    when a dot would be out of the picture.
    """
    width, height = size_px
    random = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    light = 1.0 + 0.3 * np.sin(x / width * 3.0 + random.uniform(0, 6)) * np.cos(y / height * 2.0)
    picture = light[:, :, None] * np.array(_WALL_BGR) * 0.9
    middle = 0.5 * (width - 1) if module.centre_x_px is None else module.centre_x_px
    left_m, right_m = module.lengths_m(distance_m, angle_rad)
    places = (middle - module.left.x_px(left_m), middle + module.right.x_px(right_m))
    row = 0.55 * height + random.uniform(-5, 5)
    channel = 2 if module.colour == "red" else 1
    for place, show in zip(places, shown, strict=True):
        if not 0.0 <= place < width:
            raise ValueError(f"a wall at {distance_m} m: a dot is out of the picture")
        if show:
            squared = (x - place) ** 2 + (y - row) ** 2
            picture[:, :, channel] += 220.0 * np.exp(-0.5 * squared / _HALO_PX**2)
            picture += (300.0 * np.exp(-0.5 * squared / _CORE_PX**2))[:, :, None]
    picture += random.normal(0.0, noise_std, picture.shape)
    return np.asarray(np.clip(picture, 0, 255), np.uint8)
