"""The rendered camera shows the vessel where it is: measured here without the tracker."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camera_tracker import marker
from camera_tracker.sources import Image
from marine.vessel import Vessel
from services.simulator.camera import Renderer
from services.vessels import load_vessel


@pytest.fixture(scope="module")
def vessel() -> Vessel:
    return load_vessel("pladypos")


@pytest.fixture(scope="module")
def noiseless(vessel: Vessel) -> Renderer:
    return Renderer(vessel, noise_std=0.0)


def patch_centre(image: Image, x_px: float, y_px: float, psi_rad: float, scale: float) -> tuple[float, float]:
    """Return the centroid of the colour above the plate's, near a patch that should be at (x_px, y_px)."""
    v, u = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    along = (math.cos(psi_rad) * (u - x_px) + math.sin(psi_rad) * (v - y_px)) / scale
    across = (-math.sin(psi_rad) * (u - x_px) + math.cos(psi_rad) * (v - y_px)) / scale
    near = (abs(along) < 0.5 * marker.PATCH_LENGTH_M + 0.02) & (abs(across) < 0.5 * marker.PATCH_WIDTH_M + 0.02)
    weight = near * (image[..., 2].astype(float) - marker.PLATE_BGR[2])
    return float((weight * u).sum() / weight.sum()), float((weight * v).sum() / weight.sum())


@pytest.mark.parametrize("psi_rad", [0.0, 0.4, -1.3, math.pi])
@pytest.mark.parametrize(("x_m", "y_m"), [(2.0, 1.5), (2.0021, 1.5043), (3.3333, 0.7777)])
def test_patches_are_where_they_should_be(
    vessel: Vessel, noiseless: Renderer, x_m: float, y_m: float, psi_rad: float
) -> None:
    scale = vessel.camera.scale_px_per_m
    image = noiseless.render(x_m, y_m, psi_rad)
    for side in (0.5, -0.5):
        x_px = (x_m + side * marker.SPACING_M * math.cos(psi_rad)) * scale - 0.5
        y_px = (y_m + side * marker.SPACING_M * math.sin(psi_rad)) * scale - 0.5
        assert patch_centre(image, x_px, y_px, psi_rad, scale) == pytest.approx((x_px, y_px), abs=0.02)


def test_front_is_yellow_and_psi_turns_clockwise(vessel: Vessel, noiseless: Renderer) -> None:
    image = noiseless.render(2.0, 1.5, math.pi / 2)  # x forward points down in the picture
    front, rear = image[240 + 19, 320].astype(int), image[240 - 19, 320].astype(int)
    assert front.tolist() == pytest.approx(marker.FRONT_BGR, abs=2)
    assert rear.tolist() == pytest.approx(marker.REAR_BGR, abs=2)


def test_shift_moves_the_vessel_and_the_water(vessel: Vessel) -> None:
    plain = Renderer(vessel, noise_std=0.0).render(2.0, 1.5, 0.3).copy()
    moved = Renderer(vessel, noise_std=0.0).render(2.0, 1.5, 0.3, shift_px=(10.0, -4.0))
    same = (plain[4:, :-10] == moved[:-4, 10:]).all(axis=2)
    assert same.mean() > 0.98  # all but the glare, which the test does not move


def test_black_is_black_and_the_next_frame_is_back(noiseless: Renderer) -> None:
    assert not noiseless.render(2.0, 1.5, 0.0, black=True).any()
    assert noiseless.render(2.0, 1.5, 0.0).mean() > 40


def test_noise_has_the_stated_size_and_differs_from_frame_to_frame(vessel: Vessel) -> None:
    renderer = Renderer(vessel, noise_std=6.0)
    first = renderer.render(2.0, 1.5, 0.0).astype(int)
    difference = renderer.render(2.0, 1.5, 0.0) - first
    still = difference[100:200, 500:700]
    assert still.std() / math.sqrt(2) == pytest.approx(6.0, rel=0.1)


def test_same_seed_same_pictures(vessel: Vessel) -> None:
    pictures = []
    for seed in (1, 1, 2):
        renderer = Renderer(vessel, seed)
        pictures.append([renderer.render(2.0, 1.5, 0.1 * i).copy() for i in range(3)])
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize(("x_m", "y_m"), [(0.0, 0.0), (5.0, 3.75), (0.1, 3.7), (-3.0, 1.0), (2.0, 50.0)])
def test_a_vessel_that_is_partly_or_wholly_outside_the_picture(noiseless: Renderer, x_m: float, y_m: float) -> None:
    water = noiseless.render(-9.0, -9.0, 0.0).copy()
    inside = -0.3 < x_m < 5.3 and -0.3 < y_m < 4.05
    changed = (noiseless.render(x_m, y_m, 0.7) != water).any(axis=2)
    x_px, y_px = min(max(round(x_m * 160), 0), 799), min(max(round(y_m * 160), 0), 599)
    assert changed[y_px, x_px] == inside


def test_what_is_drawn_ahead_changes_no_picture(vessel: Vessel) -> None:
    at_once, ahead = Renderer(vessel, 1), Renderer(vessel, 1)
    canvas = np.full((600, 800, 3), 77, np.uint8)
    for i, shift_px in enumerate([(0.0, 0.0), (0.0, 0.0), (10.0, -4.0)]):
        ahead.prepare((0.0, 0.0), canvas)
        picture = ahead.render(2.0 + 0.1 * i, 1.5, 0.3 * i, shift_px=shift_px)
        assert (picture is canvas) == (shift_px == (0.0, 0.0))  # knocked since: drawn anew
        assert np.array_equal(picture, at_once.render(2.0 + 0.1 * i, 1.5, 0.3 * i, shift_px=shift_px))
