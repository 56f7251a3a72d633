"""A reference that the vessel can follow: a step becomes a motion with limited speed and acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass

from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom, HorizontalModel

Vector3 = tuple[float, float, float]

SMOOTHING = 0.5
"""Lag of the reference, in units of the time constant of its approach."""
REST = 1e-10
"""Nearer to its target (m, rad) and slower (m/s, rad/s) than this a motion has ended."""


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the motion and 1/s of its end: closer than acceleration / rate^2 it goes out exponentially."""

    speed_m_s: float
    acceleration_m_s2: float
    yaw_rate_rad_s: float
    yaw_acceleration_rad_s2: float
    approach_1_s: float

    @classmethod
    def of_vessel(cls, model: HorizontalModel, limits: Vector3, share: float, approach_1_s: float) -> MotionLimits:
        """Return what takes no more than a share of the actuators, for acceleration and for drag.

        limits: largest |X|, |Y|, |N|. What an axis without actuators could do does not count.
        """
        linear = [(dof, limit) for dof, limit in zip((model.surge, model.sway), limits[:2], strict=True) if limit > 0.0]
        forces = [(dof, share * limit) for dof, limit in linear] or [(model.surge, 1e-3)]
        N = share * limits[2] if limits[2] > 0.0 else 1e-3
        return cls(
            speed_m_s=min(terminal_speed(dof, force) for dof, force in forces),
            acceleration_m_s2=min(force / dof.alpha for dof, force in forces),
            yaw_rate_rad_s=terminal_speed(model.yaw, N),
            yaw_acceleration_rad_s2=N / model.yaw.alpha,
            approach_1_s=approach_1_s,
        )


def terminal_speed(dof: DegreeOfFreedom, tau: float) -> float:
    """Return the speed at which the drag equals tau (N or Nm), from (2.33), (2.34); infinite without drag."""
    b, c = dof.beta, dof.beta_quadratic
    if c == 0.0:
        return tau / b if b > 0.0 else math.inf
    return (math.sqrt(b * b + 4.0 * c * tau) - b) / (2.0 * c)


class ReferenceFilter:
    """Moves `eta` to a target on the straight line, the heading the short way round, both within `MotionLimits`.

    The wanted speed at distance d is k d near the target and sqrt(2 a (d - a / (2 k^2))) further away: the speed
    from which deceleration a ends there. The change of velocity is limited by a, as a vector, and when it gets faster
    by what drag leaves of a: force for both at once is never needed. What comes of that goes through a lag of
    SMOOTHING / k, which bounds the jerk. Whatever the target does meanwhile, |rate| and |acceleration| stay within the
    limits, and a target at rest is not overshot from rest.
    """

    def __init__(self, limits: MotionLimits) -> None:
        """Raise ValueError unless all limits are positive."""
        if min(vars(limits).values()) <= 0.0:
            raise ValueError(f"limits of a reference filter must be positive: {limits}")
        self.limits = limits
        self.eta: Vector3 = (0.0, 0.0, 0.0)
        """[x y psi] in {E}, m and rad."""
        self.rate: Vector3 = (0.0, 0.0, 0.0)
        self.acceleration: Vector3 = (0.0, 0.0, 0.0)
        self._lead: Vector3 = (0.0, 0.0, 0.0)
        """How far the motion before the lag is ahead of `eta`."""
        self._lead_rate: Vector3 = (0.0, 0.0, 0.0)
        self._rests_on: Vector3 | None = None
        """The target that the motion has ended at."""

    def start(self, eta: Vector3, rate: Vector3) -> None:
        """Begin at a pose with a rate in {E}, which is cut to the limits."""
        limits = self.limits
        speed = math.hypot(rate[0], rate[1])
        cut = min(1.0, limits.speed_m_s / speed) if speed > 0.0 else 1.0
        r = max(-limits.yaw_rate_rad_s, min(limits.yaw_rate_rad_s, rate[2]))
        self.eta, self.rate, self.acceleration = eta, (rate[0] * cut, rate[1] * cut, r), (0.0, 0.0, 0.0)
        lag = SMOOTHING / limits.approach_1_s
        self._lead = (self.rate[0] * lag, self.rate[1] * lag, r * lag)
        self._lead_rate = self.rate
        self._rests_on = None

    def step(self, dt_s: float, target: Vector3) -> None:
        """Move on by dt_s towards a target pose."""
        if dt_s <= 0.0 or target == self._rests_on:
            return
        (x, y, psi), (lead_x, lead_y, lead_psi), (to_x, to_y, to_psi) = self.eta, self._lead, target
        to_x, to_y, to_psi = to_go = (to_x - x - lead_x, to_y - y - lead_y, wrap_angle(to_psi - psi - lead_psi))
        self._lead_rate = ahead_x, ahead_y, ahead_psi = self._changed(dt_s, to_go, self._lead_rate)
        # The lag by backward differences: what is left of the lead after it, over the lag, is the rate.
        share = dt_s / (dt_s + SMOOTHING / self.limits.approach_1_s)
        lead_x += ahead_x * dt_s
        lead_y += ahead_y * dt_s
        lead_psi += ahead_psi * dt_s
        dx, dy, dpsi = share * lead_x, share * lead_y, share * lead_psi
        self._lead = (lead_x - dx, lead_y - dy, lead_psi - dpsi)
        self.eta = (x + dx, y + dy, wrap_angle(psi + dpsi))
        before_x, before_y, before_r = self.rate
        self.rate = x_dot, y_dot, r = dx / dt_s, dy / dt_s, dpsi / dt_s
        self.acceleration = ((x_dot - before_x) / dt_s, (y_dot - before_y) / dt_s, (r - before_r) / dt_s)
        if abs(to_x) < REST and abs(to_y) < REST and abs(to_psi) < REST:
            self._come_to_rest(target)

    def _come_to_rest(self, target: Vector3) -> None:
        """End the motion if it is as slow as it is near: from then on there is nothing to move."""
        if math.hypot(*self.rate, *self._lead_rate) < REST:
            x, y, psi = self._rests_on = target
            self.eta = (x, y, wrap_angle(psi))
            self.rate = self.acceleration = self._lead = self._lead_rate = (0.0, 0.0, 0.0)

    def _changed(self, dt_s: float, to_go: Vector3, rate: Vector3) -> Vector3:
        """Return the rate a step later, of the motion before the lag."""
        limits, (x_dot, y_dot, r), (to_x, to_y, to_psi) = self.limits, rate, to_go
        k = limits.approach_1_s if limits.approach_1_s * dt_s < 1.0 else 1.0 / dt_s
        distance = math.hypot(to_x, to_y)
        speed = _approach_speed(distance, k, limits.acceleration_m_s2, limits.speed_m_s)
        towards = speed / distance if distance > 0.0 else 0.0
        change_x, change_y = to_x * towards - x_dot, to_y * towards - y_dot
        slower = change_x * x_dot + change_y * y_dot <= 0.0
        most = dt_s * limits.acceleration_m_s2 * (1.0 if slower else _left(math.hypot(x_dot, y_dot), limits.speed_m_s))
        change = math.hypot(change_x, change_y)
        if change > most:
            change_x, change_y = change_x * most / change, change_y * most / change
        yaw_rate = _approach_speed(abs(to_psi), k, limits.yaw_acceleration_rad_s2, limits.yaw_rate_rad_s)
        change_r = math.copysign(yaw_rate, to_psi) - r
        most = dt_s * limits.yaw_acceleration_rad_s2 * (1.0 if change_r * r <= 0.0 else _left(r, limits.yaw_rate_rad_s))
        if abs(change_r) > most:
            change_r = math.copysign(most, change_r)
        return x_dot + change_x, y_dot + change_y, r + change_r


def _left(speed: float, most: float) -> float:
    """Return the part of the acceleration that is left at a speed, when linear drag takes all of it at the limit."""
    part = speed / most
    return 1.0 - part * part if abs(part) < 1.0 else 0.0


def _approach_speed(distance: float, k: float, a: float, most: float) -> float:
    """Return the largest speed from which the motion ends at the distance with deceleration a, at most `most`."""
    straight = a / (k * k)
    speed = k * distance if distance <= straight else math.sqrt(2.0 * a * (distance - 0.5 * straight))
    return speed if speed < most else most
