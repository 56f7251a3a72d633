"""What the surroundings do to a vessel besides the current: thesis 2.4, tau_E."""

from __future__ import annotations

import math

from marine.frames import to_body
from marine.vessel import Tether


def tether_wrench(tether: Tether, x_m: float, y_m: float, psi_rad: float) -> tuple[float, float, float]:
    """Return [X Y N] in {B}, N and Nm, of a cable that pulls towards its anchor as far as it is taut."""
    tied_x = x_m + tether.x_m * math.cos(psi_rad)
    tied_y = y_m + tether.x_m * math.sin(psi_rad)
    to_x, to_y = tether.anchor_x_m - tied_x, tether.anchor_y_m - tied_y
    distance = math.hypot(to_x, to_y)
    if distance <= tether.slack_m:
        return 0.0, 0.0, 0.0
    pull = tether.stiffness_n_m * (distance - tether.slack_m) / distance
    X, Y = to_body(pull * to_x, pull * to_y, psi_rad)
    return X, Y, tether.x_m * Y
