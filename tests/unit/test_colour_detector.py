"""Colour detector: patches drawn with exact coverage, of which the pose is known."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from bus.config import ConfigError, parse
from camera_tracker.config import CameraTrackerConfig, Colour, Rectangle, Vehicle
from camera_tracker.detectors.base import Detection, Region
from camera_tracker.detectors.colour import colour_mask, find_patches
from camera_tracker.sources import Image
from camera_tracker.tracking import Tracker

RED = Colour(low=(0, 0, 110), high=(90, 80, 255))
GREEN = Colour(low=(0, 110, 0), high=(90, 255, 90))
BGR = {"red": (30, 20, 220), "green": (30, 220, 30)}
FINE = 16


def draw(polygons: list[tuple[str, list[tuple[float, float]]]], width: int = 200, height: int = 200) -> Image:
    """Draw polygons with corners in px (integers are pixel centres), antialiased by FINE x FINE samples a pixel."""
    big = np.full((height * FINE, width * FINE, 3), 40, np.uint8)
    for colour, corners in polygons:
        fine = np.round((np.asarray(corners) + 0.5) * FINE - 0.5).astype(np.int32)
        cv2.fillPoly(big, [fine], BGR[colour])
    return np.asarray(cv2.resize(big, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def rectangle(x: float, y: float, length: float, width: float, angle: float) -> list[tuple[float, float]]:
    c, s = math.cos(angle), math.sin(angle)
    corners = [(-length / 2, -width / 2), (length / 2, -width / 2), (length / 2, width / 2), (-length / 2, width / 2)]
    return [(x + c * u - s * v, y + s * u + c * v) for u, v in corners]


def whole(image: Image) -> Region:
    return Region(0, 0, image.shape[1], image.shape[0])


def pair(*, rear: str | None = "green", **more: object) -> CameraTrackerConfig:
    vehicle = Vehicle.model_validate({"name": "v", "front": "red", "rear": rear, **more})
    return CameraTrackerConfig(colours={"red": RED, "green": GREEN}, vehicles=(vehicle,))


def track(config: CameraTrackerConfig, image: Image) -> Detection | None:
    return Tracker(config).track(image, 0).get("v")


@pytest.mark.parametrize("x", [80.0, 80.25, 80.5, 80.9])
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2])
def test_centroid_is_that_of_the_drawn_patch(x: float, angle: float) -> None:
    image = draw([("red", rectangle(x, 90.3, 30, 20, angle))])
    (patch,) = find_patches(image, whole(image), RED, 20.0)
    assert patch.x_px == pytest.approx(x, abs=0.04)  # the drawing itself is true to 1/32 px
    assert patch.y_px == pytest.approx(90.3, abs=0.04)
    assert patch.area_px2 == pytest.approx(600, rel=0.02)
    assert math.remainder(patch.shape().axis_rad - angle, math.pi) == pytest.approx(0.0, abs=0.005)
    assert patch.shape().elongation == pytest.approx(1.5, rel=0.02)
    assert not patch.clipped


@pytest.mark.parametrize("psi", [-3.0, -1.5, 0.0, 0.7, 2.0, math.pi])
def test_two_patches_give_position_and_heading(psi: float) -> None:
    dx, dy = 18 * math.cos(psi), 18 * math.sin(psi)
    image = draw(
        [
            ("red", rectangle(100.4 + dx, 95.7 + dy, 20, 20, psi)),
            ("green", rectangle(100.4 - dx, 95.7 - dy, 20, 20, psi)),
        ]
    )
    pose = track(pair(spacing_px=36, area_px2=400), image)
    assert pose is not None
    assert (pose.x_px, pose.y_px) == pytest.approx((100.4, 95.7), abs=0.04)
    assert math.remainder(pose.psi_rad - psi, math.tau) == pytest.approx(0.0, abs=0.003)
    assert pose.quality > 0.9
    assert (pose.reason, pose.heading_ambiguous) == ("", False)


@pytest.mark.parametrize("x", [60.0, 60.3, 61.1, 61.6, 62.2, 63.5])
@pytest.mark.parametrize("psi", [0.0, 0.5, -2.2])
def test_patches_of_six_px_are_found(x: float, psi: float) -> None:
    """The coarse search may have less than two of their px, and none of these is two px inside the edge."""
    c, s = 6.0 * math.cos(psi), 6.0 * math.sin(psi)
    front, rear = rectangle(x + c, 90.3 + s, 6.3, 6.3, psi), rectangle(x - c, 90.3 - s, 6.3, 6.3, psi)
    found = track(pair(), draw([("red", front), ("green", rear)]))
    assert found is not None
    assert (found.x_px, found.y_px) == pytest.approx((x, 90.3), abs=0.1)
    assert math.remainder(found.psi_rad - psi, math.tau) == pytest.approx(0.0, abs=0.03)


def test_heading_offset_turns_the_vehicle_and_not_its_place() -> None:
    image = draw([("red", rectangle(120, 100, 20, 20, 0)), ("green", rectangle(80, 100, 20, 20, 0))])
    pose = track(pair(heading_deg=90.0), image)
    assert pose is not None
    assert pose.psi_rad == pytest.approx(math.pi / 2, abs=0.003)
    assert pose.x_px == pytest.approx(100.0, abs=0.04)


@pytest.mark.parametrize("psi", [-2.5, -0.4, 0.0, 1.0, 3.0])
def test_one_asymmetric_patch_has_a_front(psi: float) -> None:
    c, s = math.cos(psi), math.sin(psi)
    dart = [(100 + c * u - s * v, 100 + s * u + c * v) for u, v in ((40, 0), (-20, -15), (-20, 15))]
    pose = track(pair(rear=None), draw([("red", dart)]))
    assert pose is not None
    assert not pose.heading_ambiguous
    assert math.remainder(pose.psi_rad - psi, math.tau) == pytest.approx(0.0, abs=0.01)


def test_one_symmetric_patch_says_that_its_heading_is_ambiguous() -> None:
    pose = track(pair(rear=None), draw([("red", rectangle(100, 100, 50, 20, 0.4))]))
    assert pose is not None
    assert pose.heading_ambiguous
    assert pose.quality <= 0.5
    assert "front and back" in pose.reason
    assert math.remainder(pose.psi_rad - 0.4, math.pi) == pytest.approx(0.0, abs=0.01)


def test_a_clipped_patch_lowers_the_quality_and_says_why() -> None:
    image = draw([("red", rectangle(3, 100, 20, 20, 0)), ("green", rectangle(39, 100, 20, 20, 0))])
    pose = track(pair(), image)
    assert pose is not None
    assert pose.quality == pytest.approx(0.2)
    assert pose.reason == "out of view: clipped at the edge of the picture"


def test_a_patch_cut_by_what_is_ignored_is_clipped_and_one_inside_it_is_not_seen() -> None:
    image = draw([("red", rectangle(60, 100, 20, 20, 0)), ("green", rectangle(100, 100, 20, 20, 0))])
    for width, seen in ((56, True), (75, False)):
        config = pair().model_copy(update={"ignore": (Rectangle(x=0, y=0, width=width, height=200),)})
        pose = track(config, image)
        assert (pose is not None) == seen
        if pose is not None:
            assert pose.reason.startswith("out of view")


def test_patches_of_the_wrong_size_or_too_far_apart() -> None:
    image = draw([("red", rectangle(70, 100, 20, 20, 0)), ("green", rectangle(110, 100, 20, 20, 0))])
    small = track(pair(area_px2=800), image)
    assert small is not None
    assert small.quality == pytest.approx(0.5, abs=0.03)
    assert "50%" in small.reason
    assert track(pair(spacing_px=80), image) is None


def test_a_low_contrast_says_so() -> None:
    config = CameraTrackerConfig(
        colours={"red": Colour(low=(0, 0, 65), high=(255, 255, 255))}, vehicles=(Vehicle(name="v", front="red"),)
    )
    image = np.full((200, 200, 3), 60, np.uint8)
    image[90:110, 80:120] = (60, 60, 90)
    pose = track(config, image)
    assert pose is not None
    assert pose.quality < 0.6


def test_the_pair_that_fits_is_chosen_among_several() -> None:
    image = draw(
        [
            ("red", rectangle(40, 40, 20, 20, 0)),
            ("green", rectangle(40, 76, 20, 20, 0)),
            ("red", rectangle(150, 150, 20, 20, 0)),
            ("green", rectangle(40, 130, 20, 20, 0)),
        ]
    )
    pose = track(pair(spacing_px=36), image)
    assert pose is not None
    assert (pose.x_px, pose.y_px) == pytest.approx((40, 58), abs=0.04)
    assert pose.psi_rad == pytest.approx(-math.pi / 2, abs=0.003)


def test_a_patch_that_the_region_cuts_is_left_out() -> None:
    image = draw([("red", rectangle(100, 100, 20, 20, 0))])
    assert find_patches(image, Region(95, 50, 180, 150), RED, 20.0) == []


def test_hue_runs_over_red() -> None:
    image = np.array([[(0, 0, 255), (30, 0, 255), (0, 60, 255), (0, 255, 255)]], np.uint8)
    colour = Colour(space="hsv", low=(170, 100, 100), high=(10, 255, 255))
    assert colour_mask(image, colour).tolist() == [[255, 255, 255, 0]]


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (40, 1), (600, 800)])
@pytest.mark.parametrize("value", [0, 255, "red", "noise"])
def test_pictures_without_a_vehicle(size: tuple[int, int], value: int | str) -> None:
    image = np.zeros((*size, 3), np.uint8)
    if value == "noise":
        image = np.random.default_rng(1).integers(0, 256, image.shape, np.uint8)
    else:
        image[:] = BGR["red"] if value == "red" else value
    tracker = Tracker(pair(spacing_px=36))
    for i in range(3):
        assert tracker.track(image, i) == {}


def test_one_patch_over_the_whole_picture_is_no_vehicle() -> None:
    assert track(pair(rear=None), np.full((50, 50, 3), BGR["red"], np.uint8)) is None


def test_a_vehicle_is_found_again_wherever_it_jumps() -> None:
    tracker = Tracker(pair(spacing_px=36))
    for i, (x, y) in enumerate([(50, 50), (52, 51), (150, 150), (60, 160)]):
        image = draw([("red", rectangle(x, y, 20, 20, 0)), ("green", rectangle(x - 36, y, 20, 20, 0))])
        found = tracker.track(image, i * 33_000_000)
        assert found["v"].x_px == pytest.approx(x - 18, abs=0.04)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"vehicles": [{"name": "a", "front": "mauve"}]}, "no such colour in colours: mauve"),
        ({"vehicles": [{"name": "a", "front": "red"}] * 2, "colours": {"red": RED}}, "two vehicles have the same name"),
        ({"colours": {"red": {"low": [0, 0, 300], "high": [9, 9, 9]}}}, "colours.red.low.2"),
        ({"sauce": "sim://"}, "sauce: no such key"),
    ],
)
def test_mistakes_in_the_configuration_are_named(values: object, message: str) -> None:
    from pathlib import Path

    with pytest.raises(ConfigError, match=message):
        parse(CameraTrackerConfig, values, Path("x.toml"), "camera_tracker")
