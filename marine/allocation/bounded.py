"""Bounded least squares: which thrust of each actuator gives a demanded wrench, or as much of it as there is.

thesis 2.2 and 8.1; axes are numbered as in [X, Y, Z, K, M, N].
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from operator import itemgetter, le, mul

import daqp
import numpy as np

from marine.allocation.attainable_set import AttainableSet
from marine.allocation.geometry import Array, Wrench, rank
from marine.vessel import AXES

DEFAULT_PRIORITY: Mapping[int, float] = {5: 10.0}
"""Weights of the axes, each relative to what the vessel can do there; 1 where not named. Yaw: heading first."""

REGULARISATION = 1e-4
"""Pull towards the smallest thrusts that would do without limits; decides only what the wrench leaves open."""

_TOLERANCE = 1e-11
_ENDLESS = 1e3  # times the reach: larger demands are cut here, where the answer has long stopped changing


class Allocation:
    """min |W (B t - tau)|^2 + eps |(t - t0) / T|^2 with lower <= t <= upper, over the axes that the vessel controls.

    W weights each axis relative to what the limits allow on it, by priority; T is the largest thrust of each
    actuator; t0 = B^+ tau, the pseudo-inverse of thesis 8.1 weighted by T, is the answer while no limit is met,
    exactly.
    """

    def __init__(
        self,
        B: Array,
        lower: Array,
        upper: Array,
        *,
        axes: Sequence[int] = tuple(range(len(AXES))),
        priority: Mapping[int, float] = DEFAULT_PRIORITY,
        failed: Collection[int] = (),
        keep_direction: bool = False,
    ) -> None:
        """Precompute all that does not depend on the demand.

        B: 6 x n, the wrench of one newton of each actuator; lower <= 0 <= upper: thrusts in N, n; axes: the
        components to control; failed: columns that give nothing; keep_direction: a wrench beyond the limits is first
        made smaller as a whole, instead of giving up the axes of low priority. Raise ValueError when zero thrust is
        not allowed, an actuator has no thrust at all, or nothing is left that acts on these axes.
        """
        if np.any(lower > 0.0) or np.any(upper < 0.0) or np.any(np.maximum(upper, -lower) <= 0.0):
            raise ValueError("limits of an actuator must enclose zero, and one of them differ from it")
        self.working = [i for i in range(B.shape[1]) if i not in failed]
        """Columns that take part."""
        self._size = B.shape[1]
        self._columns: list[list[float]] = B.T.tolist()
        self._lower: list[float] = lower[self.working].tolist()
        self._upper: list[float] = upper[self.working].tolist()
        scale = np.maximum(upper, -lower)[self.working]
        self.thrust_scale = scale
        self._scale: list[float] = scale.tolist()
        matrix = B[:, self.working]
        reach = np.abs(matrix) @ scale
        reach[reach < 1e-9 * reach.max()] = 0.0  # nothing but rounding acts on this axis
        self.reach: list[float] = reach.tolist()
        """What all actuators together could do on each of the six axes, N and Nm; 0.0 where none acts."""
        self.axes = tuple(axis for axis in axes if reach[axis] > 0.0)
        """Controlled axes on which something acts."""
        if not self.axes:
            raise ValueError("no working actuator acts on any controlled axis")
        self._of_axes: Callable[[Sequence[float]], Sequence[float]] = (
            itemgetter(*self.axes) if len(self.axes) > 1 else lambda tau: (tau[self.axes[0]],)
        )
        self._most = _ENDLESS * reach[list(self.axes)]
        self._endless = float(self._most.min())
        self._demand = np.zeros(len(self.axes))
        weights = np.array([priority.get(axis, 1.0) / reach[axis] for axis in self.axes])
        self.weights = weights
        controlled = matrix[list(self.axes)]
        self.rank = rank(controlled)
        """Number of axes that can be controlled independently."""
        self.attainable = AttainableSet(controlled, lower[self.working], upper[self.working])
        """What the working actuators can do on `axes`."""
        self._keep_direction = keep_direction
        self._prepare(controlled, scale, weights, matrix)

    def _prepare(self, B: Array, scale: Array, weights: Array, matrix: Array) -> None:
        A = weights[:, None] * B * scale
        preferred = np.linalg.pinv(B * scale)  # t0 / T of each unit demand
        linear = -(A.T * weights + REGULARISATION * preferred)
        hessian = A.T @ A + REGULARISATION * np.eye(len(scale))
        full = self.rank == len(self.axes)
        free = preferred if full else -np.linalg.solve(hessian, linear)
        thrusts = scale[:, None] * free
        self._free = np.vstack([thrusts, matrix @ thrusts])
        """Of a demand: the thrusts without limits, and the wrench that they give."""
        self._parts = matrix * scale
        """The wrench of thrusts in units of `thrust_scale`."""
        self._linear = linear
        self._solver = daqp.Model()
        self._bounds = np.array(self._upper) / scale, np.array(self._lower) / scale
        self._solver.setup(hessian, np.zeros(len(scale)), np.zeros((0, len(scale))), *self._bounds)
        self._solver.settings = {"primal_tol": _TOLERANCE}
        self._narrowed = False

    def solve(
        self, tau: Sequence[float], limits: tuple[Sequence[float], Sequence[float]] | None = None
    ) -> tuple[list[float], Wrench]:
        """Return the thrust of each actuator in N for a demanded wrench [X Y Z K M N] in N and Nm, and what they give.

        limits: narrower (lower, upper) thrusts of this moment for all n actuators, from a limit on their rate; zero
        need not lie between them.
        """
        self._demand[:] = demand = self._of_axes(tau)
        *thrusts, X, Y, Z, K, M, N = self._free.dot(self._demand).tolist()
        lower, upper = self._lower, self._upper
        if limits is not None:
            lower = [max(low, limits[0][i]) for low, i in zip(lower, self.working, strict=True)]
            upper = [min(high, limits[1][i]) for high, i in zip(upper, self.working, strict=True)]
        if not (all(map(le, lower, thrusts)) and all(map(le, thrusts, upper))):
            if max(map(abs, demand)) > self._endless:
                np.clip(self._demand, -self._most, self._most, out=self._demand)
            parts = self._solve_bounded(None if limits is None else (lower, upper))
            thrusts = list(map(mul, parts.tolist(), self._scale))
            X, Y, Z, K, M, N = self._parts.dot(parts).tolist()
        if len(thrusts) < self._size:
            every = [0.0] * self._size
            for i, thrust in zip(self.working, thrusts, strict=True):
                every[i] = thrust
            thrusts = every
        return thrusts, (X, Y, Z, K, M, N)

    def _solve_bounded(self, limits: tuple[list[float], list[float]] | None) -> Array:
        """Return the thrusts of the working actuators in units of `thrust_scale`."""
        linear = self._linear.dot(self._demand)
        if self._keep_direction:
            linear = linear * self.attainable.scaled(self._demand)
        if limits is not None:
            self._solver.update(f=linear, bupper=limits[1] / self.thrust_scale, blower=limits[0] / self.thrust_scale)
            self._narrowed = True
        elif self._narrowed:
            self._solver.update(f=linear, bupper=self._bounds[0], blower=self._bounds[1])
            self._narrowed = False
        else:
            self._solver.update(f=linear)
        parts, _, exit_flag, _ = self._solver.solve()
        if exit_flag < 1:
            raise ArithmeticError(f"allocation of {self._demand.tolist()} failed: daqp exit flag {exit_flag}")
        return np.asarray(parts)

    def wrench(self, thrusts: Iterable[float]) -> Wrench:
        """Return B t, [X Y Z K M N] in N and Nm: what thrusts in N of all n actuators do together."""
        X = Y = Z = K = M = N = 0.0
        for thrust, (x, y, z, k, m, n) in zip(thrusts, self._columns, strict=True):
            X += x * thrust
            Y += y * thrust
            Z += z * thrust
            K += k * thrust
            M += m * thrust
            N += n * thrust
        return X, Y, Z, K, M, N
