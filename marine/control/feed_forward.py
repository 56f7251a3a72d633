"""What a positioning law is given of an estimated disturbance."""

from __future__ import annotations

from marine.control.base import ControlLaw, Vector3
from marine.control.washout import Washout


class FeedForward:
    """All of the disturbance where the law has no integral; beside one what is new of it, see `Washout`."""

    def __init__(self, time_s: float) -> None:
        """time_s: of the washout, about 1 / w0 of the loop."""
        self._news = Washout(time_s)

    def start(self, disturbance: Vector3) -> None:
        """Take the disturbance of this moment for what lasts."""
        self._news.start(disturbance)

    def step(self, law: ControlLaw, dt_s: float, disturbance: Vector3) -> Vector3:
        """Return what the law shall feed forward, dt_s after the step before."""
        return self._news.step(dt_s, disturbance) if law.integral else disturbance
