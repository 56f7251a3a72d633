"""The tracker on the rendered camera: any pose, with noise 6 and blur 1, found at once and to 0.1 px."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from camera_tracker.config import CameraTrackerConfig
from camera_tracker.tracking import Tracker
from services.simulator.camera import Renderer
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
SCALE = VESSEL.camera.scale_px_per_m
RENDERER = Renderer(VESSEL, seed=5)
CONFIG = CameraTrackerConfig().with_default_marker("v", SCALE)


def errors(tracker: Tracker, x_m: float, y_m: float, psi_rad: float, stamp_ns: int) -> tuple[float, float, float]:
    """Return the errors in px, px and degrees of one tracked picture."""
    found = tracker.track(RENDERER.render(x_m, y_m, psi_rad), stamp_ns)["v"]
    assert found.quality > 0.9
    turn = math.degrees(math.remainder(found.psi_rad - psi_rad, math.tau))
    return found.x_px + 0.5 - x_m * SCALE, found.y_px + 0.5 - y_m * SCALE, turn


@settings(max_examples=150, deadline=None)
@given(x_m=st.floats(0.3, 4.7), y_m=st.floats(0.3, 3.45), psi_rad=st.floats(-math.pi, math.pi))
def test_any_pose_is_found_in_the_first_picture(x_m: float, y_m: float, psi_rad: float) -> None:
    dx, dy, turn = errors(Tracker(CONFIG), x_m, y_m, psi_rad, 0)
    assert abs(dx) < 0.1
    assert abs(dy) < 0.1
    assert abs(turn) < 0.3


def test_a_moving_vessel_is_followed_to_a_hundredth_of_a_pixel() -> None:
    tracker = Tracker(CONFIG)
    measured = []
    for k in range(300):  # 0.36 m/s and 110 deg/s: full command
        x_m, y_m, psi = 1.0 + 0.012 * k * 0.8, 1.0 + 0.005 * k, math.remainder(0.064 * k, math.tau)
        measured.append(errors(tracker, x_m, y_m, psi, k * 33_333_333))
    rms = np.sqrt(np.mean(np.square(measured), axis=0))
    assert rms[0] < 0.02
    assert rms[1] < 0.02
    assert rms[2] < 0.05
    assert np.all(np.abs(np.mean(measured, axis=0)) < 0.005)
