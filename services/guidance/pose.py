"""Holding a place, or a heading while the stick has the place."""

from __future__ import annotations

from typing import Any

from bus.messages import HelmState
from marine.control.base import ZERO, Reference, Vector3
from marine.control.washout import Washout
from marine.frames import to_body, to_tank, wrap_angle
from services.guidance.base import Guidance, Ours, Seen, Tools, reference_told


class PoseKeeping(Guidance):
    """The positioning law on a reference that the filter makes of the helm's."""

    law = "positioning"

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when there is no law for this vessel."""
        super().__init__(tools)
        if tools.positioning is None:
            raise ValueError(f"{tools.vessel.name} has no positioning law")
        self._error, self._reference = ZERO, ZERO
        self._news = Washout(1.0 / tools.vessel.hold_w0_rad_s)

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Start the filter here, and the law from what the actuators give."""
        law, filter_ = self.tools.positioning, self.tools.filter
        assert law is not None
        law.follow(seen.eta, seen.nu, seen.given)
        self._news.start(seen.disturbance)
        if filter_:
            filter_.start(seen.eta, rate_in_tank(seen))

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Run the law once."""
        law = self.tools.positioning
        assert law is not None
        wanted = (
            seen.eta[0] if order.x_m is None else order.x_m,
            seen.eta[1] if order.y_m is None else order.y_m,
            seen.eta[2] if order.psi_rad is None else order.psi_rad,
        )
        target = _where_ours(wanted, seen.eta, seen.ours)
        reference = self._shaped(seen.dt_s, target) if all(seen.ours) else Reference(target)
        self._error = (target[0] - seen.eta[0], target[1] - seen.eta[1], wrap_angle(target[2] - seen.eta[2]))
        self._reference = reference.eta
        disturbance = self._news.step(seen.dt_s, seen.disturbance) if law.integral else seen.disturbance
        return law.step(seen.dt_s, reference, seen.eta, seen.nu, seen.missing, disturbance)

    def _shaped(self, dt_s: float, target: Vector3) -> Reference:
        """Return the reference of this moment on the way to the target."""
        filter_ = self.tools.filter
        if filter_ is None:
            return Reference(target)
        filter_.step(dt_s, target)
        return Reference(filter_.eta, filter_.rate, filter_.acceleration)

    def told(self) -> dict[str, Any]:
        """Return the errors from the helm's reference, whatever the filter makes of it, and what the law holds."""
        return law_told(self.tools, self._error) | reference_told(self._reference)


def law_told(tools: Tools, error: Vector3) -> dict[str, Any]:
    """Return the positioning law's fields of control/status."""
    assert tools.positioning is not None
    held_x, held_y, held_yaw = tools.positioning.action
    return {
        "law": tools.positioning.name,
        "error_x_m": error[0],
        "error_y_m": error[1],
        "error_psi_rad": error[2],
        "integral_x_n": held_x,
        "integral_y_n": held_y,
        "integral_yaw_nm": held_yaw,
    }


def rate_in_tank(seen: Seen) -> Vector3:
    """Return the rate of eta in {E}."""
    u, v, r = seen.nu
    return (*to_tank(u, v, seen.eta[2]), r)


def _where_ours(target: Vector3, eta: Vector3, ours: Ours) -> Vector3:
    """Return the target on our axes, and the vessel's own place along the others (of the target's heading)."""
    surge, sway, yaw = ours
    heading = target[2] if yaw else eta[2]
    if surge and sway:
        return target[0], target[1], heading
    ahead, aside = to_body(target[0] - eta[0], target[1] - eta[1], target[2])
    x, y = to_tank(ahead * surge, aside * sway, target[2])
    return eta[0] + x, eta[1] + y, heading
