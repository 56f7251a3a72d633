"""The controller: holds the laws and runs the one that the helm names."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from pydantic import Field, TypeAdapter, ValidationError, field_validator

from bus import topics
from bus.clock import NS
from bus.config import ConfigError, Section
from bus.messages import AttainedWrench, ControlStatus, HelmState, NavigationState, Wrench
from bus.service import Input, Output, Service
from marine.allocation import axis_limits
from marine.control.base import ZERO, ControlLaw, Reference, Vector3
from marine.control.laws import known_laws
from marine.frames import to_body, to_tank, wrap_angle
from marine.guidance.reference_filter import MotionLimits, ReferenceFilter
from marine.vessel import Vessel

STATUS_PERIOD_S = 0.2
MAX_STEP_S = 0.25
"""Integrals do not advance further at once, whatever the gap between two navigation states."""

APPROACH = 2.0
"""Rate at which the reference filter goes out, in units of the vessel's w0."""


class ReferenceFilterConfig(Section):
    """Table [controller.reference_filter]: how a new reference is approached."""

    enabled: bool = Field(True, description="false: the law gets steps as they are")
    share: float = Field(
        0.7, gt=0, le=1, description="part of the actuators that the motion may take: gives the limits that are not set"
    )
    speed_m_s: float | None = Field(None, gt=0)
    acceleration_m_s2: float | None = Field(None, gt=0)
    yaw_rate_rad_s: float | None = Field(None, gt=0)
    yaw_acceleration_rad_s2: float | None = Field(None, gt=0)

    def filter_for(self, vessel: Vessel, limits: Vector3) -> ReferenceFilter:
        """Return the filter for a vessel whose actuators reach `limits` on surge, sway and yaw."""
        derived = vars(MotionLimits.of_vessel(vessel.model, limits, self.share, APPROACH * vessel.hold_w0_rad_s))
        given = self.model_dump(exclude={"enabled", "share"}, exclude_none=True)
        return ReferenceFilter(MotionLimits(**{**derived, **given}))


class ControllerConfig(Section):
    """Section [controller]."""

    positioning: str = Field("ipd", description="law that serves hold: see docs/control.md, `starboard tune --list`")
    laws: dict[str, Any] = Field(
        default_factory=dict, description="parameters of laws that differ from their defaults, by the law's name"
    )
    reference_filter: ReferenceFilterConfig = Field(
        ReferenceFilterConfig(), description="a table: how a new reference is approached, docs/control.md"
    )

    @field_validator("positioning")
    @classmethod
    def _serves_positioning(cls, name: str) -> str:
        known = [law.name for law in known_laws().values() if law.serves == "positioning"]
        if name not in known:
            raise ValueError(f"no law is called {name!r}; known: {', '.join(known)}")
        return name

    @field_validator("laws")
    @classmethod
    def _parameters(cls, laws: dict[str, Any]) -> dict[str, Any]:
        """Turn each table into the parameters of its law."""
        for name in laws:
            if name not in known_laws():
                raise ValueError(f"no law is called {name!r}; known: {', '.join(known_laws())}")
        return {name: _parsed(known_laws()[name], values) for name, values in laws.items()}

    def build(self, name: str, vessel: Vessel, limits: Vector3) -> ControlLaw:
        """Return a law for a vessel; raise ConfigError when it cannot be designed."""
        law = known_laws()[name]
        try:
            return law.for_vessel(self.laws.get(name, law.Parameters()), vessel, limits)
        except ValueError as error:
            raise ConfigError(f"controller.laws.{name}: {error}") from None


def _parsed(law: type[ControlLaw], values: Any) -> Any:
    try:
        return TypeAdapter(law.Parameters).validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in (law.name, *first["loc"]))
        if first["type"] == "unexpected_keyword_argument":
            known = ", ".join(f.name for f in fields(law.Parameters))
            raise ValueError(f"{key}: no such key; known: {known}") from None
        raise ValueError(f"{key}: {first['msg']}") from None


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

    def __init__(self, config: ControllerConfig, vessel: Vessel) -> None:
        X, Y, _, _, _, N = axis_limits(vessel)
        limits = (X, Y, N)
        self._laws: dict[str, ControlLaw] = {}
        try:
            self._laws["positioning"] = config.build(config.positioning, vessel, limits)
        except ConfigError as error:
            if {"X", "Y", "N"} <= set(vessel.controlled):
                raise
            self.note = f"{vessel.name} cannot hold a place: it controls {', '.join(vessel.controlled)} only; {error}"[
                :400
            ]
            self.log.warning(self.note)
        shaping = config.reference_filter
        self._filter = shaping.filter_for(vessel, limits) if shaping.enabled else None
        self._running: ControlLaw | None = None
        self._error = ZERO  # from the helm's reference, whatever the filter makes of it
        self._in_charge = False
        self._ours = (True, True, True)
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
        law, target = self._laws.get(helm.law), _reference(helm)
        if law is None or target is None:
            self._running = None
            return
        eta = (state.x_m, state.y_m, state.psi_rad)
        nu = (state.surge_m_s, state.sway_m_s, state.yaw_rad_s)
        attained = self.attained.fresh(now_s)
        ours = _ours(helm)
        if helm.suspended or law is not self._running or ours != self._ours:
            law.follow(eta, nu, _given(attained))
            if self._filter:
                self._filter.start(eta, (*to_tank(nu[0], nu[1], eta[2]), nu[2]))
            dt_s, missing = 0.0, ZERO
        else:
            dt_s = max(0.0, min(MAX_STEP_S, (state.stamp_ns - self._state_ns) / NS))
            missing = _missing(attained)
        self._ours = ours
        target = _where_ours(target, eta, ours)
        reference = self._shaped(dt_s, target) if all(ours) else Reference(target)
        disturbance = ZERO if law.integral else _disturbance(state)
        X, Y, N = law.step(dt_s, reference, eta, nu, missing, disturbance)
        if not all(ours):  # integrals follow what others give on their axes; on ours they stay as they are
            given = _given(attained)
            law.engage(eta, nu, (X if ours[0] else given[0], Y if ours[1] else given[1], N if ours[2] else given[2]))
        self._running, self._state_ns = law, state.stamp_ns
        self._error = (target[0] - eta[0], target[1] - eta[1], wrap_angle(target[2] - eta[2]))
        self.wrench.publish(Wrench(origin_ns=state.origin_ns, surge_n=X, sway_n=Y, yaw_nm=N))

    def _shaped(self, dt_s: float, target: Vector3) -> Reference:
        """Return the reference of this moment on the way to the target."""
        if self._filter is None:
            return Reference(target)
        self._filter.step(dt_s, target)
        return Reference(self._filter.eta, self._filter.rate, self._filter.acceleration)

    def _tell(self, now_s: float) -> None:
        if now_s - self._told_s < STATUS_PERIOD_S - 1e-3:  # steps come at 1/30 s, and round off
            return
        self._told_s = now_s
        if self._running is None:
            self.status.publish(ControlStatus(law="", in_charge=False))
            return
        e_x, e_y, e_psi = self._error
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


def _ours(helm: HelmState) -> tuple[bool, bool, bool]:
    """Return which of surge, sway and yaw are the controller's."""
    surge, sway, yaw = (helm.sources.get(axis, "controller") == "controller" for axis in ("surge", "sway", "yaw"))
    return surge, sway, yaw


def _where_ours(target: Vector3, eta: Vector3, ours: tuple[bool, bool, bool]) -> Vector3:
    """Return the target on our axes, and the vessel's own place along the others (of the target's heading)."""
    surge, sway, yaw = ours
    heading = target[2] if yaw else eta[2]
    if surge and sway:
        return target[0], target[1], heading
    ahead, aside = to_body(target[0] - eta[0], target[1] - eta[1], target[2])
    x, y = to_tank(ahead * surge, aside * sway, target[2])
    return eta[0] + x, eta[1] + y, heading


def _disturbance(state: NavigationState) -> Vector3:
    """Return the estimated disturbance in {E}; zero when the estimator has none."""
    return state.disturbance_x_n or 0.0, state.disturbance_y_n or 0.0, state.disturbance_yaw_nm or 0.0


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
