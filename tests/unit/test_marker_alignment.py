"""Square markers by their whole code: exact on a drawing, in the hard scene, and beside OpenCV's refinement."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.tracker import NUMBER, SIZES, Scene, config_of, opencv, ours, peer
from camera_tracker.detectors.codes import load_code
from camera_tracker.detectors.edges import middle_of
from camera_tracker.detectors.template import align
from camera_tracker.tracking import Tracker


def drawn(corners: NDArray[np.float64], blur: tuple[float, float]) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Return a marker's pattern and a grey picture of it with its black border's corners there, blurred."""
    pattern = load_code("4x4_50").patterns[3]
    fine, times = np.kron(pattern, np.ones((32, 32))).astype(np.float32), 8
    side = 32.0 * (len(pattern) - 2)
    ends = np.array([(0, 0), (side, 0), (side, side), (0, side)], np.float32) + 31.5
    to_picture = cv2.getPerspectiveTransform(ends, (times * (corners + 0.5) - 0.5).astype(np.float32))
    big = cv2.warpPerspective(fine, to_picture, (120 * times, 120 * times), flags=cv2.INTER_AREA, borderValue=1.0)
    big = cv2.GaussianBlur(big, (0, 0), blur[0] * times, sigmaY=blur[1] * times)
    grey = cv2.resize(40.0 + 150.0 * big, (120, 120), interpolation=cv2.INTER_AREA)
    return pattern, np.asarray(grey, np.float32)


@pytest.mark.parametrize(("turn", "blur"), [(0.0, (0.8, 0.8)), (0.5, (0.8, 0.8)), (0.0, (2.5, 0.8)), (0.0, (0.8, 2.5))])
def test_corners_in_perspective_are_found_from_a_pixel_and_a_half_away(turn: float, blur: tuple[float, float]) -> None:
    c, s = np.cos(turn), np.sin(turn)
    corners = np.array([(-28, -30), (31, -27), (28, 26), (-30, 31)]) @ np.array([[c, s], [-s, c]]) + 58.3
    pattern, grey = drawn(corners, blur)
    start = corners + np.array([(1.2, -0.9), (-0.8, 1.0), (1.0, 0.7), (0.6, -1.0)])
    found = align(grey, [(x, y) for x, y in start.tolist()], pattern, 8, (blur[0] / 9.5, blur[1] / 9.5))
    assert found is not None
    at, middle = found
    assert np.allclose(middle, np.array(middle_of(at)), atol=1e-6)
    even = blur[0] == blur[1]  # else the blur is known to a twentieth of a module only
    assert np.abs(np.array(at) - corners).max() < (0.03 if even else 0.1)
    assert np.abs((np.array(at) - corners).mean(axis=0)).max() < (0.01 if even else 0.05)


def test_what_is_not_the_marker_does_not_settle_on_it() -> None:
    corners = np.array([(30, 30), (90, 30), (90, 90), (30, 90)], float)
    pattern, grey = drawn(corners, (0.8, 0.8))
    found = align(np.float32(255.0) - grey, [(x, y) for x, y in corners.tolist()], pattern, 8, (0.1, 0.1))
    assert found is None


def test_dark_noisy_and_in_motion_it_is_known_to_a_tenth_of_a_pixel() -> None:
    scene = Scene(60.0, light=0.35, noise_std=12.0, blur_px=1.5, motion_px=6.0)
    mine, theirs = ours(scene, 90), peer(opencv(cv2.aruco.CORNER_REFINE_SUBPIX), scene, 30)
    px, deg = mine.rms()
    assert px < 0.10
    assert deg < 0.10
    assert px < 0.3 * theirs.rms()[0]
    assert len(mine.px) > 0.9 * mine.pictures


@pytest.mark.parametrize(("side_px", "limit_px", "limit_deg"), [(60.0, 0.012, 0.015), (30.0, 0.02, 0.04)])
def test_where_nothing_lies_on_it_it_is_known_to_a_hundredth(side_px: float, limit_px: float, limit_deg: float) -> None:
    px, deg = ours(Scene(side_px), 100).rms()
    assert px < limit_px
    assert deg < limit_deg


def test_following_costs_a_part_of_opencvs_search_whatever_the_picture() -> None:
    find, ratios = opencv(cv2.aruco.CORNER_REFINE_SUBPIX), {}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for size in ("480p", "720p"):
            scene = Scene(60.0, SIZES[size])
            tracker, mine, theirs = Tracker(config_of(scene)), [], []
            for picture in scene.pictures(20):
                begin = time.thread_time()
                found = tracker.track(picture.image, picture.stamp_ns)
                between = time.thread_time()
                assert find(cv2.cvtColor(picture.image, cv2.COLOR_BGR2GRAY)) is not None, NUMBER
                mine.append(between - begin)
                theirs.append(time.thread_time() - between)
                assert found
            ratios[size] = np.median(mine[1:]) / np.median(theirs)
    finally:
        cv2.setNumThreads(threads)
    assert ratios["480p"] < 0.6
    assert ratios["720p"] < 0.3
