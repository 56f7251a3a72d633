"""The camera tracker on the simulator's camera against OpenCV's ArUco and pupil-apriltags on the same pictures.

pupil-apriltags is measured where it is installed. Errors of place are RMS of the
distance in px; times are of one picture, one thread, for everything between the picture and the pose.
"""

from __future__ import annotations

import importlib
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.result import NotMeasured, Result, percentile
from camera_tracker.config import CameraTrackerConfig, Vehicle
from camera_tracker.detectors.base import GOOD_QUALITY
from camera_tracker.sources import Image
from camera_tracker.tracking import Tracker
from services.simulator.camera import Renderer, Spot, SquareMarker
from services.vessels import load_vessel

DICTIONARY, NUMBER = "apriltag_36h11", 7
SIZES = {"480p": (640, 480), "720p": (1280, 720), "1080p": (1920, 1080)}
PERIOD_NS = 33_333_333
_SCALE = 160.0

Pose = tuple[float, float, float]
"""x_px, y_px, psi_rad."""


class Picture(NamedTuple):
    image: Image
    truth: Pose
    stamp_ns: int


@dataclass
class Scene:
    """What is drawn: side 0 stands for the coloured patches; steps of the vessel make it move as it does at 30 Hz."""

    side_px: float
    size: tuple[int, int] = (800, 600)
    noise_std: float = 6.0
    blur_px: float = 1.0
    light: float = 1.0
    motion_px: float = 0.0
    spots: int = 0
    seed: int = 3

    def pictures(self, count: int) -> Iterator[Picture]:
        vessel = load_vessel("pladypos")
        width, height = self.size
        camera = replace(vessel.camera, width_px=width, height_px=height, scale_px_per_m=_SCALE)
        square = SquareMarker(DICTIONARY, NUMBER, self.side_px / _SCALE) if self.side_px else None
        renderer = Renderer(
            replace(vessel, camera=camera), self.seed, self.noise_std, self.blur_px, light=self.light, square=square
        )
        random = np.random.default_rng(self.seed)
        for k in range(count):
            x = 0.5 * width + 0.3 * width * math.sin(0.017 * k + self.seed)
            y = 0.5 * height + 0.3 * height * math.cos(0.013 * k)
            psi = math.remainder(0.05 * k + 0.3, math.tau)
            course = 0.4 * k
            motion = (self.motion_px * math.cos(course), self.motion_px * math.sin(course))
            spots = []
            for dx, dy, radius in random.uniform(-1.0, 1.0, (self.spots, 3)):
                spots.append(Spot(x + 35.0 * dx, y + 35.0 * dy, 5.0 + 3.0 * radius))
            image = renderer.render((x + 0.5) / _SCALE, (y + 0.5) / _SCALE, psi, motion_px=motion, spots=spots).copy()
            yield Picture(image, (x, y, psi), k * PERIOD_NS)


def config_of(scene: Scene) -> CameraTrackerConfig:
    """Return the tracker's configuration for a scene."""
    if scene.side_px:
        vehicle = Vehicle(name="v", dictionary=DICTIONARY, marker=NUMBER)
        return CameraTrackerConfig(vehicles=(vehicle,))
    return CameraTrackerConfig().with_default_marker("v", _SCALE)


@dataclass
class Measured:
    """Errors (px, degrees), times and how many pictures gave a good pose."""

    px: list[float] = field(default_factory=list)
    deg: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    pictures: int = 0

    def add(self, found: Pose | None, truth: Pose) -> None:
        self.pictures += 1
        if found is not None:
            self.px.append(math.hypot(found[0] - truth[0], found[1] - truth[1]))
            self.deg.append(abs(math.degrees(math.remainder(found[2] - truth[2], math.tau))))

    def rms(self) -> tuple[float, float]:
        if not self.px:
            raise NotMeasured("no picture gave a pose")
        return float(np.sqrt(np.mean(np.square(self.px)))), float(np.sqrt(np.mean(np.square(self.deg))))


def ours(scene: Scene, count: int, *, cold: bool = False) -> Measured:
    """Track a scene; cold: each picture with a tracker that has seen none. Only good poses count."""
    config = config_of(scene)
    tracker, measured = Tracker(config), Measured()
    for picture in scene.pictures(count):
        if cold:
            tracker = Tracker(config)
        begin_s = time.perf_counter()
        found = tracker.track(picture.image, picture.stamp_ns).get("v")
        measured.ms.append(1e3 * (time.perf_counter() - begin_s))
        good = found is not None and found.quality >= GOOD_QUALITY and not found.heading_ambiguous
        measured.add((found.x_px, found.y_px, found.psi_rad) if found is not None and good else None, picture.truth)
    return measured


Finder = Callable[[Any], "np.ndarray[Any, Any] | None"]


def opencv(refinement: int) -> Finder:
    """Return OpenCV's detector with one of its own refinements: grey picture -> corners (4, 2)."""
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    detector = cv2.aruco.ArucoDetector(book, parameters)

    def find(grey: Any) -> Any:
        corners, ids, _ = detector.detectMarkers(grey)
        return next(
            (c[0] for c, i in zip(corners, [] if ids is None else ids.ravel(), strict=True) if i == NUMBER), None
        )

    return find


def pupil() -> Finder | None:
    """Return pupil-apriltags as a detector, None where it is not installed. It counts px centres at + 0.5."""
    try:
        module = importlib.import_module("pupil_apriltags")
    except ImportError:
        return None
    detector = module.Detector(families="tag36h11", nthreads=1, quad_decimate=1.0)

    def find(grey: Any) -> Any:
        tag = next((tag for tag in detector.detect(grey) if tag.tag_id == NUMBER), None)
        return None if tag is None else np.asarray(tag.corners) - 0.5

    return find


def peer(find: Finder, scene: Scene, count: int) -> Measured:
    """Measure a detector that looks at whole pictures."""
    measured = Measured()
    for picture in scene.pictures(count):
        begin_s = time.perf_counter()
        corners = find(cv2.cvtColor(picture.image, cv2.COLOR_BGR2GRAY))
        measured.ms.append(1e3 * (time.perf_counter() - begin_s))
        measured.add(None if corners is None else pose_of(corners, picture.truth[2]), picture.truth)
    return measured


def pose_of(corners: Any, psi_rad: float) -> Pose:
    """Return the pose of a square by its corners, in whatever order they come: the quarter turn is the truth's."""
    from camera_tracker.detectors.edges import heading_of, middle_of

    c = np.asarray(corners, np.float64)
    x, y = c[:, 0], c[:, 1]
    if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:
        c = c[::-1]
    clockwise = [(x, y) for x, y in c.tolist()]
    heading = heading_of(clockwise)
    quarter = 0.5 * math.pi * round((psi_rad - heading) / (0.5 * math.pi))
    return (*middle_of(clockwise), heading + quarter)


def measure() -> list[Result]:
    """Return times, accuracy and what glare does, with the peers' figures on the same pictures."""
    cv2.setNumThreads(1)
    peers: dict[str, Finder] = {"opencv_subpix": opencv(cv2.aruco.CORNER_REFINE_SUBPIX)}
    if (tags := pupil()) is not None:
        peers["pupil_apriltags"] = tags
    else:
        print("pupil-apriltags: not installed, its column is missing", file=sys.stderr)
    return [*_times(peers), *_accuracy(peers), *_glare(peers)]


def _times(peers: dict[str, Finder]) -> list[Result]:
    results = []
    cold_goals = {("colour", "720p"): 0.6, ("colour", "1080p"): 1.1, ("square", "720p"): 3.5, ("square", "1080p"): 6.5}
    for kind, side in (("colour", 0.0), ("square", 60.0)):
        for size, shape in SIZES.items():
            scene = Scene(side, shape)
            warm, cold = ours(scene, 200), ours(scene, 40, cold=True)
            # The peers know no region: they search the whole picture each time.
            whole = {n: percentile(peer(find, scene, 30).ms, 50) for n, find in peers.items()} if side else {}
            results += [
                Result(f"track_{kind}_{size}_p50_ms", percentile(warm.ms[1:], 50), whole, goal=0.5),
                Result(f"track_{kind}_{size}_p99_ms", percentile(warm.ms[1:], 99), goal=1.5),
                Result(f"cold_{kind}_{size}_p50_ms", percentile(cold.ms, 50), whole, goal=cold_goals.get((kind, size))),
            ]
    return results


def _accuracy(peers: dict[str, Finder]) -> list[Result]:
    hard = {"light": 0.35, "noise_std": 12.0, "blur_px": 1.5, "motion_px": 6.0}
    scenes = {
        "colour": (Scene(0.0), 0.025, 0.03),
        "square": (Scene(60.0), 0.025, 0.03),
        "square_hard": (Scene(60.0, **hard), 0.10, 0.10),  # type: ignore[arg-type]
        "square_30px": (Scene(30.0), 0.04, 0.08),
    }
    results = []
    for name, (scene, goal_px, goal_deg) in scenes.items():
        mine = ours(scene, 300)
        others = {n: peer(find, scene, 100) for n, find in peers.items()} if scene.side_px else {}
        px, deg = mine.rms()
        results += [
            Result(f"{name}_rms_px", px, {n: other.rms()[0] for n, other in others.items()}, goal=goal_px),
            Result(f"{name}_rms_deg", deg, {n: other.rms()[1] for n, other in others.items()}, goal=goal_deg),
            Result(
                f"{name}_good_fraction",
                len(mine.px) / mine.pictures,
                {n: len(o.px) / o.pictures for n, o in others.items()},
            ),
        ]
    return results


def _glare(peers: dict[str, Finder]) -> list[Result]:
    """Three spots on and around the marker: the largest error of a pose that says it is good."""
    results = []
    for name, side in (("colour", 0.0), ("square", 60.0)):
        scene = Scene(side, spots=3)
        mine = ours(scene, 300)
        others = {n: peer(find, scene, 100) for n, find in peers.items()} if side else {}
        results += [
            Result(
                f"{name}_glare_max_px",
                percentile(mine.px, 100),
                {n: percentile(o.px, 100) for n, o in others.items()},
                goal=0.5,
            ),
            Result(
                f"{name}_glare_good_fraction",
                len(mine.px) / mine.pictures,
                {n: len(o.px) / o.pictures for n, o in others.items()},
            ),
        ]
    return results
