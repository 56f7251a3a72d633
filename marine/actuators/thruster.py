"""A thruster, or a command that goes straight into the model, as it is driven: limits, dead zone, whole commands.

thesis 2.1 and 3.1; the curves themselves are in marine.actuators.curve.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left

from marine.actuators.curve import Side, ThrustCurve
from marine.vessel import (
    COMMAND_DIGITS,
    AffineThrust,
    AsymmetricThrust,
    BilinearThrust,
    Characteristic,
    Direct,
    QuadraticLinearThrust,
    QuadraticThrust,
    Thruster,
)

_STEP = 10.0**-COMMAND_DIGITS


def curve_of(characteristic: Characteristic, U: float = 0.0) -> ThrustCurve:
    """Return the static curve of a characteristic at the vessel's speed U in m/s, which matters for (2.4) only."""
    match characteristic:
        case QuadraticThrust(k_t):
            return ThrustCurve.quadratic(k_t)
        case AffineThrust(a, b):
            return ThrustCurve.affine(a, b)
        case AsymmetricThrust(a_f, b_f, a_b, b_b):
            return ThrustCurve.asymmetric(a_f, b_f, a_b, b_b)
        case QuadraticLinearThrust(k_t, knee, slope):
            side = Side(k_t, 0.0, knee, slope)
            return ThrustCurve(side, side)
        case BilinearThrust(t_nn=t_nn, t_nu=t_nu, wake=wake):
            return ThrustCurve.bilinear(t_nn, t_nu, (1.0 - wake) * U)


class Drive:
    """Commands into thrust and back, for one actuator at one speed of the vessel."""

    def __init__(self, actuator: Thruster | Direct, U: float = 0.0) -> None:
        self.actuator = actuator
        if isinstance(actuator, Direct):
            self.curve = ThrustCurve.affine(0.0, actuator.gain)
        else:
            self.curve = curve_of(actuator.characteristic, U)
        self._feels_flow = isinstance(actuator, Thruster) and isinstance(actuator.characteristic, BilinearThrust)
        self._n_min, self._n_max = actuator.lowest, actuator.n_max
        self._dead_zone, self._integer = actuator.dead_zone, actuator.integer
        self._forward, self._backward = self.curve.forward, self.curve.backward
        self._thrusts: dict[float, float] = {}
        self.whole, self.between = self._whole_commands() if self._integer else ([], [])
        """Whole commands that do something, with zero, and the thrusts in N halfway between neighbours."""
        self._thrusts = {n: self.thrust(n) for n in self.whole}  # asked for with every command
        self.lower = min(0.0, self.thrust(self._n_min))
        """Thrust in N (a direct command: its force or moment) at the most negative command."""
        self.upper = max(0.0, self.thrust(self._n_max))
        """Thrust at the largest command."""

    def at(self, U: float) -> Drive:
        """Return the drive at another speed of the vessel in m/s: this one, unless its thrust depends on it."""
        return Drive(self.actuator, U) if self._feels_flow else self

    def thrust(self, command: float) -> float:
        """Return the thrust in N of a command: saturated, and zero within the dead zone."""
        known = self._thrusts.get(command)
        if known is not None:
            return known
        n = max(self._n_min, min(self._n_max, command))
        return self.curve.thrust(n) if abs(n) > self._dead_zone else 0.0

    def command(self, thrust_n: float) -> float:
        """Return the command whose thrust is nearest to a demanded one in N, within the limits.

        The exact inverse of the characteristic. In the dead zone and between whole commands the choice is by thrust,
        not by command: near zero the characteristic is so flat that rounding the command would be up to half as much
        again wrong in thrust.
        """
        if self._integer:
            return self.whole[bisect_left(self.between, thrust_n)]
        forward = thrust_n > 0.0
        side, wanted = (self._forward, thrust_n) if forward else (self._backward, -thrust_n)
        most = self._n_max if forward else -self._n_min
        n = min(side.command(wanted), most)
        if n <= self._dead_zone:
            working = self._dead_zone + _STEP  # less is rounded to nothing on its way
            n = working if working <= most and 2.0 * wanted > side.thrust(working) else 0.0
        return n if forward else 0.0 - n

    def _whole_commands(self) -> tuple[list[float], list[float]]:
        """Return the whole commands that do something, with zero, and the thrusts halfway between neighbours."""
        every = map(float, range(math.ceil(self._n_min), math.floor(self._n_max) + 1))
        commands = [n for n in every if n == 0.0 or n * self.thrust(n) > 0.0]  # what drives, not what brakes
        thrusts = [self.thrust(n) for n in commands]
        return commands, [(a + b) / 2.0 for a, b in itertools.pairwise(thrusts)]
