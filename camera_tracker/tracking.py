"""Follow vehicles through pictures: a region at full resolution where each should be, the whole picture at 1/4 else."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from camera_tracker.config import CameraTrackerConfig, Vehicle
from camera_tracker.detectors import colour as c
from camera_tracker.sources import Image

_REDUCTION = 4
_MARGIN_PX = 14.0
"""How much further than predicted a vehicle may be from one frame to the next: 0.09 m at 160 px/m, 2.6 m/s at 30 Hz."""
_SMALL_PX = 160
_MAX_LOOKS = 3
"""How many places are examined for one vehicle in one picture."""
_MAX_BLOBS = 12


@dataclass(frozen=True)
class _Track:
    """The last pose of a vehicle and its velocity, to predict where to look."""

    pose: c.Detection
    stamp_ns: int
    vx_px_s: float = 0.0
    vy_px_s: float = 0.0

    def predicted(self, stamp_ns: int) -> tuple[float, float]:
        seconds = min(max((stamp_ns - self.stamp_ns) * 1e-9, 0.0), 0.2)
        return self.pose.x_px + self.vx_px_s * seconds, self.pose.y_px + self.vy_px_s * seconds


class Tracker:
    """Finds the configured vehicles in one picture after the other."""

    def __init__(self, config: CameraTrackerConfig) -> None:
        if not config.vehicles:
            raise ValueError("no vehicles to track")
        self._config = config
        self._tracks: dict[str, _Track] = {}
        self._allowed: c.Mask | None = None

    def track(self, image: Image, stamp_ns: int) -> dict[str, c.Detection]:
        """Return the vehicles found in a picture (BGR uint8), by name; `stamp_ns` is its capture time."""
        if self._config.ignore and (self._allowed is None or self._allowed.shape != image.shape[:2]):
            self._allowed = self._mask_of_ignored(image)
        found: dict[str, c.Detection] = {}
        for vehicle in self._config.vehicles:
            track = self._tracks.get(vehicle.name)
            if track is not None:
                x_px, y_px = track.predicted(stamp_ns)
                pose = self._look_at(image, vehicle, x_px, y_px, track.pose.extent_px)
                if pose is not None:
                    found[vehicle.name] = pose
        if len(found) < len(self._config.vehicles):
            self._search(image, found)
        self._tracks = {name: self._followed(name, pose, stamp_ns) for name, pose in found.items()}
        return found

    def _mask_of_ignored(self, image: Image) -> c.Mask:
        allowed = np.full(image.shape[:2], 255, np.uint8)
        for r in self._config.ignore:
            allowed[r.y : r.y + r.height, r.x : r.x + r.width] = 0
        return allowed

    def _followed(self, name: str, pose: c.Detection, stamp_ns: int) -> _Track:
        last = self._tracks.get(name)
        if last is None or stamp_ns <= last.stamp_ns:
            return _Track(pose, stamp_ns)
        rate = 1e9 / (stamp_ns - last.stamp_ns)
        return _Track(pose, stamp_ns, (pose.x_px - last.pose.x_px) * rate, (pose.y_px - last.pose.y_px) * rate)

    def _look_at(
        self, image: Image, vehicle: Vehicle, x_px: float, y_px: float, extent_px: float
    ) -> c.Detection | None:
        """Return the best pose of a vehicle near a point, at full resolution."""
        region = c.Region.around(x_px, y_px, extent_px + _MARGIN_PX, image)
        poses = self._poses(image, region, vehicle)

        def cost(pose: c.Detection) -> float:
            return pose.misfit + math.hypot(pose.x_px - x_px, pose.y_px - y_px) / extent_px

        return min(poses, key=cost, default=None)

    def _poses(self, image: Image, region: c.Region, vehicle: Vehicle) -> list[c.Detection]:
        """Return every pose that the patches in a region allow."""
        heading_rad = math.radians(vehicle.heading_deg)
        fronts = self._patches(image, region, vehicle.front)
        if vehicle.rear is None:
            return [c.pose_of_patch(p, area_px2=vehicle.area_px2, heading_rad=heading_rad) for p in fronts]
        rears = self._patches(image, region, vehicle.rear) if fronts else []
        pairs = [
            c.pose_of_pair(f, r, spacing_px=vehicle.spacing_px, area_px2=vehicle.area_px2, heading_rad=heading_rad)
            for f in fronts
            for r in rears
        ]
        return [pair for pair in pairs if pair is not None]

    def _patches(self, image: Image, region: c.Region, name: str) -> list[c.Patch]:
        colour, min_area = self._config.colours[name], self._config.min_area_px2
        return c.find_patches(image, region, colour, min_area, self._allowed)

    def _search(self, image: Image, found: dict[str, c.Detection]) -> None:
        """Add the vehicles that are not in `found`, from the whole picture at 1/4; no patch serves two of them."""
        used: set[c.Blob] = set()
        looks = dict.fromkeys((v.name for v in self._config.vehicles), 0)
        for guess in sorted(self._guesses(image, found), key=lambda guess: guess.misfit):
            name = guess.vehicle.name
            if name in found or looks[name] == _MAX_LOOKS or not used.isdisjoint(guess.blobs):
                continue
            looks[name] += 1
            pose = self._look_at(image, guess.vehicle, guess.x_px, guess.y_px, guess.extent_px)
            if pose is not None:
                found[name] = pose
                used.update(guess.blobs)

    def _guesses(self, image: Image, found: dict[str, c.Detection]) -> list[_Guess]:
        """Return where the vehicles that are not in `found` may be."""
        small, factor = _reduced(image)
        allowed = None
        if self._allowed is not None:
            allowed = cv2.resize(self._allowed, small.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        blobs: dict[str, list[c.Blob]] = {}
        guesses: list[_Guess] = []
        for vehicle in self._config.vehicles:
            if vehicle.name in found:
                continue
            for name in {vehicle.front, vehicle.rear} - {None, *blobs}:
                mask = c.colour_mask(small, self._config.colours[str(name)])
                if allowed is not None:
                    mask = np.asarray(cv2.bitwise_and(mask, allowed), np.uint8)
                enough = max(2.0, 0.5 * self._config.min_area_px2 / factor**2)  # mixed pixels at the edge do not count
                blobs[str(name)] = c.find_blobs(mask, enough)[0][:_MAX_BLOBS]
            guesses += _combine(vehicle, blobs[vehicle.front], blobs.get(vehicle.rear or ""), factor)
        return guesses


@dataclass(frozen=True)
class _Guess:
    """A place where a vehicle may be, in px of the full picture."""

    vehicle: Vehicle
    blobs: tuple[c.Blob, ...]
    x_px: float
    y_px: float
    extent_px: float
    misfit: float


def _reduced(image: Image) -> tuple[Image, float]:
    """Return a picture at 1/4 size (a small one as it is) and by how much it was reduced."""
    height, width = image.shape[:2]
    if min(height, width) < _SMALL_PX:
        return image, 1.0
    size = (width // _REDUCTION, height // _REDUCTION)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8), width / size[0]


def _combine(vehicle: Vehicle, fronts: list[c.Blob], rears: list[c.Blob] | None, factor: float) -> list[_Guess]:
    guesses = []
    for front in fronts:
        for rear in [front] if rears is None else rears:
            distance = factor * math.hypot(front.x_px - rear.x_px, front.y_px - rear.y_px)
            size = factor * (0.5 * (math.sqrt(front.area_px2) + math.sqrt(rear.area_px2)) + 1.0)
            misfit = 0.0 if rears is None else c.spacing_error(distance, vehicle.spacing_px, size)
            if misfit is not None:
                x_px = factor * (0.5 * (front.x_px + rear.x_px) + 0.5) - 0.5
                y_px = factor * (0.5 * (front.y_px + rear.y_px) + 0.5) - 0.5
                guesses.append(_Guess(vehicle, (front, rear), x_px, y_px, 0.5 * distance + 1.5 * size, misfit))
    return guesses
