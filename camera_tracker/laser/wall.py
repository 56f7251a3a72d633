"""A wall with two laser dots as the forward camera sees it: stands in for pictures, with the truth known."""

from __future__ import annotations

import cv2
import numpy as np

from camera_tracker.laser.ranging import LaserModule
from camera_tracker.sources import Image, as_image

_WALL_BGR = (96.0, 104.0, 92.0)
_HALO_PX = 3.0
_CORE_PX = 1.2
_REACH_PX = 15
"""Beyond it a dot adds less than one grey level."""
_MARGIN_PX = 64
"""The noise reaches so far beyond the picture: each picture takes a cut at a random place."""


class WallCamera:
    """Draws pictures (height, width, 3) of a wall: uneven light, saturated dots, noise of so many grey levels.

    The dots are where the module's curves say. Light and noise are made once: a picture takes about 1 ms.
    """

    def __init__(
        self, module: LaserModule, size_px: tuple[int, int] = (640, 480), seed: int = 0, noise_std: float = 6.0
    ) -> None:
        self._module = module
        self._random = random = np.random.default_rng(seed)
        self._width, self._height = width, height = size_px
        y, x = np.mgrid[0:height, 0:width].astype(np.float64)
        light = 1.0 + 0.3 * np.sin(x / width * 3.0 + random.uniform(0, 6)) * np.cos(y / height * 2.0)
        self._wall = light[:, :, None] * np.array(_WALL_BGR) * 0.9
        self._ground = self._wall.astype(np.uint8)
        noise = np.rint(
            noise_std * random.standard_normal((height + 2 * _MARGIN_PX, width + 2 * _MARGIN_PX, 3), np.float32)
        )
        self._more, self._less = (np.clip(part, 0, 255).astype(np.uint8) for part in (noise, -noise))

    def picture(self, distance_m: float, angle_rad: float = 0.0, shown: tuple[bool, bool] = (True, True)) -> Image:
        """Return the next picture; shown: whether the left and the right dot are there.

        Raises ValueError when one that is there would be out of the picture.
        """
        module, image = self._module, self._ground.copy()
        middle = 0.5 * (self._width - 1) if module.centre_x_px is None else module.centre_x_px
        left_m, right_m = module.lengths_m(distance_m, angle_rad)
        row = 0.55 * self._height + self._random.uniform(-5, 5)
        if shown[0]:
            self._draw(image, middle - module.left.x_px(left_m), row)
        if shown[1]:
            self._draw(image, middle + module.right.x_px(right_m), row)
        left, top = self._random.integers(0, 2 * _MARGIN_PX, 2)
        cut = np.s_[top : top + self._height, left : left + self._width]
        cv2.add(image, self._more[cut], dst=image)
        cv2.subtract(image, self._less[cut], dst=image)
        return as_image(image)

    def _draw(self, image: Image, x_px: float, y_px: float) -> None:
        """Add a dot: coloured, white in its middle."""
        if not 0.0 <= x_px < self._width:
            raise ValueError("a wall so near or so oblique: a dot is out of the picture")
        left, top = max(0, round(x_px) - _REACH_PX), max(0, round(y_px) - _REACH_PX)
        box = np.s_[top : round(y_px) + _REACH_PX + 1, left : round(x_px) + _REACH_PX + 1]
        part = self._wall[box].copy()
        y, x = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
        squared = (x - x_px) ** 2 + (y - y_px) ** 2
        part[:, :, 2 if self._module.colour == "red" else 1] += 220.0 * np.exp(-0.5 * squared / _HALO_PX**2)
        part += (300.0 * np.exp(-0.5 * squared / _CORE_PX**2))[:, :, None]
        image[box] = np.clip(part, 0, 255)


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
    """Return one picture of a wall, see `WallCamera`; raise ValueError when a dot would be out of it."""
    return WallCamera(module, size_px, seed, noise_std).picture(distance_m, angle_rad, shown)
