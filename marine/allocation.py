"""Control allocation: which thrust of each actuator gives a demanded wrench [X Y N] within the limits.

thesis 2.2 and 8.1 (corrected: see docs/errata.md; the yaw row printed in pladypos (2) is singular, so the matrix is
derived from positions and angles).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul

import daqp
import numpy as np
from numpy.typing import NDArray

from marine.actuators import max_thrust
from marine.vessel import Thruster, Vessel

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]

YAW_PRIORITY = 10.0
"""Weight of the yaw moment against surge and sway, each relative to what the vessel can do: heading first."""

REGULARISATION = 1e-4
"""Pull towards the smallest thrusts that would do without limits; decides only what the wrench leaves open."""

_EQUALITY = 5  # daqp's sense of a constraint
_TOLERANCE = 1e-11
_ENDLESS = 1e3  # times the reach: larger demands are cut here, where the answer has long stopped changing


def allocation_matrix(thrusters: Sequence[Thruster]) -> Array:
    """Return B, 3 x n, of tau = B t: column i is [cos g, sin g, x sin g - y cos g] for thrust at angle g."""
    return np.array(
        [
            [math.cos(t.angle_rad) for t in thrusters],
            [math.sin(t.angle_rad) for t in thrusters],
            [t.x_m * math.sin(t.angle_rad) - t.y_m * math.cos(t.angle_rad) for t in thrusters],
        ]
    )


class Allocation:
    """Bounded least squares: min |W (B t - tau)|^2 + eps |(t - t0) / T|^2 with lower <= t <= upper.

    W weights each axis relative to what the limits allow on it, yaw more than the others; T is the largest thrust of
    each actuator; t0 = B^+ tau, the pseudo-inverse of thesis 8.1, is the answer while no limit is met, exactly.
    """

    def __init__(self, B: Array, lower: Array, upper: Array) -> None:
        """Precompute all that does not depend on the demand.

        B: 3 x n; lower <= 0 <= upper: thrusts in N, n. Raise ValueError when zero thrust is not allowed or an
        actuator has no thrust at all.
        """
        self.thrust_scale = np.maximum(upper, -lower)
        if np.any(lower > 0.0) or np.any(upper < 0.0) or np.any(self.thrust_scale <= 0.0):
            raise ValueError("limits of an actuator must enclose zero, and one of them differ from it")
        scale = self.thrust_scale
        reach = np.abs(B) @ scale
        reach[reach < 1e-9 * reach.max()] = 0.0  # nothing acts on this axis
        self.reach: Vector3 = tuple(reach.tolist())
        """What all actuators together could do on each axis, N and Nm; 0.0 where none acts."""
        self.weights = np.divide([1.0, 1.0, YAW_PRIORITY], reach, out=np.zeros(3), where=reach > 0.0)
        self._B: list[list[float]] = B.tolist()
        A = self.weights[:, None] * B * scale
        preferred = np.linalg.pinv(B * scale)  # t0 / T of each unit demand
        self._linear = -(A.T * self.weights + REGULARISATION * preferred)
        self._solver = daqp.Model()
        n = len(scale)
        hessian = A.T @ A + REGULARISATION * np.eye(n)
        self._solver.setup(hessian, np.zeros(n), np.zeros((0, n)), upper / scale, lower / scale)
        self._solver.settings = {"primal_tol": _TOLERANCE}

    def solve(self, X: float, Y: float, N: float) -> list[float]:
        """Return the thrust of each actuator in N for a demanded wrench in N and Nm."""
        demand = [max(-_ENDLESS * r, min(_ENDLESS * r, d)) for r, d in zip(self.reach, (X, Y, N), strict=True)]
        self._solver.update(f=self._linear @ demand)
        part, _, exit_flag, _ = self._solver.solve()
        if exit_flag < 1:
            raise ArithmeticError(f"allocation of [{X}, {Y}, {N}] failed: daqp exit flag {exit_flag}")
        thrusts: list[float] = (part * self.thrust_scale).tolist()
        return thrusts

    def wrench(self, thrusts: Sequence[float]) -> Vector3:
        """Return B t: what thrusts in N do together, [X, Y, N] in N and Nm."""
        surge, sway, yaw = (sum(map(mul, row, thrusts)) for row in self._B)
        return surge, sway, yaw


def vessel_allocation(vessel: Vessel) -> Allocation:
    """Return the allocation of a vessel's thrusters."""
    limit = np.array([max_thrust(t) for t in vessel.thrusters])
    return Allocation(allocation_matrix(vessel.thrusters), -limit, limit)


def axis_limits(vessel: Vessel) -> tuple[float, float, float, float, float, float]:
    """Return the largest force or moment on each axis alone, [X, Y, Z, K, M, N] in N and Nm; 0.0 where none.

    Alone means with zeros on the other axes. It holds in both directions.
    """
    B = allocation_matrix(vessel.thrusters)
    limit = np.array([max_thrust(t) for t in vessel.thrusters])
    surge, sway, yaw = (attainable(B, -limit, limit, row) for row in range(3))
    return surge, sway, 0.0, 0.0, 0.0, yaw


def attainable(B: Array, lower: Array, upper: Array, axis: int) -> float:
    """Return the largest force on one axis (row of B) that is possible both ways with zeros on the others."""
    others = np.delete(B, axis, axis=0)
    zeros = np.zeros(len(others))
    sense = np.array([0] * B.shape[1] + [_EQUALITY] * len(others), dtype=np.int32)
    largest = math.inf
    for sign in (1.0, -1.0):
        bounds = np.concatenate([upper, zeros]), np.concatenate([lower, zeros])
        thrusts, _, exit_flag, _ = daqp.solve(None, -sign * B[axis], others, *bounds, sense, primal_tol=_TOLERANCE)
        if exit_flag < 1:
            raise ArithmeticError(f"no largest force on axis {axis}: daqp exit flag {exit_flag}")
        largest = min(largest, sign * float(B[axis] @ thrusts))
    return max(0.0, largest)
