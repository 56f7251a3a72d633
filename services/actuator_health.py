"""Which actuators the allocator leaves out: by configuration, by an operator's word, by detection."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Literal

from bus.messages import AXES, ActuatorFault, ActuatorHealth, OperatorActuator
from marine.allocation import VesselAllocation

Why = Literal["configuration", "operator", "detected"]
Make = Callable[..., VesselAllocation]


class Refused(Exception):  # noqa: N818 - it is an answer, not an error
    """Without this actuator nothing is left to control; the text says so."""


class Crew:
    """The actuators that work and those that are left out, with the allocation that follows from them."""

    def __init__(self, names: Collection[str], make: Make, failed: Collection[str], least_loss: float | None) -> None:
        """make: gives the allocation without those that have `failed`.

        least_loss: part of the thrust from which on a detected failure is left out; None: never.
        Raise ValueError when nothing is left to control.
        """
        self._names, self._least_loss = frozenset(names), least_loss
        self._make = make
        self._full = make(failed=()).rank
        self._failed: dict[str, Why] = dict.fromkeys(failed, "configuration")
        self._lost: dict[str, float] = {}
        self.allocation = make(failed=failed)

    def restore(self, former: ActuatorHealth) -> None:
        """Take up what an operator said before the allocator started again."""
        for name, why in former.failed.items():
            if why == "operator":
                self.obey(OperatorActuator(client="", actuator=name, works=False))

    def obey(self, order: OperatorActuator) -> None:
        """Follow an operator's word. Raise Refused for an unknown actuator, and for the last one of an axis."""
        if order.actuator not in self._names:
            raise Refused(f"no actuator is called {order.actuator!r}; known: {', '.join(sorted(self._names))}")
        if order.works:
            self._failed.pop(order.actuator, None)
            self._lost.pop(order.actuator, None)
            self.allocation = self._make(failed=self._failed)
            return
        try:
            self.allocation = self._make(failed=(*self._failed, order.actuator))
        except ValueError as error:
            raise Refused(str(error)) from None
        self._failed.setdefault(order.actuator, "operator")

    def hear(self, fault: ActuatorFault) -> None:
        """Leave out what is detected, as long as the others control all axes."""
        if fault.lost == self._lost:
            return
        self._lost = dict(fault.lost)
        for name in [n for n, why in self._failed.items() if why == "detected" and n not in self._lost]:
            del self._failed[name]
        least = self._least_loss
        for name, part in self._lost.items():
            if least is not None and part >= least and name in self._names - self._failed.keys():
                without = self._without(name)
                if without is not None and without.rank == self._full:
                    self._failed[name] = "detected"
        self.allocation = self._make(failed=self._failed)

    def _without(self, name: str) -> VesselAllocation | None:
        try:
            return self._make(failed=(*self._failed, name))
        except ValueError:
            return None

    def health(self) -> ActuatorHealth:
        """Return who is left out, and what that means."""
        return ActuatorHealth(failed=self._failed, lost=self._lost, reason=self._reason())

    def _reason(self) -> str:
        says = [f"{n} has failed ({why})" for n, why in self._failed.items()]
        says += [f"{n} has lost {100 * x:.0f} % of its thrust" for n, x in self._lost.items() if n not in self._failed]
        if self._failed:
            axes = ", ".join(AXES[axis] for axis in self.allocation.axes)
            says.append(f"rank {self.allocation.rank} on {axes}")
        return "; ".join(says)
