"""Where the camera hangs over the water, from points at known places; and poses in metres from poses in pixels.

{E} is the frame in which the points were measured: x, y on the water, z into it. One least-squares fit finds the
camera's pose, with the lens as far as its calibration leaves it open, so that the covariance of what comes out covers
tape measure, pixels and lens.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from pydantic import Field

from bus.config import Section
from camera_tracker.calibration import LENS_PARAMETERS, Array, CalibrationError, Lens, project

MIN_POINTS = 4
_PARAMETERS = LENS_PARAMETERS + 6
_ALPHA = 0.001
"""Points that fit worse than one in a thousand good sets contain a mistake."""
_ARM_M = 0.1
"""How far before and behind a marker the direction of its heading is followed."""
_FOLDED_PX = 0.5

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Reference:
    """A point at a known place in {E} (height above the water in m), and where it is seen."""

    name: str
    x_m: float
    y_m: float
    height_m: float
    x_px: float
    y_px: float


class Placement(Section):
    """The camera's pose over the water, and the lens as the points refined it."""

    lens: Lens
    rotation_rad: Triple = Field(description="rotation vector from {E} to the camera's frame")
    translation_m: Triple = Field(description="origin of {E} in the camera's frame")
    covariance: tuple[tuple[float, ...], ...] = Field(
        description="of fx fy cx cy k1 k2 p1 p2 k3, rotation, translation",
        min_length=_PARAMETERS,
        max_length=_PARAMETERS,
    )
    rms_m: float = Field(ge=0, description="distance between the points as measured and as seen")

    @property
    def pose(self) -> Array:
        """Rotation vector and translation (6,)."""
        return np.array([*self.rotation_rad, *self.translation_m])

    @property
    def camera_m(self) -> Array:
        """Place of the camera in {E} (3,); its z is minus the height over the water."""
        return -_rotation(self.pose).T @ self.pose[3:]


class CameraFile(Section):
    """What `starboard camera` writes and [camera_tracker] calibration names: a camera's lens and place."""

    lens: Lens
    views_px: dict[str, float] = Field(default_factory=dict, description="reprojection error of each picture")
    placement: Placement | None = None


def place_camera(lens: Lens, points: Sequence[Reference], *, std_px: float = 0.2, std_m: float = 0.003) -> Placement:
    """Return the camera's pose from points seen; raise CalibrationError with the reason when they do not suffice.

    std_px: standard deviation of where a point is seen; std_m: of each coordinate as measured.
    """
    if len(points) < MIN_POINTS:
        raise CalibrationError(f"{len(points)} points are seen: at least {MIN_POINTS} are needed, better 6 or more")
    known = np.array([(p.x_m, p.y_m, -p.height_m) for p in points])
    spread = np.linalg.svd(known[:, :2] - known[:, :2].mean(axis=0), compute_uv=False)
    if spread[1] < 0.1 * spread[0]:
        raise CalibrationError("the points lie on one line: spread them over the pool")
    fit = _fit(lens, points, std_px, std_m)
    if fit.placement.camera_m[2] >= 0.0:
        raise CalibrationError(
            "by these points the camera is under water: measure x to the right and y downwards as the picture shows it"
        )
    _refuse_mistakes(fit, lens, points, std_px, std_m)
    return fit.placement


@dataclass(frozen=True)
class _Fit:
    placement: Placement
    chi_squared: float


def _fit(lens: Lens, points: Sequence[Reference], std_px: float, std_m: float) -> _Fit:
    known = np.array([(p.x_m, p.y_m, -p.height_m) for p in points])
    seen = np.array([(p.x_px, p.y_px) for p in points])
    try:
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            known, seen, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error as error:
        raise CalibrationError(f"no place of the camera explains these points: {str(error)[:120]}") from None
    starts = [np.concatenate([r.ravel(), t.ravel()]) for r, t in zip(rotations, translations, strict=True)]
    fits = [_refine(lens, start, known, seen, std_px, std_m) for start in starts]
    if not fits:
        raise CalibrationError("no place of the camera explains these points")
    return min(fits, key=lambda fit: fit.chi_squared)


def _refine(  # noqa: PLR0917
    lens: Lens, start: Array, known: Array, seen: Array, std_px: float, std_m: float
) -> _Fit:
    """Fit pose and lens from a start; the lens moves by z, as many standard deviations of its calibration."""
    from scipy.optimize import least_squares

    values, vectors = np.linalg.eigh(np.array(lens.covariance))
    free = values > 1e-12 * max(float(values[-1]), 1e-30)
    spread = vectors[:, free] * np.sqrt(values[free])  # (9, k)
    count = spread.shape[1]
    whiten = [np.linalg.inv(np.linalg.cholesky(S)) for S in _scatter(lens, start, known, std_px, std_m)]

    def residuals(theta: Array) -> Array:
        expected, _ = project(known, theta[count:], lens.parameters + spread @ theta[:count])
        errors = [w @ e for w, e in zip(whiten, expected - seen, strict=True)]
        return np.concatenate([theta[:count], *errors])

    def jacobian(theta: Array) -> Array:
        _, by = project(known, theta[count:], lens.parameters + spread @ theta[:count])
        rows = [
            w @ np.hstack([b[:, :LENS_PARAMETERS] @ spread, b[:, LENS_PARAMETERS:]])
            for w, b in zip(whiten, by, strict=True)
        ]
        return np.vstack([np.eye(count, count + 6), *rows])

    solved = least_squares(residuals, np.concatenate([np.zeros(count), start]), jacobian, x_scale="jac")
    to_all = np.zeros((_PARAMETERS, count + 6))
    to_all[:LENS_PARAMETERS, :count], to_all[LENS_PARAMETERS:, count:] = spread, np.eye(6)
    by = jacobian(solved.x)
    covariance = to_all @ np.linalg.pinv(by.T @ by, hermitian=True) @ to_all.T
    parameters, pose = lens.parameters + spread @ solved.x[:count], solved.x[count:]
    size = (lens.width_px, lens.height_px)
    refined = Lens.of(size, parameters, covariance[:LENS_PARAMETERS, :LENS_PARAMETERS], lens.rms_px)
    on_plane = _on_plane(refined, pose, seen, known[:, 2])
    rms_m = float(np.sqrt(np.mean(np.sum((on_plane - known[:, :2]) ** 2, axis=1))))
    placement = Placement(
        lens=refined,
        rotation_rad=tuple(pose[:3].tolist()),
        translation_m=tuple(pose[3:].tolist()),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        rms_m=rms_m,
    )
    return _Fit(placement, 2.0 * float(solved.cost))


def _scatter(lens: Lens, pose: Array, known: Array, std_px: float, std_m: float) -> Array:
    """Return the covariance (n, 2, 2) of where points are seen, tape measure included."""
    _, by = project(known, pose, lens.parameters)
    per_m = by[:, :, LENS_PARAMETERS + 3 :] @ _rotation(pose)
    return np.asarray(std_px**2 * np.eye(2) + std_m**2 * per_m @ per_m.transpose(0, 2, 1))


def _refuse_mistakes(fit: _Fit, lens: Lens, points: Sequence[Reference], std_px: float, std_m: float) -> None:
    from scipy.stats import chi2

    if fit.chi_squared <= chi2.isf(_ALPHA, 2 * len(points) - 6):
        return
    problem = f"the points do not fit together ({1e3 * fit.placement.rms_m:.0f} mm RMS)"
    if len(points) > MIN_POINTS:
        without = {p.name: _fit(lens, [q for q in points if q is not p], std_px, std_m).chi_squared for p in points}
        name = min(without, key=lambda n: without[n])
        if without[name] <= chi2.isf(_ALPHA, 2 * len(points) - 8):
            raise CalibrationError(f"{problem}: without {name} they do; measure it again")
    raise CalibrationError(f"{problem}: measure again, or state a larger error of the tape measure")


@dataclass(frozen=True)
class PlanePose:
    """A pose in {E}. noise (3, 3): of this sample alone; map_error (3, 3): of the camera's place, alike in all samples.

    Both in m and rad, order x y psi. The error of the pose has the covariance noise + map_error.
    """

    x_m: float
    y_m: float
    psi_rad: float
    noise: Array
    map_error: Array


class PlaneMap:
    """Pixels to metres for markers at a height above the water: thesis 3.5.1 without 'directly above'."""

    def __init__(self, placement: Placement, height_m: float = 0.0, height_std_m: float = 0.0) -> None:
        self._lens, self._pose, self._height_m = placement.lens, placement.pose, height_m
        self._parameters = placement.lens.parameters
        self._rotation = _rotation(placement.pose)
        self._covariance = np.array(placement.covariance)
        self._height_variance = height_std_m**2

    def pose(self, x_px: float, y_px: float, psi_rad: float, std_px: float, std_rad: float) -> PlanePose | None:
        """Return a pose in {E} from one in the picture; None where the picture shows no water.

        std_px: standard deviation of each coordinate in the picture; std_rad: of the heading there.
        """
        at_px = np.array([[x_px, y_px]])
        at_m = _on_plane(self._lens, self._pose, at_px, np.array([-self._height_m]))[0]
        if not np.isfinite(at_m).all():
            return None
        to_m = self._per_px(self._seen(at_m[None])[1])[0]
        dx, dy = (to_m @ (math.cos(psi_rad), math.sin(psi_rad))).tolist()
        length = math.hypot(dx, dy)
        arm = _ARM_M / length * np.array([dx, dy])
        seen, by = self._seen(np.stack([at_m - arm, at_m, at_m + arm]))
        if np.abs(seen[1] - at_px).max() > _FOLDED_PX:  # beyond where the distortion polynomial holds
            return None
        moved = -self._per_px(by) @ by  # (3, 2, 15): how the points on the water move with the parameters
        turned = np.array([-dy, dx]) / length @ (moved[2] - moved[0]) / (2.0 * _ARM_M)
        by_map = np.vstack([moved[1], turned])
        map_error = by_map @ self._covariance @ by_map.T
        by_height = to_m @ (by[1, :, LENS_PARAMETERS + 3 :] @ self._rotation[:, 2])  # a homothety: psi stays
        map_error[:2, :2] += self._height_variance * np.outer(by_height, by_height)
        noise = np.zeros((3, 3))
        noise[:2, :2] = std_px**2 * to_m @ to_m.T
        noise[2, 2] = (std_rad * np.linalg.det(to_m) / length**2) ** 2
        return PlanePose(float(at_m[0]), float(at_m[1]), math.atan2(dy, dx), noise, map_error)

    def _seen(self, points_m: Array) -> tuple[Array, Array]:
        heights = np.full((len(points_m), 1), -self._height_m)
        return project(np.hstack([points_m, heights]), self._pose, self._parameters)

    def _per_px(self, by: Array) -> Array:
        """Return (n, 2, 2): m on the water per px."""
        return np.asarray(np.linalg.inv(by[:, :, LENS_PARAMETERS + 3 :] @ self._rotation[:, :2]), np.float64)


def _rotation(pose: Array) -> Array:
    return np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)


def _on_plane(lens: Lens, pose: Array, points_px: Array, z_m: Array) -> Array:
    """Return where the rays of points (n, 2) meet the planes z = z_m (n,), (n, 2) m; NaN where they do not."""
    rotation = _rotation(pose)
    camera = -rotation.T @ pose[3:]
    undistorted = lens.undistorted(points_px)
    rays = np.hstack([undistorted, np.ones((len(undistorted), 1))]) @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = (z_m - camera[2]) / rays[:, 2]
        distances = np.where(distances > 0.0, distances, np.nan)
    return np.asarray(camera[:2] + distances[:, None] * rays[:, :2], np.float64)
