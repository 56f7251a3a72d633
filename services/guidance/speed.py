"""Modes speed and depth, and heading where there is no positioning law: loops of single axes."""

from __future__ import annotations

from typing import Any

from bus.messages import HelmState
from marine.control.base import ZERO, Vector3
from marine.control.heading import Heading
from marine.vessel import Vessel
from services.guidance.base import Guidance, Seen, Tools
from services.guidance.loops import heading_loop, speed_loop
from services.guidance.pose import PoseKeeping
from services.tuning import serving


class SpeedKeeping(Guidance):
    """Surge speed by I-P, heading by I-PD; on a vessel that pushes to the side no speed that way."""

    law = "speed"
    needs = ("X", "N")

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when a loop cannot be designed."""
        super().__init__(tools)
        model, (X, Y, _) = tools.vessel.model, tools.limits
        self._surge, self._heading = speed_loop(tools, model.surge, X), heading_loop(tools)
        self._sway = speed_loop(tools, model.sway, Y) if Y else None

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Start all loops from what the actuators give."""
        (u, v, r), (X, Y, N) = seen.nu, seen.given
        self._surge.follow(X, u, u)
        self._heading.follow(N, seen.eta[2], r)
        if self._sway:
            self._sway.follow(Y, v, v)

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Run all loops once."""
        (u, v, r), (short_x, short_y, short_n), dt_s, psi = seen.nu, seen.missing, seen.dt_s, seen.eta[2]
        X = self._surge.step(dt_s, order.speed_m_s or 0.0, u, u, short_x)
        Y = self._sway.step(dt_s, 0.0, v, v, short_y) if self._sway else 0.0
        N = self._heading.step(dt_s, psi if order.psi_rad is None else order.psi_rad, psi, r, short_n)
        return X, Y, N

    def told(self) -> dict[str, Any]:
        """Return the errors of speed and heading."""
        return {"law": self.law, "error_speed_m_s": self._surge.error, "error_psi_rad": self._heading.error}


class HeadingKeeping(Guidance):
    """Mode heading, and experiments, of a vessel that steers only: its heading loop, and its place ahead if it has one.

    Of the positioning law only what keeps surge is used.
    """

    law = "positioning"
    needs = ("N",)

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when the loop cannot be designed."""
        super().__init__(tools)
        self._heading = heading_loop(tools)
        self._place = PoseKeeping(tools) if tools.positioning else None

    @classmethod
    def fits(cls, vessel: Vessel) -> bool:
        """Return whether the vessel steers only."""
        return super().fits(vessel) and serving(vessel) == Heading.serves

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Start the loops from what the actuators give."""
        self._heading.follow(seen.given[2], seen.eta[2], seen.nu[2])
        if self._place:
            self._place.engage(order, seen)

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Run the loops once."""
        psi = seen.eta[2]
        wanted = psi if order.psi_rad is None else order.psi_rad
        N = self._heading.step(seen.dt_s, wanted, psi, seen.nu[2], seen.missing[2])
        X = self._place.step(order, seen)[0] if self._place else 0.0
        return X, 0.0, N

    def told(self) -> dict[str, Any]:
        """Return the error of the heading."""
        return {"law": Heading.name, "error_psi_rad": self._heading.error}


class StickOnly(Guidance):
    """Mode depth: the stick has all but heave, which the controller keeps in every mode with a depth."""

    law = "depth"

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Do nothing: the stick acts."""

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Demand nothing."""
        return ZERO

    def told(self) -> dict[str, Any]:
        """Return the law's name."""
        return {"law": self.law}
