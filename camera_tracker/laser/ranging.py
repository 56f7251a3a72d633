"""From two dots to distance and angle: calibration curves (3.9), (3.7), (3.8) of thesis 3.4."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bus.config import Section
from camera_tracker.calibration import CalibrationError, read_json

Array = NDArray[np.float64]

MIN_POINTS = 6
"""Four parameters, and something to tell whether they fit."""
MAX_RELATIVE_RMS = 0.05


class LaserCurve(Section):
    """L = a e^(b x) + c e^(d x), thesis (3.9): how far a laser's dot is, by how far it is from the picture's middle.

    a, c in m; b, d per px (the table's "1/cm" is a mistake: see docs/errata.md). Falls everywhere: one x, one L.
    """

    a_m: float = Field(ge=0)
    b_per_px: float = Field(le=0)
    c_m: float = Field(ge=0)
    d_per_px: float = Field(le=0)

    def length_m(self, x_px: float) -> float:
        """Return L at a distance x from the middle of the picture."""
        return self.a_m * math.exp(self.b_per_px * x_px) + self.c_m * math.exp(self.d_per_px * x_px)

    def x_px(self, length_m: float) -> float:
        """Return x at which the dot is seen when the laser travels L; raise ValueError when it is at no x >= 0."""
        if not 0.0 < length_m <= self.length_m(0.0):
            raise ValueError(f"a length of {length_m} m is not on the curve: at most {self.length_m(0.0):.3f} m")
        low, high = 0.0, 1.0
        while self.length_m(high) > length_m:
            low, high = high, 2.0 * high
        from scipy.optimize import brentq

        return float(brentq(lambda x: self.length_m(x) - length_m, low, high))


class LaserModule(Section):
    """Both lasers. spacing_m: d_DM between them; the picture's middle is at centre_x_px (None: half its width)."""

    left: LaserCurve
    right: LaserCurve
    spacing_m: float = Field(gt=0)
    centre_x_px: float | None = None
    colour: Literal["red", "green"] = "red"
    rms_m: float = Field(0.0, ge=0, description="of the calibration, both lasers")

    def range(self, left_px: float, right_px: float) -> tuple[float, float]:
        """Return distance D in m, (3.8), and angle Phi in rad to the wall, (3.7) corrected: see docs/errata.md.

        left_px, right_px: distances of the dots from the middle. Phi is 0 before the wall, positive when the right
        laser travels further.
        """
        left_m, right_m = self.left.length_m(left_px), self.right.length_m(right_px)
        return 0.5 * (right_m + left_m), math.atan2(right_m - left_m, self.spacing_m)

    def lengths_m(self, distance_m: float, angle_rad: float) -> tuple[float, float]:
        """Return (L_L, L_R) before a wall: the inverse of (3.7) and (3.8)."""
        half = 0.5 * self.spacing_m * math.tan(angle_rad)
        return distance_m - half, distance_m + half


VIDEORAY_LEFT = LaserCurve(a_m=5.077, b_per_px=-0.03745, c_m=0.8871, d_per_px=-0.007085)
VIDEORAY_RIGHT = LaserCurve(a_m=2.302, b_per_px=-0.03876, c_m=0.833, d_per_px=-0.007234)
"""Thesis Table 3.1 (10 to 100 cm)."""
SPACING_M = 0.1
"""Chosen: the thesis prints no d_DM."""


def laser_module(calibration: Path | None = None, spacing_m: float = SPACING_M) -> LaserModule:
    """Return the module of a file of `starboard camera laser calibrate`; without one the curves of Table 3.1.

    Raises ConfigError when the file cannot be used.
    """
    if calibration is None:
        return LaserModule(left=VIDEORAY_LEFT, right=VIDEORAY_RIGHT, spacing_m=spacing_m)
    module: LaserModule = read_json(LaserModule, calibration)
    return module


def fit_curve(x_px: Array, length_m: Array) -> tuple[LaserCurve, float]:
    """Return the curve through measured (n,) distances from the middle and lengths, and its RMS error in m.

    Minimises the relative error, as a dot far away is a few px from the next. Raises CalibrationError when there are
    too few points or none of these curves fits.
    """
    from scipy.optimize import least_squares, nnls

    if len(x_px) < MIN_POINTS or len(np.unique(x_px)) < MIN_POINTS:
        raise CalibrationError(f"{len(np.unique(x_px))} different places of the dot: at least {MIN_POINTS} are needed")
    if not (np.isfinite(x_px).all() and (x_px > 0).all() and np.isfinite(length_m).all() and (length_m > 0).all()):
        raise CalibrationError("distances must be positive, and each dot on its own side of the picture's middle")
    span = float(np.ptp(x_px))
    rates = np.geomspace(0.1 / span, 30.0 / span, 24)

    def linear(b: float, d: float) -> tuple[Array, float]:
        terms = np.exp(np.outer(x_px, [-b, -d])) / length_m[:, None]
        return nnls(terms, np.ones(len(x_px)))

    steep, flat = min(((b, d) for b in rates for d in rates if b > d), key=lambda pair: linear(*pair)[1])
    a, c = np.maximum(linear(steep, flat)[0], 1e-6)

    def errors(log: Array) -> Array:
        a, b, c, d = np.exp(log)
        return np.asarray((a * np.exp(-b * x_px) + c * np.exp(-d * x_px)) / length_m - 1.0)

    solved = least_squares(errors, np.log([a, steep, c, flat]), x_scale=1.0, max_nfev=2000)
    a, b, c, d = np.exp(solved.x).tolist()
    curve = LaserCurve(a_m=a, b_per_px=-b, c_m=c, d_per_px=-d)
    relative = float(np.sqrt(np.mean(solved.fun**2)))
    if not relative <= MAX_RELATIVE_RMS:
        raise CalibrationError(f"the curve misses the points by {100 * relative:.0f} %: is one of them wrong?")
    return curve, float(np.sqrt(np.mean((solved.fun * length_m) ** 2)))
