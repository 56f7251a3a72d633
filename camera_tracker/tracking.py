"""Follow vehicles through pictures: a region at full resolution where each should be, else a search of the picture.

The idea of thesis Algorithm 3.1: the region comes from the predicted pose, the whole picture only when it is lost.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from camera_tracker.config import CameraTrackerConfig, Vehicle
from camera_tracker.detectors.base import AMBIGUOUS_QUALITY, Detection, Detector, Prediction, Region, doubtful
from camera_tracker.detectors.patches import PatchDetector
from camera_tracker.detectors.square import SquareDetector
from camera_tracker.sources import Image
from marine.frames import wrap_angle

_MARGIN_PX = 14.0
"""How much further than predicted a vehicle may be from one frame to the next: 0.09 m at 160 px/m, 2.6 m/s at 30 Hz."""
_HORIZON_S = 0.2
"""A prediction goes on for so long, then stands still."""
_FORGET_S = 1.0
"""After so long without a pose nothing is known of where a vehicle could be."""
_TRAVEL_EXTENTS = 0.5
"""A travel of this part of the marker's extent shows its direction."""


class _Track(NamedTuple):
    """The last pose of a vehicle and its velocity, to predict where to look."""

    pose: Detection
    stamp_ns: int
    vx_px_s: float = 0.0
    vy_px_s: float = 0.0
    turn_rad_s: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)
    """Where a travel began that may show which end is the front."""
    seen: bool = True
    """Whether it was in the last picture; otherwise the track only says where the vehicle was."""

    def predicted(self, stamp_ns: int) -> Prediction:
        dt = min(max((stamp_ns - self.stamp_ns) * 1e-9, 0.0), _HORIZON_S)
        p = self.pose
        psi_rad = wrap_angle(p.psi_rad + self.turn_rad_s * dt)
        return Prediction(p.x_px + self.vx_px_s * dt, p.y_px + self.vy_px_s * dt, psi_rad, p)


class Tracker:
    """Finds the configured vehicles in one picture after the other."""

    def __init__(self, config: CameraTrackerConfig) -> None:
        if not config.vehicles and config.every_marker_of is None:
            raise ValueError("no vehicles to track")
        self._config = config
        self._vehicles = {vehicle.name: vehicle for vehicle in config.vehicles}
        self._detectors = make_detectors(config)
        self._tracks: dict[str, _Track] = {}

    def track(self, image: Image, stamp_ns: int) -> dict[str, Detection]:
        """Return the vehicles found in a picture (BGR uint8), by name; `stamp_ns` is its capture time."""
        found: dict[str, Detection] = {}
        for detector in self._detectors:
            missing = []
            for name in detector.names:
                pose = self._look(detector, image, name, stamp_ns)
                if pose is None:
                    missing.append(name)
                else:
                    found[name] = pose
            if missing or not detector.names:
                found.update(detector.search(image, missing))
        found = {name: pose for name, pose in found.items() if not self._is_ignored(pose)}
        found = {name: self._judged(name, pose, stamp_ns) for name, pose in found.items()}
        self._follow(found, stamp_ns)
        return found

    def _look(self, detector: Detector, image: Image, name: str, stamp_ns: int) -> Detection | None:
        """Return a vehicle in the region where its track predicts it."""
        track = self._tracks.get(name)
        if track is None or not track.seen:
            return None
        prediction = track.predicted(stamp_ns)
        region = Region.around(prediction.x_px, prediction.y_px, track.pose.extent_px + _MARGIN_PX, image)
        pose = detector.look(image, name, region, prediction)
        return None if pose is None else pose._replace(region=region)

    def _is_ignored(self, pose: Detection) -> bool:
        """Tell whether a square marker lies where the configuration says not to look."""
        return bool(pose.corners_px) and any(
            r.x <= pose.x_px < r.x + r.width and r.y <= pose.y_px < r.y + r.height for r in self._config.ignore
        )

    def _judged(self, name: str, pose: Detection, stamp_ns: int) -> Detection:
        """Compare a pose with the track: resolve its heading, doubt what cannot be reached."""
        track = self._tracks.get(name)
        checks = [(pose.quality, pose.reason)]
        if track is not None:
            if pose.heading_ambiguous:
                pose = self._resolved(name, pose, track, stamp_ns)
            checks += _innovation(pose, track, stamp_ns, shape_only=self._has_one_patch(name))
        if pose.heading_ambiguous:
            checks.append((AMBIGUOUS_QUALITY, "the patch has no distinct front and back"))
        quality, reason = min(checks)
        return pose._replace(quality=quality, reason=reason)

    def _has_one_patch(self, name: str) -> bool:
        vehicle = self._vehicles.get(name)
        return vehicle is not None and vehicle.front is not None and vehicle.rear is None

    def _resolved(self, name: str, pose: Detection, track: _Track, stamp_ns: int) -> Detection:
        """Turn an ambiguous heading to the side of the last one; it is resolved if that was, or by travel ahead."""
        other = wrap_angle(pose.psi_rad + math.pi)
        reference = track.predicted(stamp_ns).psi_rad
        psi_rad = min((pose.psi_rad, other), key=lambda a: abs(wrap_angle(a - reference)))
        known = track.seen and not track.pose.heading_ambiguous and abs(wrap_angle(psi_rad - reference)) < 1.0
        vehicle = self._vehicles.get(name)
        if not known and vehicle is not None and vehicle.goes_ahead:
            dx, dy = pose.x_px - track.start[0], pose.y_px - track.start[1]
            if math.hypot(dx, dy) > _TRAVEL_EXTENTS * pose.extent_px:
                course = math.atan2(dy, dx) + math.radians(vehicle.heading_deg)
                psi_rad = min((pose.psi_rad, other), key=lambda a: abs(wrap_angle(a - course)))
                known = abs(wrap_angle(psi_rad - course)) < 0.7
        return pose._replace(psi_rad=psi_rad, heading_ambiguous=not known)

    def _follow(self, found: dict[str, Detection], stamp_ns: int) -> None:
        """Keep a track of each vehicle that was found; one that may be another's marker is searched for again."""
        tracks = {}
        for name, last in self._tracks.items():
            if name not in found and (stamp_ns - last.stamp_ns) * 1e-9 < _FORGET_S:
                tracks[name] = last._replace(seen=False)
        for name, pose in found.items():
            before = self._tracks.get(name)
            start = (pose.x_px, pose.y_px)
            if pose.several:
                continue
            if before is None or not before.seen or pose.region is None or stamp_ns <= before.stamp_ns:
                track = _Track(pose, stamp_ns, start=start)
            else:
                rate = 1e9 / (stamp_ns - before.stamp_ns)
                p = before.pose
                track = _Track(
                    pose,
                    stamp_ns,
                    (pose.x_px - p.x_px) * rate,
                    (pose.y_px - p.y_px) * rate,
                    0.0 if abs(turn := wrap_angle(pose.psi_rad - p.psi_rad)) > 1.0 else turn * rate,
                    before.start if pose.heading_ambiguous else start,
                )
            tracks[name] = track
        self._tracks = tracks


def _innovation(pose: Detection, track: _Track, stamp_ns: int, *, shape_only: bool) -> list[tuple[float, str]]:
    """Return what speaks against a pose because of the track before it.

    `shape_only`: front and back are known from the shape of one patch, which glare or a hand can turn around.
    """
    seconds = (stamp_ns - track.stamp_ns) * 1e-9
    if not 0.0 < seconds < _FORGET_S:
        return []
    predicted = track.predicted(stamp_ns)
    checks = []
    innovation_px = math.hypot(pose.x_px - predicted.x_px, pose.y_px - predicted.y_px)
    if innovation_px > _MARGIN_PX + track.pose.extent_px * (1.0 + 10.0 * seconds):
        checks.append(doubtful(f"jumped by {innovation_px:.0f} px"))
    turn_rad = abs(wrap_angle(pose.psi_rad - predicted.psi_rad))
    known = track.seen and not track.pose.heading_ambiguous and not pose.heading_ambiguous
    if shape_only and known and turn_rad > 1.0 + 10.0 * seconds:
        checks.append(doubtful(f"turned by {math.degrees(turn_rad):.0f} degrees"))
    return checks


def make_detectors(config: CameraTrackerConfig) -> list[Detector]:
    """Return the detectors that a configuration asks for."""
    detectors: list[Detector] = []
    if patches := [v for v in config.vehicles if v.front is not None]:
        detectors.append(PatchDetector(config, patches))
    for dictionary in dict.fromkeys(v.dictionary for v in config.vehicles if v.dictionary is not None):
        marked: list[Vehicle] = [v for v in config.vehicles if v.dictionary == dictionary]
        markers = {v.name: (v.marker or 0, math.radians(v.heading_deg)) for v in marked}
        detectors.append(SquareDetector(dictionary, markers))
    if config.every_marker_of is not None:
        detectors.append(SquareDetector(config.every_marker_of, {}))
    return detectors
