"""Square markers as the simulator's camera sees them: accuracy, several at once, and every dictionary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bus.config import ConfigError, parse
from camera_tracker.config import DICTIONARIES, CameraTrackerConfig, Vehicle
from camera_tracker.detectors.base import Detection
from camera_tracker.detectors.codes import load_code
from camera_tracker.detectors.edges import heading_of, middle_of
from camera_tracker.sources import Image
from camera_tracker.tracking import Tracker
from services.simulator.camera import Renderer, SquareMarker
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
SCALE = VESSEL.camera.scale_px_per_m


def renderer(side_px: float = 60.0, dictionary: str = "apriltag_36h11", number: int = 7, **more: float) -> Renderer:
    return Renderer(VESSEL, 3, square=SquareMarker(dictionary, number, side_px / SCALE), **more)


def marked(dictionary: str = "apriltag_36h11", number: int = 7, **more: object) -> CameraTrackerConfig:
    vehicle = Vehicle.model_validate({"name": "v", "dictionary": dictionary, "marker": number, **more})
    return CameraTrackerConfig(vehicles=(vehicle,))


def moving(camera: Renderer, config: CameraTrackerConfig, frames: int, motion_px: float = 0.0) -> np.ndarray:
    """Return the errors (px, degrees) of each good pose of a moving vessel."""
    tracker, errors = Tracker(config), []
    for k in range(frames):
        x_px, y_px, psi = 250.0 + 1.7 * k, 200.0 + 0.9 * k, math.remainder(0.06 * k - 2.0, math.tau)
        motion = (motion_px * math.cos(0.4 * k), motion_px * math.sin(0.4 * k))
        image = camera.render((x_px + 0.5) / SCALE, (y_px + 0.5) / SCALE, psi, motion_px=motion)
        found = tracker.track(image, k * 33_333_333).get("v")
        if found is not None and found.quality >= 0.5:
            turn = math.degrees(math.remainder(found.psi_rad - psi, math.tau))
            errors.append((math.hypot(found.x_px - x_px, found.y_px - y_px), turn))
    return np.asarray(errors)


def rms(errors: np.ndarray) -> list[float]:
    return [float(v) for v in np.sqrt(np.mean(np.square(errors), axis=0))]


@pytest.mark.parametrize(
    ("side_px", "goal_px", "goal_deg"),
    [(60.0, 0.025, 0.03), (30.0, 0.04, 0.12)],
)
def test_a_moving_marker_is_followed_to_a_few_hundredths_of_a_px(
    side_px: float, goal_px: float, goal_deg: float
) -> None:
    errors = moving(renderer(side_px), marked(), 120)
    assert len(errors) == 120
    px, deg = rms(errors)
    assert px < goal_px
    assert deg < goal_deg


def test_dark_noisy_and_blurred_by_motion() -> None:
    errors = moving(renderer(noise_std=12.0, blur_px=1.5, light=0.35), marked(), 120, motion_px=6.0)
    assert len(errors) > 100
    px, deg = rms(errors)
    assert px < 0.25
    assert deg < 0.25


@pytest.mark.parametrize("dictionary", ["4x4_50", "5x5_100", "7x7_250", "apriltag_16h5", "aruco_original"])
@pytest.mark.parametrize("psi", [-3.0, -1.2, 0.0, 0.8, 2.2])
def test_heading_is_the_marker_s_x_axis_in_every_turn(dictionary: str, psi: float) -> None:
    image = renderer(60.0, dictionary, 11, noise_std=0.0).render(2.0, 1.5, psi)
    found = Tracker(marked(dictionary, 11, heading_deg=90.0)).track(image, 0)["v"]
    assert math.remainder(found.psi_rad - psi - math.pi / 2, math.tau) == pytest.approx(0.0, abs=0.003)
    assert (found.x_px, found.y_px) == pytest.approx((2.0 * SCALE - 0.5, 1.5 * SCALE - 0.5), abs=0.05)
    assert found.quality > 0.9
    first, second = np.asarray(found.corners_px[:2])
    assert math.remainder(math.atan2(*(second - first)[::-1]) - psi, math.tau) == pytest.approx(0.0, abs=0.01)


def test_another_number_is_not_taken() -> None:
    assert Tracker(marked(number=8)).track(renderer().render(2.0, 1.5, 0.0), 0) == {}


def beside(left: Image, right: Image) -> Image:
    return np.concatenate([left[:, :400], right[:, 400:]], axis=1)


def test_several_vehicles_each_by_its_number_and_one_by_colours() -> None:
    left, right = renderer(number=1).render(1.2, 1.0, 0.5).copy(), renderer(number=2).render(3.5, 1.0, -1.0)
    patches = Renderer(VESSEL, 4).render(1.3, 2.8, 2.0)
    image = beside(left, right)
    image[350:, :400] = patches[350:, :400]
    default = CameraTrackerConfig().with_default_marker("c", SCALE)
    vehicles = tuple(Vehicle(name=f"m{i}", dictionary="apriltag_36h11", marker=i) for i in (1, 2))
    config = default.model_copy(update={"vehicles": (*default.vehicles, *vehicles)})
    tracker = Tracker(config)
    for k in range(2):  # by search, then in their regions
        found = tracker.track(image, k * 33_333_333)
        assert {name: round(pose.psi_rad, 1) for name, pose in found.items()} == {"c": 2.0, "m1": 0.5, "m2": -1.0}
        assert all((pose.region is not None) == (k == 1) for pose in found.values())


def test_every_marker_of_a_dictionary_is_named_by_its_number() -> None:
    image = beside(renderer(number=1).render(1.2, 1.0, 0.5).copy(), renderer(number=30).render(3.5, 1.0, -1.0))
    found = Tracker(CameraTrackerConfig(every_marker_of="apriltag_36h11")).track(image, 0)
    assert {name: round(pose.psi_rad, 1) for name, pose in found.items()} == {"1": 0.5, "30": -1.0}


def test_two_markers_of_the_same_kind_are_doubtful_until_one_is_left() -> None:
    one = renderer().render(1.2, 1.0, 0.5).copy()
    two = beside(one, renderer().render(3.5, 1.0, -1.0))
    tracker = Tracker(marked())
    for k in range(3):
        found = tracker.track(two, k * 33_333_333)["v"]
        assert found.quality <= 0.2
        assert "two markers of this kind" in found.reason
    alone = tracker.track(one, 99_999_999)["v"]
    assert alone.quality > 0.9


def test_one_that_is_followed_is_not_lost_to_a_second_that_appears() -> None:
    one = renderer().render(1.2, 1.0, 0.5).copy()
    two = beside(one, renderer().render(3.5, 1.0, -1.0))
    tracker = Tracker(marked())
    tracker.track(one, 0)
    found = tracker.track(two, 33_333_333)["v"]
    assert found.x_px == pytest.approx(1.2 * SCALE - 0.5, abs=0.1)
    assert found.quality > 0.9


def test_a_jump_is_doubted_once_and_then_believed() -> None:
    camera, tracker = renderer(), Tracker(marked())
    qualities: list[Detection] = []
    for k, x_m in enumerate([1.0, 1.0, 4.0, 4.0]):
        qualities.append(tracker.track(camera.render(x_m, 1.0, 0.0), k * 33_333_333)["v"])
    assert [found.quality > 0.9 for found in qualities] == [True, True, False, True]
    assert "jumped by 4" in qualities[2].reason


def test_the_tables_of_the_dictionaries_agree_with_opencv() -> None:
    for name in ("4x4_50", "6x6_250", "aruco_original", "apriltag_36h11", "aruco_mip_36h12"):
        assert len(load_code(name).words) == DICTIONARIES[name]


def test_middle_and_heading_of_a_square_in_perspective() -> None:
    corners = [(0.0, 0.0), (10.0, 0.0), (8.0, 4.0), (2.0, 4.0)]
    assert middle_of(corners) == pytest.approx((5.0, 2.5))
    assert heading_of(corners) == pytest.approx(0.0)
    assert heading_of(corners[-1:] + corners[:-1]) == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        ({"dictionary": "4x4_51", "marker": 1}, "no such dictionary: 4x4_51"),
        ({"dictionary": "4x4_50", "marker": 50}, "4x4_50 has no marker 50"),
        ({"dictionary": "4x4_50"}, "dictionary and marker belong together"),
        ({"dictionary": "4x4_50", "marker": 1, "front": "red"}, "either front"),
        ({}, "either front"),
    ],
)
def test_mistakes_in_a_vehicle_are_named(vehicle: dict[str, object], message: str) -> None:
    from pathlib import Path

    with pytest.raises(ConfigError, match=message):
        parse(CameraTrackerConfig, {"vehicles": [{"name": "a", **vehicle}]}, Path("x.toml"))


@pytest.mark.parametrize(("x_m", "y_m"), [(0.1, 1.0), (4.9, 2.0), (2.0, 3.7)])
def test_out_of_view_is_never_good(x_m: float, y_m: float) -> None:
    camera = renderer()
    for k in range(12):
        found = Tracker(marked()).track(camera.render(x_m + 0.01 * k, y_m, 0.3 * k), 0).get("v")
        if found is not None and found.quality >= 0.5:
            assert math.hypot(found.x_px + 0.5 - (x_m + 0.01 * k) * SCALE, found.y_px + 0.5 - y_m * SCALE) < 0.5


def test_eight_k_is_searched_and_then_followed_in_a_region() -> None:
    camera = replace(VESSEL.camera, width_px=7680, height_px=4320, scale_px_per_m=800.0)
    image = np.full((camera.height_px, camera.width_px, 3), 90, np.uint8)
    small = renderer(200.0).render(2.5, 1.8, 0.4)
    image[2000:2600, 3000:3800] = small
    tracker = Tracker(marked())
    for k in range(2):
        found = tracker.track(image, k * 33_333_333)["v"]
        assert (found.x_px, found.y_px) == pytest.approx((3000 + 2.5 * SCALE - 0.5, 2000 + 1.8 * SCALE - 0.5), abs=0.1)
        assert (found.region is None) == (k == 0)
