"""The forward camera as the simulator draws it: two laser dots on the pool's wall ahead, if the lasers reach it."""

from __future__ import annotations

import math
import random
from pathlib import Path

from bus.clock import NS
from camera_tracker.laser.ranging import laser_module
from camera_tracker.laser.wall import WallCamera
from camera_tracker.sources import FrameWriter
from marine.frames import wrap_angle
from marine.vessel import Pool, Sensor, Vessel

SIZE_PX = (640, 480)
OBLIQUE_RAD = math.radians(40.0)
"""Beyond it the dots are not found (chosen): too little light comes back."""


def wall_ahead(pool: Pool, x_m: float, y_m: float, psi_rad: float) -> tuple[float, float]:
    """Return how far the pool's wall is along a heading from a place in it, and the angle to its normal."""
    ahead, across = math.cos(psi_rad), math.sin(psi_rad)
    walls = (
        (ahead, pool.length_x_m - x_m, 0.0),
        (across, pool.length_y_m - y_m, 0.5 * math.pi),
        (-ahead, x_m, math.pi),
        (-across, y_m, -0.5 * math.pi),
    )
    distance_m, normal_rad = min((gap_m / slope, normal) for slope, gap_m, normal in walls if slope > 1e-9)
    return max(0.0, distance_m), wrap_angle(psi_rad - normal_rad)


class ForwardCamera:
    """Takes a picture at each sample time of the vessel's laser module, which sits at the bow.

    The vessel file's noise is that of the distance at which the dots are drawn, as the wall is rough; its dropout takes
    one of the dots away. The frames are handed over by shared memory, `sim://directory`.
    """

    def __init__(self, vessel: Vessel, sensor: Sensor, seed: int, directory: Path) -> None:
        self._pool, self._bow_m, self._sensor = vessel.pool, vessel.radius_m, sensor
        self._module = laser_module()
        self._random = random.Random(seed)
        self._camera = WallCamera(self._module, SIZE_PX, seed)
        self._frames = FrameWriter(directory, *SIZE_PX)
        self._camera.picture(0.5)  # now, not while the vessel moves: imports
        self._due_ns = 0

    def look(self, now_ns: int, x_m: float, y_m: float, psi_rad: float, *, lost: bool = False) -> None:
        """Take a picture if it is time; lost: without dots."""
        if now_ns < self._due_ns:
            return
        self._due_ns = max(self._due_ns, now_ns - NS) + round(self._sensor.sample_time_s * NS)
        distance_m, angle_rad = wall_ahead(self._pool, x_m, y_m, psi_rad)
        distance_m += self._random.gauss(0.0, self._sensor.noise) - self._bow_m
        reach_m = self._sensor.range_max or math.inf
        shown = [not lost and distance_m <= reach_m and abs(angle_rad) <= OBLIQUE_RAD] * 2
        if self._random.random() < self._sensor.dropout:
            shown[self._random.randrange(2)] = False
        try:
            picture = self._camera.picture(distance_m, angle_rad, (shown[0], shown[1]))
        except ValueError:  # so near that a dot is out of the picture
            picture = self._camera.picture(distance_m, angle_rad, (False, False))
        self._frames.write(picture, now_ns)

    def close(self) -> None:
        """Let go of the frames' files."""
        self._frames.close()
