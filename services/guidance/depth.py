"""Depth: heave by I-PD, in every mode of a vessel that dives."""

from __future__ import annotations

from bus.messages import AttainedWrench, NavigationState
from marine.allocation import axis_limits
from marine.vessel import Vessel
from services.guidance.loops import depth_loop


class DepthKeeping:
    """I-PD of the depth, thesis Table 8.1 and (8.5): a heavy or buoyant vessel's weight is what its integral holds."""

    def __init__(self, vessel: Vessel) -> None:
        """vessel: one with a model of heave and an actuator for it."""
        assert vessel.model.heave is not None
        self._loop = depth_loop(vessel.model.heave, axis_limits(vessel)[2], vessel.hold_w0_rad_s)
        self._running = False
        self.error_m: float | None = None
        """Of the last step, None when there is no depth to keep."""

    def step(
        self, dt_s: float, z_m: float | None, state: NavigationState, attained: AttainedWrench | None
    ) -> float | None:
        """Return Z in N; None when no depth is wanted or known."""
        if z_m is None or state.z_m is None:
            self._running, self.error_m = False, None
            return None
        given = (attained.heave_n or 0.0) if attained else 0.0
        w = state.heave_m_s or 0.0
        missing = 0.0
        if dt_s == 0.0 or not self._running:
            self._loop.follow(given, state.z_m, w)
            self._running, dt_s = True, 0.0
        elif attained and attained.limited:
            missing = given - (attained.demanded_heave_n or 0.0)
        Z = self._loop.step(dt_s, z_m, state.z_m, w, missing)
        self.error_m = self._loop.error
        return Z
