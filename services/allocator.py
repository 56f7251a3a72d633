"""The allocator: from the wrench that acts to one command per actuator."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from bus import topics
from bus.config import ConfigError, Section
from bus.messages import AXES, WRENCH_FIELDS, ActuatorCommand, AttainedWrench, HelmWrench, Wrench
from bus.service import Input, Output, Service
from marine.allocation import vessel_allocation
from marine.vessel import COMMAND_DIGITS, Vessel
from services.actuator_health import Crew, Refused

TELL_S = 1.0
_OPEN_LOOP = ("manual", "experiment")
"""Modes in which thrusts stay steady while the wrench does: an experiment measures what they do."""
_NEGLIGIBLE = 1e-6
"""Part of an axis' reach below which a difference is the solver's and not a limit's."""


AxisName = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


class AllocatorConfig(Section):
    """Section [allocator]."""

    failed: tuple[str, ...] = Field((), description="actuators that do not work: they get zero, the others take over")
    leave_out_detected: bool = Field(
        True, description="treat a detected failure like that at once; false: report it, and an operator decides"
    )
    leave_out_from: float = Field(0.5, gt=0, le=1, description="least part of the thrust that is lost for that")
    priority: dict[AxisName, float] = Field(
        {"yaw": 10.0}, description="weight of an axis when thrust is short, 1 where not named"
    )
    keep_direction: bool = Field(
        False, description="when thrust is short make the whole wrench smaller, instead of the axes of low priority"
    )


class Allocator(Service):
    """Turn the demanded wrench into actuator commands. Silence stops the actuators.

    `attained` is what the limits leave of the demand, for anti-windup; `delivered` what the commands as sent give,
    rounded and with dead zone. Components that the vessel does not control are ignored. Rudders and propellers that
    feel the water's speed take it from the wrench, and are taken at rest without it.
    """

    name = "allocator"
    rate_hz = 20.0
    quick = True
    wrench = Input(topics.HELM_WRENCH, max_age_s=0.25, wakes=True)
    fault = Input(topics.ACTUATOR_FAULT)
    order = Input(topics.OPERATOR_ACTUATOR, queue=16)
    former = Input(topics.ACTUATOR_HEALTH)
    command = Output(topics.ACTUATOR_COMMAND)
    attained = Output(topics.ACTUATOR_ATTAINED)
    delivered = Output(topics.ACTUATOR_DELIVERED)
    health = Output(topics.ACTUATOR_HEALTH)

    def __init__(self, config: AllocatorConfig, vessel: Vessel) -> None:
        self._names = [a.name for a in vessel.actuators]
        if unknown := [name for name in config.failed if name not in self._names]:
            raise ConfigError(f"allocator: failed: no actuator {unknown[0]!r}; known: {', '.join(self._names)}")
        if any(weight <= 0.0 for weight in config.priority.values()):
            raise ConfigError("allocator: priority: weights must be positive")
        priority = {AXES.index(axis): weight for axis, weight in config.priority.items()}
        make = functools.partial(vessel_allocation, vessel, priority=priority, keep_direction=config.keep_direction)
        try:
            least = config.leave_out_from if config.leave_out_detected else None
            self._crew = Crew(self._names, make, config.failed, least)
        except ValueError as error:
            raise ConfigError(f"allocator: {error}") from None
        self._restored = False
        self._told_s = 0.0
        self._follow_crew()
        self._before_s = -math.inf

    def start(self, now_s: float) -> None:
        """Give the hub a second to tell what an operator said before."""
        self._told_s = now_s

    def step(self, now_s: float) -> None:
        """Answer the wrench, or its silence with zero commands."""
        self._watch_actuators(now_s)
        wrench = self.wrench.fresh(now_s)
        if wrench is None:
            self._stop_actuators()
        else:
            self._allocate(wrench, now_s)
        self._before_s = now_s

    def stop(self, now_s: float) -> None:
        """Leave the actuators at zero."""
        self._stop_actuators()

    def _follow_crew(self) -> None:
        """Take the allocation of the actuators that work."""
        self._allocation = allocation = self._crew.allocation
        fields = [(axis, field, f"demanded_{field}") for axis, field in enumerate(WRENCH_FIELDS)]
        tolerances = {axis: _NEGLIGIBLE * allocation.reach[axis] for axis in allocation.axes}
        self._controlled = [(*fields[axis], tolerance) for axis, tolerance in tolerances.items()]
        self._ignored = [entry for entry in fields if entry[0] not in tolerances]
        self._acting = [(axis, WRENCH_FIELDS[axis]) for axis in allocation.acting]
        reason = self._crew.health().reason
        if reason and reason != self.note:
            self.log.warning(reason)
        self.note = reason

    def _watch_actuators(self, now_s: float) -> None:
        """Leave out what has failed; say so at every change and once a second."""
        before = self._crew.allocation
        if not self._restored and self.former.latest is not None:
            self._restored = True
            self._crew.restore(self.former.latest)
        for order in self.order.take():
            try:
                self._crew.obey(order)
            except Refused as refusal:
                self.note = str(refusal)
                self.log.warning(self.note)
        if self.fault.updated and self.fault.latest is not None:
            self._crew.hear(self.fault.latest)
        if self._crew.allocation is not before:
            self._follow_crew()
        elif now_s - self._told_s < TELL_S:
            return
        self._told_s, self._restored = now_s, True
        self.health.publish(self._crew.health())

    def _allocate(self, wrench: HelmWrench, now_s: float) -> None:
        demand, tau = vars(wrench), wrench.vector()
        U, origin_ns = demand["speed_m_s"] or 0.0, demand["origin_ns"]
        carry = demand["mode"] not in _OPEN_LOOP
        commands, attained = self._allocation.solve(tau, U, now_s - self._before_s, carry=carry)
        self._publish(commands, U, origin_ns)
        told: dict[str, float] = {}
        limited = False
        for axis, field, demanded_field, tolerance in self._controlled:
            told[field] = attained[axis]
            if demand[field] is not None:
                told[demanded_field] = demand[field]
            if abs(attained[axis] - tau[axis]) > tolerance:
                limited = True
        for axis, field, demanded_field in self._ignored:
            if demand[field] is not None:
                told[field], told[demanded_field] = attained[axis], demand[field]
                limited = limited or tau[axis] != 0.0
        self.attained.publish(AttainedWrench(origin_ns=origin_ns, limited=limited, **told))

    def _stop_actuators(self) -> None:
        self._publish(self._allocation.stop(), 0.0, None)
        self.attained.publish(AttainedWrench(**{WRENCH_FIELDS[axis]: 0.0 for axis in self._allocation.axes}))

    def _publish(self, commands: Sequence[float], U: float, origin_ns: int | None) -> None:
        # as the platform gets them; most are whole, and to round those takes twelve times as long as to see it
        commands = [n if n.is_integer() else round(n, COMMAND_DIGITS) for n in commands]
        self.command.publish(
            ActuatorCommand(origin_ns=origin_ns, commands=dict(zip(self._names, commands, strict=True)))
        )
        given = self._allocation.delivered(commands, U)
        acting = {field: given[axis] for axis, field in self._acting}
        self.delivered.publish(Wrench(origin_ns=origin_ns, **acting))
