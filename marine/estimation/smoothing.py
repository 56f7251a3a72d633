"""Savitzky-Golay smoothing and velocities from measured poses, thesis Algorithm 3.2 VI and Fig. 3.16.

A polynomial of low order is fitted to a window of samples by least squares; its value or derivative at one point of
the window is a weighted sum of the samples. In the middle of the window there is no delay but the future is needed
(offline); at the newest sample the filter is causal.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from marine.frames import to_body, wrap_angle

Array = NDArray[np.float64]


def polynomial_weights(offsets_s: Array, order: int, derivative: int = 0) -> Array:
    """Return the weights (n,) of samples at offsets (n,) in s from the point where the derivative is wanted.

    The sampling need not be even. Raises ValueError when the samples are too few or coincide.
    """
    if not 0 <= derivative <= order < len(offsets_s):
        raise ValueError(f"order {order}, derivative {derivative} do not fit {len(offsets_s)} samples")
    span_s = float(np.ptp(offsets_s))
    if span_s <= 0.0 and order > 0:
        raise ValueError("the samples have no distance in time")
    scale_s = span_s or 1.0  # powers of numbers near 1 keep the fit well-conditioned
    fit = np.linalg.pinv(np.vander(offsets_s / scale_s, order + 1, increasing=True))
    weights: Array = fit[derivative] * (math.factorial(derivative) / scale_s**derivative)
    return weights


def savgol_weights(window: int, order: int, derivative: int, step_s: float, position: int | None = None) -> Array:
    """Return the weights (window,), oldest sample first, for evenly spaced samples.

    position: index in the window where the derivative is wanted; None: the newest sample (causal).
    """
    at = window - 1 if position is None else position
    return polynomial_weights((np.arange(window, dtype=np.float64) - at) * step_s, order, derivative)


def savgol(samples: Array, window: int, order: int, derivative: int, step_s: float) -> Array:
    """Return smoothed samples or a derivative (n,) by the centred filter; the ends take the first and last fit.

    Raises ValueError when the window is even or longer than the samples.
    """
    if window % 2 == 0 or window > len(samples):
        raise ValueError(f"window {window} must be odd and not longer than the {len(samples)} samples")
    half = window // 2
    result = np.empty(len(samples))
    middle = savgol_weights(window, order, derivative, step_s, half)
    result[half : len(samples) - half] = np.convolve(samples, middle[::-1], "valid")
    for i in range(half):
        result[i] = savgol_weights(window, order, derivative, step_s, i) @ samples[:window]
        result[-1 - i] = savgol_weights(window, order, derivative, step_s, window - 1 - i) @ samples[-window:]
    return result


def body_velocities(poses: Array, window: int, order: int, step_s: float) -> Array:
    """Return [u v r] (3, n) of evenly sampled poses [x y psi] (3, n) by inverse kinematics, thesis Algorithm 3.2 VI."""
    x, y, psi = poses[0], poses[1], np.unwrap(poses[2])
    x_rate, y_rate, r = (savgol(samples, window, order, 1, step_s) for samples in (x, y, psi))
    psi = savgol(psi, window, order, 0, step_s)
    c, s = np.cos(psi), np.sin(psi)
    return np.stack([c * x_rate + s * y_rate, -s * x_rate + c * y_rate, r])


def recorded_velocities(times_s: Array, poses: Array, window: int, order: int, *, causal: bool = False) -> Array:
    """Return [u v r] (3, n) of recorded poses [x y psi] (3, n), which need not come evenly, thesis Algorithm 3.2 VI.

    Centred windows, cut at the ends; causal: as `CausalVelocities` gave them live. Across a gap of five samples and
    more nothing is fitted: pieces that are shorter than the window give NaN. Raises ValueError when the times do not
    rise or the window does not fit the order.
    """
    steps = np.diff(times_s)
    if not 1 <= order < window or (len(steps) and float(steps.min()) <= 0.0):
        raise ValueError("times must rise, and the window be longer than the order")
    result = np.full((3, len(times_s)), np.nan)
    gaps = np.flatnonzero(steps > 5.0 * (np.median(steps) if len(steps) else 0.0)) + 1
    for piece in np.split(np.arange(len(times_s)), gaps):
        if len(piece) < window:
            continue
        unwrapped = np.vstack([poses[:2, piece], np.unwrap(poses[2, piece])])
        for i, at in enumerate(piece):
            first = min(max(i - window + 1 if causal else i - window // 2, 0), len(piece) - window)
            if causal and i < window - 1:
                continue
            near = slice(first, first + window)
            offsets = times_s[piece[near]] - times_s[at]
            rates = unwrapped[:, near] @ polynomial_weights(offsets, order, 1)
            psi = unwrapped[2, near] @ polynomial_weights(offsets, order, 0)
            result[:, at] = (*to_body(float(rates[0]), float(rates[1]), float(psi)), rates[2])
    return result


class CausalVelocities:
    """Body velocities from the last poses: the causal filter, for poses that need not come evenly."""

    def __init__(self, window: int, order: int) -> None:
        if not 1 <= order < window:
            raise ValueError(f"order {order} needs more than {window} samples")
        self._order = order
        self._times: deque[float] = deque(maxlen=window)
        self._poses: deque[tuple[float, float, float]] = deque(maxlen=window)

    def add(self, time_s: float, x_m: float, y_m: float, psi_rad: float) -> tuple[float, float, float]:
        """Take in a pose and return [u v r] at its time; zeros until there are enough poses.

        Raises ValueError when the time is not later than the last one.
        """
        if self._times and time_s <= self._times[-1]:
            raise ValueError(f"pose at {time_s} s is not later than the one before at {self._times[-1]} s")
        if self._poses:  # unwrapped, so that the fit sees no jump
            before = self._poses[-1][2]
            psi_rad = before + wrap_angle(psi_rad - before)
        self._times.append(time_s)
        self._poses.append((x_m, y_m, psi_rad))
        if len(self._times) <= self._order:
            return (0.0, 0.0, 0.0)
        weights = polynomial_weights(np.array(self._times) - time_s, self._order, 1)
        x_rate, y_rate, r = (weights @ np.array(self._poses)).tolist()
        return (*to_body(x_rate, y_rate, psi_rad), r)

    def clear(self) -> None:
        """Forget all poses."""
        self._times.clear()
        self._poses.clear()
