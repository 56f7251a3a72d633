"""Anti-windup of a law that has some axes only."""

from __future__ import annotations

from marine.control.base import Vector3


def missing_of(demand: Vector3, given: Vector3, short: Vector3, ours: tuple[bool, bool, bool]) -> Vector3:
    """Return what a law is told that the actuators gave less than it demanded, `missing` of `ControlLaw.step`.

    demand: of the step before; given: what the actuators gave since; short: what their limits took. N and Nm. On an
    axis that another source has, nothing of the demand came through: the law's integral there follows what the other
    gives, by its own back-calculation (8.29), and those of our axes go on as they are, whatever the law.
    """
    surge, sway, yaw = ours
    return (
        short[0] if surge else given[0] - demand[0],
        short[1] if sway else given[1] - demand[1],
        short[2] if yaw else given[2] - demand[2],
    )
