"""The simulator's state in a file, so that a killed one resumes."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from bus.clock import NS
from bus.config import Section
from marine.dynamics.integrate import State
from services.simulator.actuators import Failure
from services.simulator.faults import CameraFaults
from services.simulator.world import World

log = logging.getLogger("simulator")

RESUME_WITHIN_S = 30.0
"""An older file is from another session."""


class Saved(Section):
    """What makes up the world."""

    stamp_ns: int
    state: State
    upright: State
    constant_current_m_s: tuple[float, float]
    varying_current_m_s: tuple[float, float]
    failures: dict[str, Failure]
    camera: CameraFaults

    @classmethod
    def of(cls, now_ns: int, world: World, camera: CameraFaults) -> Self:
        """Take down a world."""
        return cls(
            stamp_ns=now_ns,
            state=world.state,
            upright=world.upright,
            constant_current_m_s=world.constant_current_m_s,
            varying_current_m_s=world.varying_current_m_s,
            failures=dict(world.actuators.failures),
            camera=camera,
        )

    def restore(self, world: World) -> CameraFaults:
        """Bring a new world to this state; return the camera's faults."""
        world.state = self.state
        world.upright = self.upright
        world.constant_current_m_s = self.constant_current_m_s
        world.varying_current_m_s = self.varying_current_m_s
        world.actuators.fail(self.failures)
        return self.camera


def save(path: Path, saved: Saved) -> None:
    """Replace the file in one go: a kill leaves the old or the new one."""
    fresh = path.with_suffix(".new")
    fresh.write_text(saved.model_dump_json(), encoding="utf-8")
    fresh.replace(path)


def load(path: Path, now_ns: int) -> Saved | None:
    """Return what was saved; None when there is nothing, or it is old or damaged."""
    try:
        saved = Saved.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError):
        log.warning("%s: cannot be read; starting afresh", path)
        return None
    return saved if 0 <= now_ns - saved.stamp_ns <= RESUME_WITHIN_S * NS else None
