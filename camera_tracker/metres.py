"""From a detection in pixels to the metres of `camera/pose`: by a scale, or by the camera's calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from bus.config import ConfigError
from camera_tracker.calibration import Array, read_json
from camera_tracker.config import CameraTrackerConfig
from camera_tracker.detectors.base import Detection
from camera_tracker.plane import CameraFile, PlaneMap
from marine.vessel import Vessel


class Metres(Protocol):
    """Turns detections into the fields of a pose."""

    size_px: tuple[int, int]
    """The size of picture (width, height) for which it holds."""
    told_by: str
    """Who says so."""
    scale_px_per_m: float
    """Of markers, about."""

    def fields(self, name: str, found: Detection) -> dict[str, Any]:
        """Return the fields of CameraPose that are in {E}; without x_m, y_m where the picture shows no water."""
        ...


class StraightDown:
    """A camera that looks straight down on the water: one scale, x_m = (x_px + 0.5) / scale."""

    told_by = "the vessel file"

    def __init__(self, scale_px_per_m: float, size_px: tuple[int, int]) -> None:
        self.scale_px_per_m, self.size_px = scale_px_per_m, size_px

    def fields(self, name: str, found: Detection) -> dict[str, Any]:
        """Return x_m, y_m, psi_rad."""
        x_m, y_m = (found.x_px + 0.5) / self.scale_px_per_m, (found.y_px + 0.5) / self.scale_px_per_m
        return {"x_m": x_m, "y_m": y_m, "psi_rad": found.psi_rad}


class Calibrated:
    """A calibrated camera at a known place, markers at known heights above the water."""

    told_by = "its calibration"

    def __init__(self, config: CameraTrackerConfig, path: Path) -> None:
        file: CameraFile = read_json(CameraFile, path)
        if file.placement is None:
            raise ConfigError(f"{path}: the camera's place is not known yet: run `starboard camera place`")
        self.size_px = (file.lens.width_px, file.lens.height_px)
        self._std_px, self._std_rad = config.position_noise_px, config.heading_noise_rad
        self._heights = {v.name: v.height_m for v in config.vehicles if v.height_m is not None}
        self._height_m = config.marker_height_m
        camera_height_m = -float(file.placement.camera_m[2])
        if self._height_m >= camera_height_m:
            raise ConfigError(f"{path}: the camera hangs at {camera_height_m:.2f} m, below marker_height_m")
        self.scale_px_per_m = file.lens.fx_px / (camera_height_m - self._height_m)
        heights = {self._height_m, *self._heights.values()}
        self._planes = {h: PlaneMap(file.placement, h, config.marker_height_std_m) for h in heights}

    def fields(self, name: str, found: Detection) -> dict[str, Any]:
        """Return pose and covariances in {E}, and the heading in the picture."""
        plane = self._planes[self._heights.get(name, self._height_m)]
        pose = plane.pose(found.x_px, found.y_px, found.psi_rad, self._std_px, self._std_rad)
        if pose is None:
            return {"psi_rad": found.psi_rad, "quality": 0.0, "reason": "the picture shows no water there"}
        return {
            "x_m": pose.x_m,
            "y_m": pose.y_m,
            "psi_rad": pose.psi_rad,
            "psi_image_rad": found.psi_rad,
            "covariance": _triangle(pose.noise + pose.map_error),
            "noise_covariance": _triangle(pose.noise),
        }


def metres_for(config: CameraTrackerConfig, vessel: Vessel, config_path: Path | None) -> Metres:
    """Return what the configuration asks for; a calibration's path counts from the configuration file's folder.

    Raises ConfigError when the calibration cannot be used.
    """
    if config.calibration is not None:
        return Calibrated(config, (config_path.parent if config_path else Path()) / config.calibration)
    camera = vessel.camera
    return StraightDown(config.scale_px_per_m or camera.scale_px_per_m, (camera.width_px, camera.height_px))


def _triangle(matrix: Array) -> tuple[float, ...]:
    """Return xx, x y, x psi, yy, y psi, psi psi of a symmetric (3, 3)."""
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    return a, b, c, d, e, f
