"""Allocation of one vessel: from a wrench to one command per actuator, and what the commands give."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from marine.actuators import Drive, ThrustCurve
from marine.actuators.rudder import linear_force
from marine.allocation.bounded import DEFAULT_PRIORITY, Allocation
from marine.allocation.geometry import Array, Wrench, allocation_matrix, axis_indices
from marine.allocation.rounding import CarriedRounding
from marine.allocation.steering import Steering
from marine.vessel import AXES, Actuator, QuadraticThrust, Rudder, Thruster, Vessel

_X, _N = 0, 5


Answer = tuple[list[float], Wrench]
"""Commands for all actuators in the order of the vessel file, and the wrench before rounding, N and Nm."""


class FixedActuators:
    """A vessel whose actuators push along fixed directions: thrusters and direct commands."""

    def __init__(
        self,
        vessel: Vessel,
        *,
        priority: Mapping[int, float] = DEFAULT_PRIORITY,
        failed: Collection[str] = (),
        keep_direction: bool = False,
    ) -> None:
        """priority: see Allocation; failed: names of actuators. Raise ValueError when nothing is left to control."""
        self.actuators = [a for a in vessel.actuators if not isinstance(a, Rudder)]
        self._drives = [Drive(a) for a in self.actuators]
        lower, upper = limits(self._drives)
        self.allocation = Allocation(
            allocation_matrix(self.actuators),
            lower,
            upper,
            axes=axis_indices(vessel.controlled),
            priority=priority,
            failed=[i for i, a in enumerate(self.actuators) if a.name in failed],
            keep_direction=keep_direction,
        )
        self.axes = self.allocation.axes
        """Components of the wrench that are controlled, as rows of [X Y Z K M N]."""
        self.rank = self.allocation.rank
        self.reach = self.allocation.reach
        """What all actuators together could do on each of the six axes; 0.0 where none acts."""
        self.acting = tuple(axis for axis, reach in enumerate(self.reach) if reach > 0.0)
        """Components on which any actuator acts, controlled or not."""
        self._rates = [a.rate_per_s for a in self.actuators]
        self._rate_limited = any(rate is not None for rate in self._rates)
        self._moving = any(drive.at(1.0) is not drive for drive in self._drives)
        self._before = [0.0] * len(self._drives)
        self._rounding = CarriedRounding(self._drives)

    def solve(self, tau: Sequence[float], U: float = 0.0, dt_s: float = math.inf, *, carry: bool = False) -> Answer:
        """Return commands for a wrench [X Y Z K M N] in N and Nm at speed U in m/s, dt_s after the call before.

        carry: whole commands make up for the rounding errors before them (see CarriedRounding): for closed loops. No
        wrench is no command at once, whatever is owed.
        """
        if carry and not (self._moving or self._rate_limited) and any(tau):
            thrusts, attained = self.allocation.solve(tau)
            return self._rounding.commands(thrusts, dt_s), attained
        self._rounding.forget()
        drives = self._at(U)
        narrowed = self._narrowed(drives, dt_s) if self._moving or self._rate_limited else None
        thrusts, attained = self.allocation.solve(tau, narrowed)
        if self._rate_limited:
            self._before = [d.curve.command(t) for d, t in zip(drives, thrusts, strict=True)]
        commands = [d.command(t) for d, t in zip(drives, thrusts, strict=True)]
        return commands, attained

    def _narrowed(self, drives: Sequence[Drive], dt_s: float) -> tuple[list[float], list[float]]:
        """Return thrust limits of this moment: a command's rate is limited where its thrust can be at its next call."""
        lower, upper = [d.lower for d in drives], [d.upper for d in drives]
        for i, (rate, before) in enumerate(zip(self._rates, self._before, strict=True)):
            if rate is not None and dt_s < math.inf:
                step = rate * max(0.0, dt_s)
                lower[i] = max(lower[i], min(upper[i], drives[i].curve.thrust(before - step)))
                upper[i] = min(upper[i], max(lower[i], drives[i].curve.thrust(before + step)))
        return lower, upper

    def stop(self) -> list[float]:
        """Return the commands that stop everything, at once whatever the rates."""
        self._before = [0.0] * len(self._drives)
        return [0.0] * len(self._drives)

    def delivered(self, commands: Sequence[float], U: float = 0.0) -> Wrench:
        """Return the wrench that commands give at speed U in m/s, rounding and dead zone included."""
        return self.allocation.wrench(map(Drive.thrust, self._at(U), commands))

    def _at(self, U: float) -> list[Drive]:
        return [drive.at(U) for drive in self._drives] if self._moving else self._drives

    def axis_limits(self) -> Wrench:
        """See the function `axis_limits`."""
        limits = [0.0] * len(AXES)
        for row, axis in enumerate(self.axes):
            unit = np.zeros(len(self.axes))
            unit[row] = 2.0 * self.reach[axis]
            ways = [2.0 * self.reach[axis] * self.allocation.attainable.scaled(sign * unit) for sign in (1.0, -1.0)]
            limits[axis] = min(ways) or max(ways)
        X, Y, Z, K, M, N = limits
        return X, Y, Z, K, M, N


class SteeredPropellers:
    """Propellers with rudders in their flow, thesis Table 2.2(f), (2.36): all turn alike, rudders have one angle."""

    def __init__(
        self, vessel: Vessel, *, priority: Mapping[int, float] = DEFAULT_PRIORITY, failed: Collection[str] = ()
    ) -> None:
        """Raise ValueError for other actuators than these, or when no propeller or no rudder is left."""
        self._actuators = vessel.actuators
        self._propellers = [a for a in vessel.actuators if isinstance(a, Thruster)]
        rudders = [a for a in vessel.actuators if isinstance(a, Rudder)]
        if len(self._propellers) + len(rudders) < len(vessel.actuators):
            raise ValueError(f"{vessel.name}: rudders are allocated together with propellers only")
        working = [p for p in self._propellers if p.name not in failed]
        steering = [r for r in rudders if r.name not in failed and r.behind not in failed]
        if not working or not steering:
            raise ValueError(f"{vessel.name}: no propeller with a rudder is left")
        k_t = sum(_k_t(p) for p in working)
        n_max, n_min = min(p.n_max for p in working), max(p.lowest for p in working)
        self._curve = ThrustCurve.quadratic(k_t)
        self._steering = Steering(
            self._curve.thrust(n_min),
            self._curve.thrust(n_max),
            k_flow=sum(r.k_r1 for r in steering),
            k_wash=sum(r.k_r2 for r in steering) / k_t,
            lever_m=-sum(r.x_m for r in steering) / len(steering),
            delta_max=min(min(r.n_max, -r.lowest) for r in steering),
        )
        self._drives = {p.name: Drive(p) for p in self._propellers}
        self._failed = frozenset(failed)
        self._rudder_rate, self._propeller_rate = _slowest(steering), _slowest(working)
        self._n = self._delta = 0.0
        self._yaw_priority = priority.get(_N, 1.0)
        self.axes = (_X, _N)
        self.acting = (_X, 1, _N)
        self.rank = 2
        self.reach = list(self.axis_limits())

    def solve(self, tau: Sequence[float], U: float = 0.0, dt_s: float = math.inf, *, carry: bool = False) -> Answer:
        """Return commands for X in N and N in Nm of a wrench [X Y Z K M N] at speed U in m/s; carry changes nothing."""
        turn, spin = _step(self._rudder_rate, dt_s), _step(self._propeller_rate, dt_s)
        angles = self._delta - turn, self._delta + turn
        thrust, self._delta = self._steering.solve(tau[_X], tau[_N], U, yaw_priority=self._yaw_priority, angles=angles)
        self._n = max(self._n - spin, min(self._n + spin, self._curve.command(thrust)))
        commands = [self._command(a, self._n, self._delta) for a in self._actuators]
        X, Y, N = self._steering.forces(self._curve.thrust(self._n), self._delta, U)
        return commands, (X, Y, 0.0, 0.0, 0.0, N)

    def _command(self, actuator: Actuator, n: float, delta: float) -> float:
        if isinstance(actuator, Rudder):
            return 0.0 if actuator.name in self._failed else delta
        assert isinstance(actuator, Thruster)
        drive = self._drives[actuator.name]
        return 0.0 if actuator.name in self._failed else drive.command(drive.curve.thrust(n))

    def stop(self) -> list[float]:
        """Return the commands that stop everything."""
        self._n = self._delta = 0.0
        return [0.0] * len(self._actuators)

    def delivered(self, commands: Sequence[float], U: float = 0.0) -> Wrench:
        """Return the wrench that commands give at speed U in m/s."""
        total = np.zeros(len(AXES))
        turning = {a.name: n for a, n in zip(self._actuators, commands, strict=True)}
        for actuator, command in zip(self._actuators, commands, strict=True):
            if isinstance(actuator, Thruster):
                total += self._drives[actuator.name].thrust(command) * np.array(actuator.column)
            elif isinstance(actuator, Rudder):
                force = linear_force(command, max(0.0, turning[actuator.behind]), U, actuator.k_r1, actuator.k_r2)
                total += force * np.array(rudder_column(actuator, command))
        X, Y, Z, K, M, N = total.tolist()
        return X, Y, Z, K, M, N

    def axis_limits(self) -> Wrench:
        """See the function `axis_limits`; yaw is that of full thrust ahead at rest."""
        full = self._steering
        yaw = abs(full.forces(full.upper, full.delta_max, 0.0)[2])
        return (min(full.upper, -full.lower) or full.upper), 0.0, 0.0, 0.0, 0.0, yaw


VesselAllocation = FixedActuators | SteeredPropellers


def rudder_column(rudder: Rudder, delta: float) -> Wrench:
    """Return the wrench of 1 N normal to a rudder at an angle in rad, thesis Table 2.2(f), (2.35)."""
    a, b = -math.sin(delta), -math.cos(delta)
    return a, b, 0.0, 0.0, 0.0, rudder.x_m * b - rudder.y_m * a


def vessel_allocation(
    vessel: Vessel,
    *,
    priority: Mapping[int, float] = DEFAULT_PRIORITY,
    failed: Collection[str] = (),
    keep_direction: bool = False,
) -> VesselAllocation:
    """Return the allocation of a vessel's actuators; raise ValueError when the actuators left cannot control it."""
    if any(isinstance(a, Rudder) for a in vessel.actuators):
        return SteeredPropellers(vessel, priority=priority, failed=failed)
    return FixedActuators(vessel, priority=priority, failed=failed, keep_direction=keep_direction)


def axis_limits(vessel: Vessel) -> Wrench:
    """Return the largest force or moment on each axis alone, [X Y Z K M N] in N and Nm; 0.0 where there is none.

    Alone means with zeros on the other controlled axes. It holds in both directions, but for what pushes one way only
    (a throttle).
    """
    return vessel_allocation(vessel).axis_limits()


def limits(drives: Sequence[Drive]) -> tuple[Array, Array]:
    """Return the thrusts in N at the most negative and the largest commands."""
    return np.array([d.lower for d in drives]), np.array([d.upper for d in drives])


def _slowest(actuators: Sequence[Actuator]) -> float:
    return min((a.rate_per_s for a in actuators if a.rate_per_s is not None), default=math.inf)


def _step(rate_per_s: float, dt_s: float) -> float:
    return math.inf if math.inf in (rate_per_s, dt_s) else rate_per_s * max(0.0, dt_s)


def _k_t(propeller: Thruster) -> float:
    if not isinstance(propeller.characteristic, QuadraticThrust):
        raise ValueError(f"{propeller.name}: a propeller before a rudder needs a purely quadratic characteristic")
    return propeller.k_t
