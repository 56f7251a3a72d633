"""The guard that keeps the hull inside the pool, whatever is demanded."""

from __future__ import annotations

import math

import numpy as np

from marine.allocation import axis_limits
from marine.control.base import Vector3
from marine.frames import rotated
from marine.guidance.abilities import Abilities
from marine.guidance.turn_away import TurnAway
from marine.vessel import Vessel

BRAKE_SHARE = 0.6
"""Part of the force that braking counts on; the rest is for currents, rounding, and a model that errs."""
GAP_M = 0.01
"""The hull stays so far from the wall, and twice the standard deviation of the estimate further."""
REACTION_S = 0.15
"""From the picture to the thrusters' force."""
RATE_1_S = 1.0
"""Closer than deceleration / rate^2 the speed goes out exponentially."""
CATCH_1_S = 2.0
"""How quickly the speed is brought back to what is safe."""
COASTING = 0.05
"""A vessel that cannot push back coasts: down to this part of its speed it counts as stopped."""
_STEPS = 4000
"""Of the table of safe speeds, all alike: a look into it then costs a third of a search."""
ACROSS = 0.1
"""Cosine of the angle to the wall below which a vessel without sway can do nothing about it."""

_Cap = tuple[int, float, float, str]
"""At one wall: axis of {E}, side on which the wall is, largest force towards it in N, name."""


class PoolGuard:
    """Lets a vessel go towards a wall no faster than it can brake before it.

    safe(d): speed from which braking ends within distance d, from alpha v' = -(F + drag(v)), thesis (2.33), with
    BRAKE_SHARE of the weakest force to any side and the smallest drag. The force towards a wall is limited to
    alpha (CATCH (safe(d) - v) - safe'(d) v) + drag(v) - push: a control barrier function, A. D. Ames et al., ECC 2019
    (arXiv 1903.11199), which holds the vessel off against a current, too. Where that asks for braking, everything
    else (along the wall, yaw) gets what thrust is left.
    """

    def __init__(self, vessel: Vessel) -> None:
        X, Y, _, _, _, N = axis_limits(vessel)
        self._limits = (X, Y, N)
        self._margin_m = vessel.radius_m + GAP_M
        pool = vessel.pool
        self._walls = [
            (axis, [(-1.0, 0.0, f"{name} = 0 m"), (1.0, size, f"{name} = {size:g} m")])
            for axis, name, size in ((0, "x", pool.length_x_m), (1, "y", pool.length_y_m))
        ]
        """Of each axis of {E} both walls: on which side, where in m, name."""
        abilities = Abilities(vessel)
        self._astern_n = X if abilities.astern_m_s > 0.0 else 0.0
        steers = not self._astern_n and abilities.ahead_m_s > 0.0 and abilities.turn_rad_s > 0.0
        self._turn = TurnAway(vessel) if steers else None
        model = vessel.model
        dofs = (model.surge, model.sway) if Y else (model.surge,)
        weakest = 1.0 / math.hypot(1.0 / X, 1.0 / Y) if Y else self._astern_n
        self._surge, self._sway = model.surge, model.sway
        slowest = 0.0 if weakest else COASTING * abilities.ahead_m_s
        v = np.linspace(slowest, 3.0 * max(abilities.ahead_m_s, 1e-3), 2000)
        aslant = math.sqrt(0.5) if Y else 1.0  # (v / sqrt 2)^2 on two axes: quadratic drag at 45 degrees
        drag = np.min([dof.beta * v + aslant * dof.beta_quadratic * v * v for dof in dofs], axis=0)
        force = BRAKE_SHARE * weakest + drag
        slowing = np.minimum(force / max(dof.alpha for dof in dofs), RATE_1_S * v) if weakest else force / dofs[0].alpha
        slope = np.full(len(v), RATE_1_S)  # dv/dd
        np.divide(slowing, v, out=slope, where=v > 0.0)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / slope[1:] + 1.0 / slope[:-1]) * np.diff(v))])
        even = np.linspace(0.0, way[-1], _STEPS + 1)
        self._steps_per_m = _STEPS / float(way[-1])
        speeds, slopes = np.interp(even, way, v), np.interp(even, way, slope)
        steps = (speeds[:-1], slopes[:-1], np.diff(speeds), np.diff(slopes))
        self._table: list[list[float]] = np.column_stack(steps).tolist()
        """Safe speed and its slope at each step of the distance, and by how much they grow to the next."""
        self._furthest = float(speeds[-1]), float(slopes[-1])

    def safe(self, distance_m: float) -> tuple[float, float]:
        """Return the largest speed towards a wall in m/s at a distance of the hull, and its slope in 1/s.

        Negative where the hull is too near already.
        """
        if distance_m < 0.0:
            return RATE_1_S * distance_m, RATE_1_S
        steps = distance_m * self._steps_per_m
        if steps >= _STEPS:
            return self._furthest
        i = int(steps)
        speed, slope, faster, steeper = self._table[i]
        return speed + (steps - i) * faster, slope + (steps - i) * steeper

    def kept(
        self, tau: Vector3, eta: Vector3, nu: Vector3, push: Vector3, std_m: tuple[float, float]
    ) -> tuple[Vector3, str]:
        """Return [X Y N] as it may act, and before which wall it was changed (empty: nowhere).

        push: estimated disturbance in {E}; std_m: of the estimated place.
        """
        c, s = math.cos(eta[2]), math.sin(eta[2])
        u, v, r = nu
        velocity = rotated(u, v, c, s)
        surge, sway = self._surge, self._sway
        drag_u, drag_v = surge.drag(u), sway.drag(v)
        caps: list[_Cap] = []
        for axis, both in self._walls:
            ahead, aside = (s, c) if axis else (c, -s)  # the axis in {B}
            alpha = surge.alpha * ahead * ahead + sway.alpha * aside * aside
            turned = r * (aside * u - ahead * v)  # (2.33) has no Coriolis force: the velocity turns with the vessel
            along = drag_u * ahead + drag_v * aside - alpha * turned - push[axis]
            place, moving, margin = eta[axis], velocity[axis], self._margin_m + 2.0 * std_m[axis]
            for side, wall, name in both:
                speed, room = side * moving, side * (wall - place) - margin
                safe, slope = self.safe(room - REACTION_S * speed if speed > 0.0 else room)
                most = alpha * (CATCH_1_S * (safe - speed) - slope * speed) + side * along
                caps.append((axis, side, most, name))
        kept, walls = (self._to_all_sides if self._limits[1] else self._ahead_and_astern)(tau, c, s, caps)
        if self._turn:
            kept, turned = self._turn.kept(kept, eta, nu, self._margin_m + 2.0 * max(std_m))
            if turned:
                return kept, "before a wall: turning away"
        return kept, f"before the wall at {' and '.join(walls)}" if walls else ""

    def _to_all_sides(self, tau: Vector3, c: float, s: float, caps: list[_Cap]) -> tuple[Vector3, list[str]]:
        X, Y, N = tau
        force, brake, walls = list(rotated(X, Y, c, s)), [0.0, 0.0], []
        for axis, side, most, name in caps:
            if side * force[axis] <= most:
                continue
            walls.append(name)
            force[axis] = side * most
            if most < 0.0:
                force[axis], brake[axis] = 0.0, side * most
        if not walls:
            return tau, walls
        rest = (*rotated(force[0], force[1], c, -s), N)
        first = (*rotated(brake[0], brake[1], c, -s), 0.0)
        share = self._share(first)
        if share == 0.0:
            return rest, walls
        left = 0.0 if share >= 1.0 else min(1.0, (1.0 - share) / max(self._share(rest), 1e-12))
        X, Y, N = (b / max(1.0, share) + left * r for b, r in zip(first, rest, strict=True))
        return (X, Y, N), walls

    def _share(self, tau: Vector3) -> float:
        """Return which part of the actuators a wrench takes at most: the limits of single axes span their hull."""
        return sum(abs(t) / limit for t, limit in zip(tau, self._limits, strict=True) if limit)

    def _ahead_and_astern(self, tau: Vector3, c: float, s: float, caps: list[_Cap]) -> tuple[Vector3, list[str]]:
        X, walls = tau[0], []
        for axis, side, most, name in caps:
            ahead = side * (s if axis else c)
            if abs(ahead) < ACROSS or X * ahead <= most:
                continue
            walls.append(name)
            X = max(-self._astern_n, min(self._limits[0], most / ahead))
        braking = walls and X * tau[0] <= 0.0 and self._astern_n
        turn = max(0.0, 1.0 - abs(X) / self._limits[0]) if braking else 1.0
        return (X, tau[1], turn * tau[2]), walls
