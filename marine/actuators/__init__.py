"""Actuators: from a command to a force, and exactly back."""

from marine.actuators.thruster import command, max_thrust, thrust

__all__ = ["command", "max_thrust", "thrust"]
