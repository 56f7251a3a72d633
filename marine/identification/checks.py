"""Checks of measured series before anything is identified from them."""

from __future__ import annotations

import numpy as np

from marine.identification.result import Axis, FloatArray, IdentificationError

_GAP = 1.5
"""A step of time this many sample times long is a gap."""
_FASTEST_RAD_S = 10.0
"""570 degrees a second: no vessel turns so fast, numbers above it are degrees."""


def sampled(t_s: FloatArray, axis: Axis = "angular", **signals: FloatArray) -> float:
    """Return the sample time of series that can be identified.

    t_s: times in s. signals: arrays of the same length by name; `eta` (position or heading), `nu` (velocity),
    `tau` (force or moment).

    Raises IdentificationError with the reason and the remedy for: too few samples, different lengths, values that are
    not finite, duplicated or backward time, gaps, signals that do not change, degrees where radians are expected.
    """
    t = np.asarray(t_s, dtype=float)
    if t.ndim != 1 or t.size < 8:
        raise IdentificationError(f"{t.size} samples are too few: at least 8 are needed")
    for name, values in signals.items():
        if np.shape(values) != t.shape:
            raise IdentificationError(f"{name} has {np.size(values)} samples, time has {t.size}: align them first")
        if not np.isfinite(values).all():
            bad = int(np.argmin(np.isfinite(values)))
            raise IdentificationError(f"{name} is not a number at sample {bad}: cut or resample it")
    dt_s = _sample_time(t)
    for name, values in signals.items():
        if np.ptp(values) == 0.0:
            raise IdentificationError(f"{name} is constant ({values[0]:.4g}): excite the vessel and record again")
    if axis == "angular":
        _require_radians(dt_s, signals)
    if "eta" in signals and "nu" in signals:
        _require_agreement(dt_s, signals["eta"], signals["nu"], axis)
    return dt_s


def _sample_time(t: FloatArray) -> float:
    if not np.isfinite(t).all():
        raise IdentificationError("time is not a number: cut these samples")
    steps = np.diff(t)
    worst = int(np.argmin(steps))
    if steps[worst] <= 0.0:
        what = "twice the same" if steps[worst] == 0.0 else "going backward"
        raise IdentificationError(f"time is {what} at sample {worst + 1} ({t[worst + 1]:.3f} s): drop such samples")
    dt_s = float(np.median(steps))
    gap = int(np.argmax(steps))
    if steps[gap] > _GAP * dt_s:
        raise IdentificationError(
            f"gap of {steps[gap]:.3f} s at {t[gap]:.3f} s (samples come every {dt_s:.3f} s): identify the parts "
            "separately, or resample explicitly"
        )
    return float((t[-1] - t[0]) / (t.size - 1))


def _require_radians(dt_s: float, signals: dict[str, FloatArray]) -> None:
    remedy = "these are degrees: convert them with numpy.radians"
    if "nu" in signals and np.quantile(np.abs(signals["nu"]), 0.99) > _FASTEST_RAD_S:
        raise IdentificationError(f"the vessel turns at {np.max(np.abs(signals['nu'])):.0f} rad/s: {remedy}")
    if "eta" in signals:
        # over 1 s, so that a coarse compass at a fast rate is no reason; one wrap-around is up to 2 pi
        lag = max(1, min(round(1.0 / dt_s), len(signals["eta"]) - 1))
        turned = np.abs(signals["eta"][lag:] - signals["eta"][:-lag])
        if np.max(turned) / max(lag * dt_s, 1.0) > _FASTEST_RAD_S:
            raise IdentificationError(f"the heading changes by {np.max(turned):.0f} rad in a second: {remedy}")
        jumps = np.abs(np.diff(signals["eta"]))
        if np.max(jumps) > np.pi:
            where = int(np.argmax(jumps)) + 1
            raise IdentificationError(
                f"the heading jumps by {jumps[where - 1]:.2f} rad at sample {where}: use numpy.unwrap"
            )


def _require_agreement(dt_s: float, eta: FloatArray, nu: FloatArray, axis: Axis) -> None:
    """Compare eta's change over a second with the integral of nu: the slope is their common unit and sign."""
    lag = max(1, min(round(1.0 / dt_s), len(eta) - 1))
    position = np.unwrap(eta) if axis == "angular" else eta
    change = position[lag:] - position[:-lag]
    integral = np.concatenate([[0.0], np.cumsum(0.5 * dt_s * (nu[1:] + nu[:-1]))])
    travelled = integral[lag:] - integral[:-lag]
    power, common = float(travelled @ travelled), float(change @ travelled)
    if common**2 < 0.25 * power * float(change @ change):
        return  # hardly related: noise, or axes of different frames
    slope = common / power
    if slope < 0.0:
        raise IdentificationError("eta falls while nu is positive: one of the two has the wrong sign")
    if axis == "angular" and (slope > 30.0 or slope < 1.0 / 30.0):
        wrong = "eta" if slope > 1.0 else "nu"
        raise IdentificationError(f"{wrong} is some 57 times too large: convert degrees with numpy.radians")


def saturated(tau: FloatArray, limit: float | None) -> tuple[str, ...]:
    """Return a warning if the actuators were at their limit, where commanded and delivered force differ.

    tau: commanded force or moment; limit: the largest that the actuators can deliver, None if unknown.
    """
    if limit is None:
        return ()
    share = float(np.mean(np.abs(tau) >= limit * (1.0 - 1e-9)))
    if share == 0.0:
        return ()
    return (
        f"actuators saturated in {100.0 * share:.0f} % of the samples (limit {limit:.3g}): use delivered forces, "
        "or repeat with smaller ones",
    )


def require_sign(tau: float, motion: float) -> None:
    """Raise IdentificationError unless a step of force (N, Nm) and the motion it causes (m/s, rad, ...) go one way."""
    if tau == 0.0 or motion == 0.0:
        raise IdentificationError("a step response needs a force and a motion; one of them is zero")
    if tau * motion < 0.0:
        raise IdentificationError("the vessel moves against the force: check the sign of tau or of the axis")
