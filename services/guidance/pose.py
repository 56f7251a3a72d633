"""Holding a place, or a heading while the stick has the place."""

from __future__ import annotations

from typing import Any

from bus.messages import HelmState
from marine.control.base import ZERO, Reference, Vector3
from marine.control.feed_forward import FeedForward
from marine.frames import to_body, to_tank, wrap_angle
from services.guidance.base import ALL, Guidance, Ours, Seen, Tools, reference_told


class PoseKeeping(Guidance):
    """The positioning law on a reference that the filter makes of the helm's."""

    law = "positioning"

    def __init__(self, tools: Tools) -> None:
        """Raise ValueError when there is no law for this vessel."""
        super().__init__(tools)
        if tools.positioning is None:
            raise ValueError(f"{tools.vessel.name} has no positioning law")
        self._target, self._reference, self._eta = ZERO, ZERO, ZERO
        self._feed_forward = FeedForward(1.0 / tools.vessel.hold_w0_rad_s)

    def engage(self, order: HelmState, seen: Seen) -> None:
        """Start the filter here, and the law from what the actuators give."""
        law, filter_ = self.tools.positioning, self.tools.filter
        assert law is not None
        law.follow(seen.eta, seen.nu, seen.given)
        self._feed_forward.start(seen.disturbance)
        if filter_:
            filter_.start(seen.eta, rate_in_tank(seen))

    def step(self, order: HelmState, seen: Seen) -> Vector3:
        """Run the law once."""
        law = self.tools.positioning
        assert law is not None
        dt_s, eta, x_m, y_m, psi_rad = seen.dt_s, seen.eta, order.x_m, order.y_m, order.psi_rad
        x, y, psi = eta
        target = (x if x_m is None else x_m, y if y_m is None else y_m, psi if psi_rad is None else psi_rad)
        if seen.ours == ALL:
            reference = self._shaped(dt_s, target)
        else:
            target = _where_ours(target, eta, seen.ours)
            reference = Reference(target)
        self._target, self._reference, self._eta = target, reference.eta, eta
        disturbance = self._feed_forward.step(law, dt_s, seen.disturbance)
        return law.step(dt_s, reference, eta, seen.nu, seen.missing, disturbance)

    def _shaped(self, dt_s: float, target: Vector3) -> Reference:
        """Return the reference of this moment on the way to the target."""
        filter_ = self.tools.filter
        if filter_ is None:
            return Reference(target)
        filter_.step(dt_s, target)
        return Reference(filter_.eta, filter_.rate, filter_.acceleration)

    def told(self) -> dict[str, Any]:
        """Return the errors from the helm's reference, whatever the filter makes of it, and what the law holds."""
        (x, y, psi), (here_x, here_y, here_psi) = self._target, self._eta
        error = (x - here_x, y - here_y, wrap_angle(psi - here_psi))
        return law_told(self.tools, error) | reference_told(self._reference)


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
