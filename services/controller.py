"""The controller: holds the laws and runs the one that the helm names."""

from __future__ import annotations

from bus import topics
from bus.clock import NS
from bus.messages import AttainedWrench, ControlStatus, HelmState, NavigationState, Wrench
from bus.service import Input, Output, Service
from marine.control.base import ZERO, ControlLaw, Vector3
from marine.control.positioning import Positioning
from marine.vessel import Vessel

STATUS_PERIOD_S = 0.2
MAX_STEP_S = 0.25
"""Integrals do not advance further at once, whatever the gap between two navigation states."""


class Controller(Service):
    """Demand the wrench that brings the vessel to the helm's reference.

    The law that the helm names demands one for every navigation state, also while the helm is suspended: it then
    follows what the actuators attain, so that it takes over without a jump. Without a usable state it is silent.
    """

    name = "controller"
    rate_hz = 10.0
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25, wakes=True)
    helm = Input(topics.HELM_STATE, max_age_s=1.0)
    attained = Input(topics.ACTUATOR_ATTAINED, max_age_s=0.25)
    wrench = Output(topics.CONTROL_WRENCH)
    status = Output(topics.CONTROL_STATUS)

    def __init__(self, vessel: Vessel) -> None:
        positioning = Positioning(vessel.model, vessel.hold_w0_rad_s)
        self._laws: dict[str, ControlLaw] = {positioning.name: positioning}
        self._running: ControlLaw | None = None
        self._in_charge = False
        self._state_ns = 0
        self._told_s = 0.0

    def step(self, now_s: float) -> None:
        """Run the law once for each new navigation state."""
        helm = self.helm.fresh(now_s)
        state = self.navigation.fresh(now_s)
        if helm is None or state is None or state.status not in ("tracking", "predicting"):
            self._running = None
        elif self.navigation.updated:
            self._control(helm, state, now_s)
        self._in_charge = self._running is not None and helm is not None and not helm.suspended
        self._tell(now_s)

    def _control(self, helm: HelmState, state: NavigationState, now_s: float) -> None:
        law, reference = self._laws.get(helm.law), _reference(helm)
        if law is None or reference is None:
            self._running = None
            return
        eta = (state.x_m, state.y_m, state.psi_rad)
        nu = (state.surge_m_s, state.sway_m_s, state.yaw_rad_s)
        attained = self.attained.fresh(now_s)
        if helm.suspended or law is not self._running:
            law.follow(eta, nu, _given(attained))
            dt_s, missing = 0.0, ZERO
        else:
            dt_s = max(0.0, min(MAX_STEP_S, (state.stamp_ns - self._state_ns) / NS))
            missing = _missing(attained)
        X, Y, N = law.step(dt_s, reference, eta, nu, missing)
        self._running, self._state_ns = law, state.stamp_ns
        self.wrench.publish(Wrench(origin_ns=state.origin_ns, surge_n=X, sway_n=Y, yaw_nm=N))

    def _tell(self, now_s: float) -> None:
        if now_s - self._told_s < STATUS_PERIOD_S - 1e-3:  # steps come at 1/30 s, and round off
            return
        self._told_s = now_s
        if self._running is None:
            self.status.publish(ControlStatus(law="", in_charge=False))
            return
        e_x, e_y, e_psi = self._running.error
        held_x, held_y, held_yaw = self._running.action
        attained = self.attained.fresh(now_s)
        self.status.publish(
            ControlStatus(
                law=self._running.name,
                in_charge=self._in_charge,
                error_x_m=e_x,
                error_y_m=e_y,
                error_psi_rad=e_psi,
                integral_x_n=held_x,
                integral_y_n=held_y,
                integral_yaw_nm=held_yaw,
                saturated=attained is not None and attained.limited,
            )
        )


def _reference(helm: HelmState) -> Vector3 | None:
    """Return the wanted eta, or None when the helm leaves a part of it open."""
    if helm.x_m is None or helm.y_m is None or helm.psi_rad is None:
        return None
    return helm.x_m, helm.y_m, helm.psi_rad


def _given(attained: AttainedWrench | None) -> Vector3:
    """Return [X Y N] as attained; zero when the allocator is silent: it has stopped the actuators."""
    if attained is None:
        return ZERO
    return attained.surge_n or 0.0, attained.sway_n or 0.0, attained.yaw_nm or 0.0


def _missing(attained: AttainedWrench | None) -> Vector3:
    """Return [X Y N] attained less demanded: zero within the limits."""
    if attained is None or not attained.limited:
        return ZERO
    X, Y, N = _given(attained)
    return (
        X - (attained.demanded_surge_n or 0.0),
        Y - (attained.demanded_sway_n or 0.0),
        N - (attained.demanded_yaw_nm or 0.0),
    )
