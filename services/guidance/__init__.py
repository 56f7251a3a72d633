"""Guidance by mode. Add a mode: a class in a file here, its import below, a row in `services.helm_modes`."""

from __future__ import annotations

from services.guidance.base import Guidance, GuidanceConfig, Seen, Tools
from services.guidance.depth import DepthKeeping
from services.guidance.distance import DistanceGuidance
from services.guidance.pose import PoseKeeping
from services.guidance.speed import HeadingKeeping, SpeedKeeping, StickOnly
from services.guidance.steering import Steering
from services.guidance.trajectory import Following

GUIDANCE: tuple[type[Guidance], ...] = (
    HeadingKeeping,
    PoseKeeping,
    Following,
    Steering,
    SpeedKeeping,
    StickOnly,
    DistanceGuidance,
)
"""All there is; for one law the first that the vessel has the axes for."""

__all__ = [
    "GUIDANCE",
    "DepthKeeping",
    "DistanceGuidance",
    "Guidance",
    "GuidanceConfig",
    "Seen",
    "Tools",
    "guidance_for",
]


def guidance_for(tools: Tools) -> tuple[dict[str, Guidance], list[str]]:
    """Return the guidance of each law that the vessel can have, and why others are missing."""
    found: dict[str, Guidance] = {}
    missing: list[str] = []
    for kind in GUIDANCE:
        if kind.law not in found and kind.fits(tools.vessel):
            try:
                found[kind.law] = kind(tools)
            except ValueError as error:
                missing.append(f"no {kind.law}: {error}")
    return found, missing
