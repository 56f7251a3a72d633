"""Whole commands whose mean thrust is the demanded one: error feedback, a delta-sigma modulator of first order."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections.abc import Sequence

from marine.actuators import Drive

CARRY_S = 0.1
"""Time over which a rounding error is made up for: short against a control loop (2 s), which does not see it then."""
RELUCTANCE = 0.4
"""Part of a step between two whole commands by which a demand must pass their middle: fewer changes."""

_Level = tuple[float, float, float, float]


class CarriedRounding:
    """Commands of actuators, of which those that take whole numbers make up for their rounding errors.

    Rounded on its own, a demand that stays between two whole commands is answered by the same error for seconds: of
    small thrusts, where the characteristic is flat, up to half. A loop's integral then has to find what is missing, and
    only noise brings the mean near to the demand. Here the thrust that was not given is owed, and added to the next.
    """

    def __init__(self, drives: Sequence[Drive]) -> None:
        """drives: of actuators that do not feel the vessel's speed."""
        self._drives = drives
        self._levels = [_levels(drive) for drive in drives]
        self._still = [bisect_left(drive.between, 0.0) for drive in drives]
        self.forget()

    def forget(self) -> None:
        """Owe nothing: the next demand is rounded on its own."""
        self._owed_n, self._at = [0.0] * len(self._drives), list(self._still)

    def commands(self, thrusts: Sequence[float], dt_s: float) -> list[float]:
        """Return the commands for thrusts in N within the limits, which will be in force for about dt_s."""
        share, owed, at = dt_s / CARRY_S if dt_s < CARRY_S else 1.0, self._owed_n, self._at
        commands = []
        for i, thrust in enumerate(thrusts):
            levels = self._levels[i]
            if not levels:
                commands.append(self._drives[i].command(thrust))
                continue
            wanted = thrust + owed[i]
            low, high, given, command = levels[at[i]]
            if not low <= wanted <= high:
                at[i] = bisect_left(self._drives[i].between, wanted)
                _, _, given, command = levels[at[i]]
            owed[i] += share * (thrust - given)
            commands.append(command)
        return commands


def _levels(drive: Drive) -> list[_Level]:
    """Return of each whole command: the demands within which it is kept, its thrust, and itself; of others nothing."""
    thrusts = [drive.thrust(n) for n in drive.whole]
    reluctance = [RELUCTANCE * (b - a) for a, b in itertools.pairwise(thrusts)]
    low = [-math.inf, *(b - r for b, r in zip(drive.between, reluctance, strict=True))]
    high = [*(b + r for b, r in zip(drive.between, reluctance, strict=True)), math.inf]
    return list(zip(low, high, thrusts, drive.whole, strict=True)) if drive.whole else []
