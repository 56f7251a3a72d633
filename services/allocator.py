"""The allocator: from the wrench that acts to one command per actuator."""

from __future__ import annotations

from bus import topics
from bus.messages import ActuatorCommand, AttainedWrench, Wrench
from bus.service import Input, Output, Service
from marine import actuators
from marine.allocation import vessel_allocation
from marine.vessel import Vessel

_NEGLIGIBLE = 1e-6
"""Part of an axis' reach below which a difference is the solver's and not a limit's."""


class Allocator(Service):
    """Turn the demanded wrench into actuator commands. Silence stops the actuators.

    `attained` is what the limits leave of the demand, for anti-windup; `delivered` what the commands as sent give,
    rounded and with dead zone. Components that the vessel cannot do are ignored, and attained as zero.
    """

    name = "allocator"
    rate_hz = 20.0
    wrench = Input(topics.HELM_WRENCH, max_age_s=0.25, wakes=True)
    command = Output(topics.ACTUATOR_COMMAND)
    attained = Output(topics.ACTUATOR_ATTAINED)
    delivered = Output(topics.ACTUATOR_DELIVERED)

    def __init__(self, vessel: Vessel) -> None:
        self._thrusters = vessel.thrusters
        self._allocation = vessel_allocation(vessel)

    def step(self, now_s: float) -> None:
        """Answer the wrench, or its silence with zero commands."""
        wrench = self.wrench.fresh(now_s)
        if wrench is None:
            self._stop_actuators()
        else:
            self._allocate(wrench)

    def stop(self, now_s: float) -> None:
        """Leave the actuators at zero."""
        self._stop_actuators()

    def _allocate(self, wrench: Wrench) -> None:
        X, Y, Z, K, M, N = wrench.vector()
        thrusts = self._allocation.solve(X, Y, N)
        commands = [actuators.command(t, thrust) for t, thrust in zip(self._thrusters, thrusts, strict=True)]
        surge, sway, yaw = self._allocation.wrench(thrusts)
        differences = zip((surge - X, sway - Y, yaw - N), self._allocation.reach, strict=True)
        limited = any(abs(difference) > _NEGLIGIBLE * reach for difference, reach in differences)
        self._publish(commands, wrench.origin_ns)
        self.attained.publish(
            AttainedWrench(
                origin_ns=wrench.origin_ns,
                surge_n=surge,
                sway_n=sway,
                yaw_nm=yaw,
                heave_n=None if wrench.heave_n is None else 0.0,
                roll_nm=None if wrench.roll_nm is None else 0.0,
                pitch_nm=None if wrench.pitch_nm is None else 0.0,
                demanded_surge_n=wrench.surge_n,
                demanded_sway_n=wrench.sway_n,
                demanded_heave_n=wrench.heave_n,
                demanded_roll_nm=wrench.roll_nm,
                demanded_pitch_nm=wrench.pitch_nm,
                demanded_yaw_nm=wrench.yaw_nm,
                limited=limited or any((Z, K, M)),
            )
        )

    def _stop_actuators(self) -> None:
        self._publish([0.0] * len(self._thrusters), None)
        self.attained.publish(AttainedWrench(surge_n=0.0, sway_n=0.0, yaw_nm=0.0))

    def _publish(self, commands: list[float], origin_ns: int | None) -> None:
        names = (t.name for t in self._thrusters)
        self.command.publish(ActuatorCommand(origin_ns=origin_ns, commands=dict(zip(names, commands, strict=True))))
        given = [actuators.thrust(t, n) for t, n in zip(self._thrusters, commands, strict=True)]
        surge, sway, yaw = self._allocation.wrench(given)
        self.delivered.publish(Wrench(origin_ns=origin_ns, surge_n=surge, sway_n=sway, yaw_nm=yaw))
