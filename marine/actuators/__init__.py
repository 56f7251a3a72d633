"""Actuators: from a command to a force, and exactly back."""

from marine.actuators.curve import Side, ThrustCurve
from marine.actuators.propeller import ambient_speed, hull_torque, lagged, torque
from marine.actuators.thruster import Drive, curve_of

__all__ = ["Drive", "Side", "ThrustCurve", "ambient_speed", "curve_of", "hull_torque", "lagged", "torque"]
