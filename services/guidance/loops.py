"""Loops of one degree of freedom that several modes are made of, designed from the vessel file."""

from __future__ import annotations

from marine.control.heading import bessel_design
from marine.control.model_function import bessel
from marine.control.preview import natural_time_s
from marine.control.single_loop import TRACKING_TIME, LimitedLoop
from marine.control.structures import STRUCTURES, Gains, LoopDesign, speed_gains
from marine.vessel import DegreeOfFreedom
from services.guidance.base import Tools


def heading_loop(tools: Tools) -> LimitedLoop:
    """Return the loop of the heading; raise ValueError when what is configured or engaged is not allowed, (8.22)."""
    return _within(tools.steering.design(tools.vessel), tools.limits[2], angle=True)


def depth_loop(dof: DegreeOfFreedom, limit: float, w0_rad_s: float) -> LimitedLoop:
    """Return the I-PD loop of the depth."""
    return _within(bessel_design(dof, w0_rad_s), limit)


def _within(made: LoopDesign, limit: float, *, angle: bool = False) -> LimitedLoop:
    return LimitedLoop(made, limit, TRACKING_TIME * natural_time_s(made), angle=angle)


def speed_loop(tools: Tools, dof: DegreeOfFreedom, limit: float) -> LimitedLoop:
    """Return I-P of a speed by Bessel's model function of second order, thesis Table 8.1: nu in the place of eta.

    All of the drag is compensated. It is not slower than the vessel by itself: then there would be nothing to feed
    back.
    """
    a1, a2 = bessel(2, 1.0)
    w0 = max(tools.config.speed_w0_rad_s or tools.vessel.hold_w0_rad_s, dof.beta / dof.alpha * a2 / a1)
    gains = speed_gains(dof.alpha, bessel(2, w0))
    kept = Gains(gains.integral, gains.proportional - dof.beta, 0.0)  # see speed_gains: the drag it leaves out
    return LimitedLoop(LoopDesign(STRUCTURES["I-P"], kept, dof), limit, TRACKING_TIME / w0)
