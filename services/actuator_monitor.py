"""What the estimator's process does about failed actuators: commands and poses into `marine.estimation.actuator_fault`.

It stands there because the poses are there already: a process of its own would cost 65 MB and hear every pose again.
"""

from __future__ import annotations

import itertools
from collections import deque

from bus.clock import NS
from bus.messages import ActuatorCommand, ActuatorFault, OperatorActuator
from marine.actuators import Drive
from marine.estimation.actuator_fault import FaultDetector, FaultTuning
from marine.vessel import BilinearThrust, HorizontalModel, Rudder, Thruster, Vessel
from services.wrenches import WRENCH_HOLD_NS

PERIOD_NS = 190_000_000
"""At most so often a pose is taken in: five times a second from a camera of 30 Hz."""
LONGEST_NS = 500_000_000
"""After a longer time without a pose the detector begins anew."""
TELL_S = 1.0


def can_be_monitored(vessel: Vessel) -> bool:
    """Whether thrusts follow from commands alone and the model is uncoupled: no rudders, no propellers in a flow."""
    return isinstance(vessel.dynamics, HorizontalModel) and not any(
        isinstance(a, Rudder) or (isinstance(a, Thruster) and isinstance(a.characteristic, BilinearThrust))
        for a in vessel.actuators
    )


class ActuatorMonitor:
    """Keeps the commands of the last second, and feeds the detector with mean thrusts between poses."""

    def __init__(self, vessel: Vessel) -> None:
        flat = [a for a in vessel.actuators if not isinstance(a, Rudder) and any(a.column[i] for i in (0, 1, 5))]
        self._drives = {a.name: Drive(a) for a in flat}
        self._names = tuple(self._drives)
        columns = [(a.column[0], a.column[1], a.column[5]) for a in flat]
        most = [max(drive.upper, -drive.lower) for drive in self._drives.values()]
        self._detector = FaultDetector(vessel.model, columns, FaultTuning.of_vessel(vessel.model, columns, most))
        self._delay_ns = round(vessel.command_delay_s * NS)
        self._thrusts: deque[tuple[int, list[float]]] = deque(maxlen=128)
        self._pose_ns = 0
        self._told_s = 0.0
        self._changed = False

    def command(self, command: ActuatorCommand) -> None:
        """Take in what the actuators are told."""
        commands = command.commands
        thrusts = [drive.thrust(commands.get(name, 0.0)) for name, drive in self._drives.items()]
        at_ns = command.stamp_ns + self._delay_ns
        if not self._thrusts or at_ns > self._thrusts[-1][0]:
            self._thrusts.append((at_ns, thrusts))

    def order(self, order: OperatorActuator) -> None:
        """Forget a failure when the operator says that the actuator works."""
        if order.works and order.actuator in self._names:
            self._detector.lost[self._names.index(order.actuator)] = 0.0
            self._detector.restart()
            self._changed = True

    def pose(self, stamp_ns: int, x_m: float, y_m: float, psi_rad: float) -> None:
        """Take in a pose that the filter has believed."""
        passed_ns = stamp_ns - self._pose_ns
        if 0 <= passed_ns < PERIOD_NS:
            return
        from_ns, self._pose_ns = self._pose_ns, stamp_ns
        if not 0 <= passed_ns <= LONGEST_NS:
            self._detector.restart()
            from_ns, passed_ns = stamp_ns - PERIOD_NS, PERIOD_NS
        thrusts = self._mean(from_ns, stamp_ns)
        self._changed |= self._detector.step(passed_ns / NS, thrusts, x_m, y_m, psi_rad) is not None

    def tell(self, now_s: float) -> ActuatorFault | None:
        """Return what is known when it is time to say it: once a second, and at every change."""
        if not self._changed and now_s - self._told_s < TELL_S:
            return None
        self._told_s, self._changed = now_s, False
        lost = {name: float(part) for name, part in zip(self._names, self._detector.lost, strict=True) if part > 0.0}
        finding = self._detector.finding
        if finding is None:
            return ActuatorFault(lost=lost)
        return ActuatorFault(lost=lost, suspected=self._names[finding.actuator], ratio=finding.ratio)

    def _mean(self, from_ns: int, to_ns: int) -> list[float]:
        """Return each actuator's mean thrust in N between two times."""
        while len(self._thrusts) > 1 and self._thrusts[1][0] <= from_ns:
            self._thrusts.popleft()
        total = [0.0] * len(self._names)
        for (begin_ns, thrusts), (next_ns, _) in itertools.pairwise([*self._thrusts, (to_ns, total)]):
            in_force_ns = min(next_ns, to_ns, begin_ns + WRENCH_HOLD_NS) - max(begin_ns, from_ns)
            if in_force_ns > 0:
                share = in_force_ns / (to_ns - from_ns)
                total = [sum_n + share * thrust for sum_n, thrust in zip(total, thrusts, strict=True)]
        return total
