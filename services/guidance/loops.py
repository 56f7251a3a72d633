"""Loops of one degree of freedom that several modes are made of, designed from the vessel file."""

from __future__ import annotations

from marine.control.model_function import bessel
from marine.control.preview import natural_time_s
from marine.control.single_loop import TRACKING_TIME, LimitedLoop
from marine.control.stability import limited
from marine.control.structures import STRUCTURES, Gains, LoopDesign, Structure, design, speed_gains
from marine.vessel import DegreeOfFreedom
from services.guidance.base import Tools

_FASTER = 1.25
_TRIALS = 20


def heading_loop(tools: Tools) -> LimitedLoop:
    """Return the loop of the heading; raise ValueError when what is configured is not allowed, (8.22)."""
    vessel, given = tools.vessel, tools.config.heading_w0_rad_s
    w0 = given or vessel.heading_w0_rad_s or vessel.hold_w0_rad_s
    kind = STRUCTURES[tools.config.heading]
    return bessel_loop(vessel.model.yaw, tools.limits[2], w0, kind, fixed=given is not None, angle=True)


def bessel_loop(
    dof: DegreeOfFreedom,
    limit: float,
    w0_rad_s: float,
    structure: Structure = STRUCTURES["I-PD"],
    *,
    fixed: bool = False,
    angle: bool = False,
) -> LimitedLoop:
    """Return a loop by Bessel's model function; unless w0 is fixed a faster one where (8.22) does not allow it."""
    for _ in range(_TRIALS):
        try:
            made = limited(design(structure, dof, bessel(structure.order, w0_rad_s)))
            return LimitedLoop(made, limit, TRACKING_TIME * natural_time_s(made), angle=angle)
        except ValueError:
            if fixed:
                raise
            w0_rad_s *= _FASTER
    raise ValueError(f"no model function up to {w0_rad_s:.2g} rad/s gives a stable loop, thesis (8.22)")


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
