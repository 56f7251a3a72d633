"""The overhead camera as the simulator draws it: water, glare, the vessel with its marker, blur and noise.

Everything costly is made once: the water, the vessel at four times the resolution with the blur already in it, and the
noise as two tiles (what to add, what to subtract) of which each frame takes a cut at a random place. All but the vessel
can be drawn before the moment of the exposure (`Renderer.prepare`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker import marker
from camera_tracker.sources import Image
from marine.vessel import Vessel
from services.simulator.board import HeldBoard

_FINE = 4
"""Sprite px per picture px. Sampling the blurred sprite between its px then errs by less than 0.01 px."""
_MARGIN = 64
"""Water and noise reach this far beyond the picture, so that they can be shifted."""
_WATER_BGR = (122.0, 98.0, 42.0)
_HULL_BGR = (168.0, 166.0, 160.0)
_POD_BGR = (92.0, 84.0, 78.0)
_WHITE_BGR = (225.0, 225.0, 225.0)
_BLACK_BGR = (32.0, 32.0, 32.0)
_GLARES = 5

_Float = NDArray[np.float32]
_Box = tuple[slice, slice]
"""Rows and columns of a part of the picture."""
_WHOLE: _Box = (slice(None), slice(None))


@dataclass(frozen=True)
class SquareMarker:
    """A square marker on a white plate instead of the coloured patches, its x axis along the vessel's.

    dictionary: OpenCV's name without DICT_, such as 4x4_50. side_m: of its black square.
    """

    dictionary: str
    number: int
    side_m: float

    def picture(self) -> NDArray[np.uint8]:
        """Return one px per module, 0 or 255, (n, n): with the black border, and one white module around it."""
        kind = next(v for k, v in vars(cv2.aruco).items() if k.lower() == f"dict_{self.dictionary}")
        book = cv2.aruco.getPredefinedDictionary(kind)
        black = cv2.aruco.generateImageMarker(book, self.number, book.markerSize + 2)
        return np.asarray(np.pad(black, 1, constant_values=255), np.uint8)


@dataclass(frozen=True)
class Spot:
    """A reflection over everything: middle and radius (of half the brightness) in px, brightness in grey levels."""

    x_px: float
    y_px: float
    radius_px: float
    grey: float = 255.0


class Renderer:
    """Draws a vessel in its pool.

    noise_std: of each channel of each px, in grey levels. blur_px: standard deviation of the optics' blur. light: of 1.
    square: marker that the vessel carries instead of the coloured patches.
    Two renderers with the same arguments draw the same sequence.
    """

    def __init__(
        self,
        vessel: Vessel,
        seed: int = 0,
        noise_std: float = 6.0,
        blur_px: float = 1.0,
        *,
        light: float = 1.0,
        square: SquareMarker | None = None,
    ) -> None:
        self._camera = camera = vessel.camera
        self._light = light
        self._scale = camera.scale_px_per_m
        self._width, self._height = camera.width_px, camera.height_px
        self._random = np.random.default_rng(seed)
        self._own_image: Image = np.zeros((self._height, self._width, 3), np.uint8)
        self._image = self._own_image
        self._ground: Image = np.zeros_like(self._own_image)
        """The next frame without noise."""
        self._water = self._make_water()
        self._more, self._less = self._make_noise(noise_std)
        self._glare = _make_glare(radius_px=22)
        self._glare_paths = self._random.uniform(0.0, math.tau, (_GLARES, 4))
        radius_m = vessel.radius_m
        if square is not None:
            radius_m = max(radius_m, 0.5 * math.sqrt(2.0) * square.side_m * 1.4)
        self._reach_m = radius_m + 4.0 * blur_px / self._scale
        self._sprite = _make_sprite(vessel, self._reach_m, blur_px, square)
        self._frames = 0
        self._noise_at = (0, 0)
        self._ready_for: tuple[float, float] | None = None

    def render(
        self,
        x_m: float,
        y_m: float,
        psi_rad: float,
        *,
        shift_px: tuple[float, float] = (0.0, 0.0),
        black: bool = False,
        motion_px: tuple[float, float] = (0.0, 0.0),
        spots: Sequence[Spot] = (),
        board_at_s: float | None = None,
    ) -> Image:
        """Return the next frame (height, width, 3) BGR of a vessel at (x_m, y_m, psi_rad) in {E}.

        The buffer is used again by the next call. `shift_px`: how far everything is moved in the picture, as if the
        camera had been knocked (water at most 64 px); `black`: the lens is covered; `motion_px`: way of the vessel
        during the exposure, in whose middle it is at (x_m, y_m); `spots`: reflections over the vessel; `board_at_s`: a
        calibration board is before the lens, in the pose of that time.
        """
        if self._ready_for != shift_px:
            self.prepare(shift_px)
        image, self._ready_for = self._image, None
        if black:
            image[:] = 0
            return image
        at = (x_m * self._scale - 0.5 + shift_px[0], y_m * self._scale - 0.5 + shift_px[1])
        box = self._draw_vessel(*at, psi_rad, motion_px)
        if spots or board_at_s is not None or self._light != 1.0:
            box = _WHOLE
            for spot in spots:
                self._draw_spot(spot)
            if board_at_s is not None:
                self._board.draw(self._ground, board_at_s)
            if self._light != 1.0:
                np.copyto(self._ground, cv2.convertScaleAbs(self._ground, alpha=self._light))
        if box is not None:
            self._add_noise(box)
        return image

    def prepare(self, shift_px: tuple[float, float] = (0.0, 0.0), canvas: Image | None = None) -> None:
        """Draw all of the next frame but the vessel, ahead of time: `render` with this shift then draws only that.

        canvas: where the frame is drawn, instead of a buffer of our own.
        """
        self._image = self._own_image if canvas is None else canvas
        if self._ready_for is None:
            self._frames += 1
            cut_x, cut_y = (int(v) for v in self._random.integers(0, 2 * _MARGIN, 2))
            self._noise_at = cut_x, cut_y
        self._ready_for = shift_px
        left, top = (_MARGIN - round(min(max(v, -_MARGIN), _MARGIN)) for v in shift_px)
        np.copyto(self._ground, self._cut(self._water, left, top))
        self._draw_glare()
        self._add_noise(_WHOLE)

    def _add_noise(self, box: _Box) -> None:
        """Finish a part of the image: the ground with noise."""
        cv2.add(self._ground[box], self._cut(self._more, *self._noise_at)[box], dst=self._image[box])
        cv2.subtract(self._image[box], self._cut(self._less, *self._noise_at)[box], dst=self._image[box])

    @cached_property
    def _board(self) -> HeldBoard:
        return HeldBoard(self._camera)

    def _cut(self, tile: Image, left: int, top: int) -> Image:
        return tile[top : top + self._height, left : left + self._width]

    def _draw_glare(self) -> None:
        """Add reflections of lamps, which wander with the waves."""
        size = self._glare.shape[0]
        for a, b, c, d in self._glare_paths:
            time = 0.02 * self._frames
            x = (self._width - size) * (0.5 + 0.5 * math.sin(a + 0.1 * math.sin(b + time)))
            y = (self._height - size) * (0.5 + 0.5 * math.sin(c + 0.1 * math.sin(d + 1.3 * time)))
            spot = self._ground[int(y) : int(y) + size, int(x) : int(x) + size]
            cv2.add(spot, self._glare[: spot.shape[0], : spot.shape[1]], dst=spot)

    def _draw_spot(self, spot: Spot) -> None:
        """Add a reflection, a bell of light."""
        y, x = np.ogrid[: self._height, : self._width]
        far = ((x - spot.x_px) ** 2 + (y - spot.y_px) ** 2) / spot.radius_px**2
        light = (spot.grey * np.exp2(-np.minimum(far, 32.0))).astype(np.uint8)
        cv2.add(self._ground, cv2.merge([light, light, light]), dst=self._ground)

    def _draw_vessel(self, x_px: float, y_px: float, psi_rad: float, motion_px: tuple[float, float]) -> _Box | None:
        """Blend the sprite over the part of the ground that it covers, its origin at (x_px, y_px); return which."""
        way_px = math.hypot(*motion_px)
        reach = self._reach_m * self._scale + 1.0 + 0.5 * way_px
        x0, x1 = max(math.floor(x_px - reach), 0), min(math.ceil(x_px + reach) + 1, self._width)
        y0, y1 = max(math.floor(y_px - reach), 0), min(math.ceil(y_px + reach) + 1, self._height)
        if x0 >= x1 or y0 >= y1:
            return None
        moments = 2 * math.ceil(way_px) + 1
        sprite = np.zeros((y1 - y0, x1 - x0, 4), np.float32) if moments > 1 else None
        for k in range(moments):
            part_of_way = (k + 0.5) / moments - 0.5
            dx = x0 - x_px - part_of_way * motion_px[0]
            dy = y0 - y_px - part_of_way * motion_px[1]
            one = self._turned(dx, dy, psi_rad, (x1 - x0, y1 - y0))
            sprite = one if sprite is None else cv2.scaleAdd(one, 1.0 / moments, sprite)  # type: ignore[assignment]
        assert sprite is not None
        part = self._ground[y0:y1, x0:x1]
        seen_through = cv2.cvtColor(cv2.extractChannel(sprite, 3), cv2.COLOR_GRAY2BGR)
        below = cv2.multiply(part, seen_through, dtype=cv2.CV_32F)
        cv2.add(below, cv2.cvtColor(sprite, cv2.COLOR_BGRA2BGR), dst=part, dtype=cv2.CV_8U)
        return slice(y0, y1), slice(x0, x1)

    def _turned(self, dx: float, dy: float, psi_rad: float, size: tuple[int, int]) -> _Float:
        """Return the sprite turned by psi_rad, in a picture (width, height) that begins at (dx, dy) from its origin."""
        c, s = _FINE * math.cos(psi_rad), _FINE * math.sin(psi_rad)
        middle = 0.5 * (self._sprite.shape[0] - 1)
        picture_to_sprite = np.array([[c, s, middle + c * dx + s * dy], [-s, c, middle - s * dx + c * dy]])
        return cv2.warpAffine(  # type: ignore[return-value]
            self._sprite,
            picture_to_sprite,
            size,
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderValue=(0.0, 0.0, 0.0, 1.0),
        )

    def _make_water(self) -> Image:
        """Return water with waves of several lengths, larger than the picture by the margin."""
        shape = (self._height + 2 * _MARGIN, self._width + 2 * _MARGIN)
        light = np.zeros(shape, np.float32)
        for length_px, height in ((3.0, 3.0), (9.0, 5.0), (60.0, 9.0)):
            waves = self._random.standard_normal(shape, np.float32)
            waves = cv2.GaussianBlur(waves, (0, 0), length_px).astype(np.float32)
            light += height * waves / waves.std()
        colours = np.asarray(_WATER_BGR, np.float32) * (1.0 + 0.01 * light[..., None])
        return np.clip(colours, 0, 255).astype(np.uint8)

    def _make_noise(self, std: float) -> tuple[Image, Image]:
        shape = (self._height + 2 * _MARGIN, self._width + 2 * _MARGIN, 3)
        noise = np.rint(std * self._random.standard_normal(shape, np.float32))
        return np.clip(noise, 0, 255).astype(np.uint8), np.clip(-noise, 0, 255).astype(np.uint8)


def _make_glare(radius_px: int) -> Image:
    across = np.arange(-radius_px, radius_px + 1, dtype=np.float32) / (0.4 * radius_px)
    bell = np.exp(-0.5 * (across[:, None] ** 2 * 3.0 + across[None, :] ** 2))  # longer than high, as on waves
    return np.repeat((170.0 * bell)[..., None], 3, axis=2).astype(np.uint8)


def _make_sprite(vessel: Vessel, reach_m: float, blur_px: float, square: SquareMarker | None) -> _Float:
    """Return the vessel seen from above, x to the right: colours times cover, and 1 - cover as fourth channel."""
    fine_per_m = _FINE * vessel.camera.scale_px_per_m
    half = math.ceil(reach_m * fine_per_m)
    metres = np.arange(-half, half + 1, dtype=np.float32) / fine_per_m
    x, y = metres[None, :], metres[:, None]

    def cover(inside_m: _Float) -> _Float:
        """Return how much of each px is inside, from the distance to the edge: keeps centroids exact."""
        return np.asarray(np.clip(inside_m * fine_per_m + 0.5, 0.0, 1.0), np.float32)

    def disc(x_m: float, y_m: float, radius_m: float) -> _Float:
        return cover(np.asarray(radius_m - np.hypot(x - x_m, y - y_m), np.float32))

    def rectangle(x_m: float, length_m: float, width_m: float) -> _Float:
        return cover(0.5 * length_m - np.abs(x - x_m)) * cover(0.5 * width_m - np.abs(y))

    sprite = np.zeros((2 * half + 1, 2 * half + 1, 4), np.float32)
    sprite[..., 3] = 1.0
    x_patch = 0.5 * marker.SPACING_M
    length, width = marker.PATCH_LENGTH_M, marker.PATCH_WIDTH_M
    layers: list[tuple[_Float, tuple[float, ...]]] = [(disc(0.0, 0.0, vessel.radius_m), _HULL_BGR)]
    layers += [(disc(t.x_m, t.y_m, 0.15 * vessel.radius_m), _POD_BGR) for t in vessel.thrusters]
    if square is None:
        layers += [
            (rectangle(0.0, marker.PLATE_LENGTH_M, marker.PLATE_WIDTH_M), marker.PLATE_BGR),
            (rectangle(x_patch, length, width), marker.FRONT_BGR),
            (rectangle(-x_patch, length, width), marker.REAR_BGR),
        ]
    else:
        layers += _square_layers(square, fine_per_m, (2 * half + 1, 2 * half + 1))
    for part, colour in layers:
        sprite *= 1.0 - part[..., None]
        sprite[..., :3] += part[..., None] * np.asarray(colour, np.float32)
    if blur_px > 0:
        outside = (0.0, 0.0, 0.0, 1.0)
        padded = cv2.copyMakeBorder(sprite, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=outside)
        blurred = cv2.GaussianBlur(padded, (0, 0), blur_px * _FINE, borderType=cv2.BORDER_REPLICATE)
        return np.ascontiguousarray(blurred[1:-1, 1:-1], np.float32)
    return sprite


def _square_layers(
    square: SquareMarker, fine_per_m: float, shape: tuple[int, int]
) -> list[tuple[_Float, tuple[float, ...]]]:
    """Return white plate and black modules of a marker in the middle of a sprite, with exact cover at the edges."""
    picture = square.picture()
    modules = len(picture)
    fine = square.side_m * fine_per_m / (modules - 2)

    def cover(indices: _Float) -> _Float:
        """Return how much of each sprite px lies in each module, (modules, px)."""
        at = np.arange(shape[0]) - 0.5 * (shape[0] - 1)
        low = (indices - 0.5 * modules)[:, None] * fine
        overlap = np.minimum(at + 0.5, low + fine) - np.maximum(at - 0.5, low)
        return np.asarray(np.clip(overlap, 0.0, 1.0), np.float32)

    each = cover(np.arange(modules, dtype=np.float32))
    whole = each.sum(axis=0)
    dark = each.T @ (picture < 128).astype(np.float32) @ each
    return [
        (np.asarray(np.outer(whole, whole), np.float32), _WHITE_BGR),
        (np.asarray(dark, np.float32), _BLACK_BGR),
    ]
