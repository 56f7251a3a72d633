"""Vehicles by coloured patches: one (thesis Algorithm 3.2) or two, told apart by their pairs of colours."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from camera_tracker.config import CameraTrackerConfig, Rectangle, Vehicle
from camera_tracker.detectors import colour as c
from camera_tracker.detectors.base import GOOD_QUALITY, Detection, Detector, Prediction, Region, one_of_several
from camera_tracker.sources import Image

_REDUCTION = 4
"""A search looks at every fourth px of every fourth row, for large patches (`_LARGE_PX2`) at every eighth."""
_LARGE_PX2 = 400.0
_SMALL_PX = 160
_COARSE_WIDTH_PX, _FINE_WIDTH_PX = 640, 1280
_FINE_EVERY = 10
"""When vehicles are missing, the first search and each tenth one look at every second px as well: patches of 5 px."""
_MAX_LOOKS = 3
"""How many places are examined for one vehicle in one picture."""
_MAX_BLOBS = 12


class PatchDetector(Detector):
    """Vehicles by one or two coloured patches. No patch serves two vehicles in one search."""

    def __init__(self, config: CameraTrackerConfig, vehicles: Sequence[Vehicle]) -> None:
        self.names = tuple(vehicle.name for vehicle in vehicles)
        self._vehicles = {vehicle.name: vehicle for vehicle in vehicles}
        self._config = config
        self._allowed: c.Mask | None = None
        self._misses = 0

    def look(self, image: Image, name: str, region: Region, prediction: Prediction) -> Detection | None:
        """Return the pose of a vehicle whose patches lie in a region, the best and nearest to the prediction.

        Two patches are looked for where each of them is predicted, and only if they are not there in the whole region.
        """
        extent_px = prediction.last.extent_px

        def cost(pose: Detection) -> float:
            return pose.misfit + math.hypot(pose.x_px - prediction.x_px, pose.y_px - prediction.y_px) / extent_px

        vehicle, poses = self._vehicles[name], []
        if places := prediction.moved(prediction.last.patches_px):
            half_px = 0.5 * (max(region.x1 - region.x0, region.y1 - region.y0) - math.dist(*places))
            poses = self._poses(image, vehicle, *(Region.around(x, y, half_px, image) for x, y in places))
        return min(poses or self._poses(image, vehicle, region, region), key=cost, default=None)

    def search(self, image: Image, names: Iterable[str]) -> dict[str, Detection]:
        """Return the vehicles found from the whole picture at 1/8 or 1/4; doubtful where two places fit alike."""
        wanted = set(names)
        large = {n for n in wanted if (self._vehicles[n].area_px2 or 0.0) >= _LARGE_PX2}
        found = self._search(image, large, 2) if large else {}
        if rest := wanted - set(found):
            found.update(self._search(image, rest, 1))
        if rest := wanted - set(found):
            if self._misses % _FINE_EVERY == 0:
                found.update(self._search(image, rest, 0))
            self._misses += 1
        else:
            self._misses = 0
        return found

    def _search(self, image: Image, names: set[str], times: int) -> dict[str, Detection]:
        """Search the picture reduced so many times more; 0: less."""
        found: dict[str, Detection] = {}
        used: set[c.Blob] = set()
        looks: dict[str, int] = {}
        for guess in sorted(self._guesses(image, names, times), key=lambda guess: guess.misfit):
            name = guess.vehicle.name
            twice = name in found and guess.vehicle.spacing_px is not None
            if (name in found and not twice) or looks.get(name) == _MAX_LOOKS or not used.isdisjoint(guess.blobs):
                continue
            looks[name] = looks.get(name, 0) + 1
            regions = (Region.around(blob.x_px, blob.y_px, guess.reach_px, image) for blob in guess.blobs)
            pose = min(self._poses(image, guess.vehicle, *regions), key=lambda pose: pose.misfit, default=None)
            if pose is None:
                continue
            if twice:
                if pose.quality >= GOOD_QUALITY:
                    found[name] = one_of_several(found[name])
                continue
            found[name] = pose
            used.update(guess.blobs)
        return found

    def _poses(self, image: Image, vehicle: Vehicle, for_front: Region, for_rear: Region) -> list[Detection]:
        """Return every pose that the patches in the regions allow."""
        assert vehicle.front is not None
        heading_rad = math.radians(vehicle.heading_deg)
        fronts = self._patches(image, for_front, vehicle.front)
        if vehicle.rear is None:
            return [
                c.pose_of_patch(p, area_px2=vehicle.area_px2, heading_rad=heading_rad, plain=vehicle.plain)
                for p in fronts
            ]
        rears = self._patches(image, for_rear, vehicle.rear) if fronts else []
        pairs = [
            c.pose_of_pair(
                f,
                r,
                spacing_px=vehicle.spacing_px,
                area_px2=vehicle.area_px2,
                heading_rad=heading_rad,
                plain=vehicle.plain,
            )
            for f in fronts
            for r in rears
        ]
        return [pair for pair in pairs if pair is not None]

    def _patches(self, image: Image, region: Region, name: str) -> list[c.Patch]:
        colour, min_area = self._config.colours[name], self._config.min_area_px2
        return c.find_patches(image, region, colour, min_area, self._mask(image))

    def _mask(self, image: Image) -> c.Mask | None:
        """Return what of the picture may be looked at; None: all."""
        if self._config.ignore and (self._allowed is None or self._allowed.shape != image.shape[:2]):
            self._allowed = mask_without(self._config.ignore, image)
        return self._allowed

    def _guesses(self, image: Image, names: set[str], times: int) -> list[_Guess]:
        """Return where vehicles may be."""
        small, step = _reduced(image, times)
        allowed = self._mask(image)
        if allowed is not None:
            allowed = np.asarray(cv2.resize(allowed, small.shape[1::-1], interpolation=cv2.INTER_NEAREST), np.uint8)
        blobs: dict[str, list[c.Blob]] = {}
        guesses: list[_Guess] = []
        for vehicle in (v for n, v in self._vehicles.items() if n in names):
            for name in {vehicle.front, vehicle.rear} - {None, *blobs}:
                mask = c.colour_mask(small, self._config.colours[str(name)])
                if allowed is not None:
                    mask = np.asarray(cv2.bitwise_and(mask, allowed), np.uint8)
                blobs[str(name)] = _blobs(mask, step, 0.5 * self._config.min_area_px2)
            guesses += _combine(vehicle, blobs[str(vehicle.front)], blobs.get(vehicle.rear or ""), step)
        return guesses


class _Guess(NamedTuple):
    """A place where a vehicle may be, in px of the full picture."""

    vehicle: Vehicle
    blobs: tuple[c.Blob, c.Blob]
    """Front and rear; of one patch twice the same."""
    reach_px: float
    """How far around each blob its patch may be."""
    misfit: float


def mask_without(ignore: Sequence[Rectangle], image: Image) -> c.Mask:
    """Return 255 for each px of a picture but those in rectangles, which get 0."""
    allowed = np.full(image.shape[:2], 255, np.uint8)
    for r in ignore:
        allowed[r.y : r.y + r.height, r.x : r.x + r.width] = 0
    return allowed


def _reduced(image: Image, times: int) -> tuple[Image, int]:
    """Return a picture at 1/4 size (a small one as it is, a huge one smaller) or less, and by how much it was reduced.

    One px of sixteen, or with times = 2 of 64: enough for patches, and most of the cost is that of reading the picture
    from memory.
    """
    height, width = image.shape[:2]
    if min(height, width) < _SMALL_PX:
        return image, 1
    step = times * max(_REDUCTION, round(width / _COARSE_WIDTH_PX)) or max(2, round(width / _FINE_WIDTH_PX))
    taken = image[step // 2 : height // step * step : step, : width // step * step]
    size = (width // step, len(taken))
    if step % 4 == 0 and taken[0].flags.c_contiguous and taken.shape[1] * 3 % 4 == 0:
        # In words of four bytes, which OpenCV picks four times faster than px of three: 4 px are 3 words.
        words = taken.reshape(len(taken), -1).view(np.int32)
        picked = cv2.resize(words, size, interpolation=cv2.INTER_NEAREST).view(np.uint8)
        small = cv2.cvtColor(picked.reshape(size[1], size[0], 4), cv2.COLOR_BGRA2BGR)
    else:
        small = cv2.resize(taken, size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(small, np.uint8), step


def _blobs(mask: c.Mask, step: int, min_area_px2: float) -> list[c.Blob]:
    """Return the largest pieces of a mask of the reduced picture, in px of the whole one."""
    part = c.occupied(mask)
    if part is None:
        return []
    enough = max(2.0, min_area_px2 / step**2)  # mixed pixels at the edge do not count
    return [
        blob._replace(
            x_px=step * (blob.x_px + part.x0),
            y_px=step * (blob.y_px + part.y0) + step // 2,
            area_px2=step**2 * blob.area_px2,
        )
        for blob in c.find_blobs(part.of(mask), enough)[0][:_MAX_BLOBS]
    ]


def _combine(vehicle: Vehicle, fronts: list[c.Blob], rears: list[c.Blob] | None, step: int) -> list[_Guess]:
    guesses = []
    for front in fronts:
        for rear in [front] if rears is None else rears:
            distance = math.hypot(front.x_px - rear.x_px, front.y_px - rear.y_px)
            size = 0.5 * (math.sqrt(front.area_px2) + math.sqrt(rear.area_px2)) + step
            misfit = 0.0 if rears is None else c.spacing_error(distance, vehicle.spacing_px, size)
            if misfit is not None:
                guesses.append(_Guess(vehicle, (front, rear), 1.5 * size + 4.0, misfit))
    return guesses
