"""The controller: holds the guidance of all modes and runs the one that the helm names."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

from pydantic import Field, field_validator

from bus import topics
from bus.clock import NS
from bus.config import ConfigError, Section
from bus.messages import AttainedWrench, ControlStatus, HelmState, NavigationState, Shaping, Wrench
from bus.service import Input, Output, Service
from marine.control.base import ZERO, ControlLaw, Vector3
from marine.control.heading import Heading
from marine.control.laws import known_laws
from marine.control.tracking import missing_of
from marine.guidance.reference_filter import MotionLimits, ReferenceFilter
from marine.vessel import Vessel
from services.guidance import DepthKeeping, DistanceGuidance, Guidance, GuidanceConfig, Seen, Tools, guidance_for
from services.tuning import horizontal_limits, loops, motion_for, parameters_of, serving, too_late
from services.tuning_desk import TuningDesk, answered

STATUS_PERIOD_S = 0.2
MAX_STEP_S = 0.25
"""Integrals do not advance further at once, whatever the gap between two navigation states."""
_estimated = itemgetter(
    "x_m", "y_m", "psi_rad", "surge_m_s", "sway_m_s", "yaw_rad_s",
    "disturbance_x_n", "disturbance_y_n", "disturbance_yaw_nm", "jumps", "stamp_ns", "origin_ns",
)  # fmt: skip
"""eta, nu, disturbance in {E}, None where there is none, and what else a step needs of a navigation state."""


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

    def motion(self, vessel: Vessel, limits: Vector3) -> MotionLimits:
        """Return what the reference may do, of a vessel whose actuators reach `limits` on surge, sway and yaw."""
        return motion_for(self.shaping, vessel, limits)

    @property
    def shaping(self) -> Shaping:
        """The same table as control/gains tells it."""
        return Shaping(**self.model_dump(exclude={"enabled"}))


class ControllerConfig(GuidanceConfig):
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
        return {name: parameters_of(known_laws()[name], values) for name, values in laws.items()}

    def check_for(self, vessel: Vessel) -> None:
        """Raise ConfigError when the law in charge cannot be designed for the vessel, or would not be stable."""
        if serving(vessel) == "positioning":
            self.build(self.positioning, vessel, horizontal_limits(vessel))

    def build(self, name: str, vessel: Vessel, limits: Vector3) -> ControlLaw:
        """Return a law for a vessel; raise ConfigError when it cannot be designed, or would not be stable."""
        kind = known_laws()[name]
        try:
            law = kind.for_vessel(self.laws.get(name, kind.Parameters()), vessel, limits)
        except ValueError as error:
            raise ConfigError(f"controller.laws.{name}: {error}") from None
        if reason := next(filter(None, (too_late(loop, vessel, axis) for axis, loop in loops(law).items())), ""):
            raise ConfigError(f"controller.laws.{name}: {reason}")
        return law


class Controller(Service):
    """Demand the wrench that brings the vessel to the helm's reference.

    The guidance that the helm names (`services.guidance`) demands one for every navigation state, also while the helm
    is suspended: it then follows what the actuators attain, so that it takes over without a jump. Without a usable
    state it is silent.
    """

    name = "controller"
    rate_hz = 10.0
    quick = True
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25, wakes=True)
    wall = Input(topics.NAVIGATION_WALL, max_age_s=0.5)
    helm = Input(topics.HELM_STATE, max_age_s=1.0)
    attained = Input(topics.ACTUATOR_ATTAINED, max_age_s=0.25)
    former = Input(topics.CONTROL_STATUS)
    tunings = Input(topics.OPERATOR_TUNING, queue=8, wakes=True)
    former_gains = Input(topics.CONTROL_GAINS)
    wrench = Output(topics.CONTROL_WRENCH)
    status = Output(topics.CONTROL_STATUS)
    gains = Output(topics.CONTROL_GAINS)
    answer = Output(topics.CONTROL_ANSWER)

    def __init__(self, config: ControllerConfig, vessel: Vessel) -> None:
        limits = horizontal_limits(vessel)
        shaping = config.reference_filter
        motion = shaping.motion(vessel, limits)
        self.tools = Tools(
            vessel=vessel,
            limits=limits,
            positioning=None,
            motion=motion,
            filter=ReferenceFilter(motion) if shaping.enabled else None,
            config=config,
            steering=config.steering,
        )
        try:
            self.tools.positioning = config.build(config.positioning, vessel, limits)
        except ConfigError as error:
            if {"X", "Y", "N"} <= set(vessel.controlled):
                raise
            self.note = f"{vessel.name} cannot hold a place: it controls {', '.join(vessel.controlled)} only; {error}"
        self._config, self._desk = config, self._tuning_desk(config)
        self._guidance, missing = guidance_for(self.tools)
        self.note = "; ".join([self.note, *missing] if self.note else missing)[:400]
        if self.note:
            self.log.warning(self.note)
        self._depth = DepthKeeping(vessel) if vessel.model.heave and "Z" in vessel.controlled else None
        self._running: Guidance | None = None
        self._order = ""
        self._followed = ("", 0.0)
        self._ours = (True, True, True)
        self._demand = ZERO
        self._state_ns = self._jumps = 0
        self._told_s = 0.0

    def step(self, now_s: float) -> None:
        """Run the guidance once for each new navigation state."""
        helm = self.helm.fresh(now_s)
        self._retune(helm, now_s)
        state = self.navigation.fresh(now_s)
        if helm is None or state is None or not self._usable(helm, state, now_s):
            self._running = None
        elif self.navigation.updated:
            self._control(helm, state, now_s)
        if now_s - self._told_s >= STATUS_PERIOD_S - 1e-3:  # steps come at 1/30 s, and round off
            self._told_s = now_s
            self._tell(helm, now_s)

    def _tuning_desk(self, config: ControllerConfig) -> TuningDesk | None:
        """Return what tunes the positioning law, or the heading loop of a vessel that steers only."""
        tools, shaping = self.tools, config.reference_filter
        try:
            if serving(tools.vessel) == Heading.serves and tools.limits[2] > 0.0:
                heading = Heading(config.steering, tools.vessel, tools.limits)
                return TuningDesk(tools.vessel, tools.limits, heading, config.steering, None)
        except ValueError:
            return None  # guidance_for says why
        if (law := tools.positioning) is None:
            return None
        parameters, shape = config.laws.get(law.name, law.Parameters()), shaping.shaping if shaping.enabled else None
        return TuningDesk(tools.vessel, tools.limits, law, parameters, shape)

    def _retune(self, helm: HelmState | None, now_s: float) -> None:
        """Answer requests for another law or other gains; go on with them without a jump."""
        desk, requests = self._desk, self.tunings.take()
        if desk is None:
            for request in requests:
                self.answer.publish(answered(request, self.note or "there is no law"))
            return
        if not requests and not desk.due(now_s):
            return
        changed, answers = desk.step(now_s, helm, self.former_gains.latest, requests)
        for answer in answers:
            self.answer.publish(answer)
        if changed:
            self._exchange(desk.law, desk.vessel)
        if (news := desk.news(now_s, changed=changed)) is not None:
            self.gains.publish(news)

    def _exchange(self, law: ControlLaw, vessel: Vessel) -> None:
        """Take over from what acts by another law; all modes are designed anew for the vessel's models."""
        tools, shaping = self.tools, self._config.reference_filter
        if isinstance(law, Heading):
            tools.steering = law.parameters
            tools.positioning = tools.positioning and self._config.build(self._config.positioning, vessel, tools.limits)
        else:
            tools.positioning = law
        tools.vessel, tools.motion = vessel, shaping.motion(vessel, tools.limits)
        tools.filter = ReferenceFilter(tools.motion) if shaping.enabled else None
        self._guidance, self._running = guidance_for(tools)[0], None

    def _control(self, helm: HelmState, state: NavigationState, now_s: float) -> None:
        guidance = self._guidance.get(helm.law)
        if guidance is None:
            self._running = None
            return
        x, y, psi, u, v, r, d_x, d_y, d_n, jumps, stamp_ns, origin_ns = _estimated(state.__dict__)
        attained, ours, request_id = self.attained.fresh(now_s), _ours(helm), helm.request_id
        entering = helm.suspended or guidance is not self._running or ours != self._ours or jumps != self._jumps
        given, dt_s, missing = _given(attained), 0.0, ZERO
        if not entering:
            gap_s = (stamp_ns - self._state_ns) / NS
            if gap_s > 0.0:
                dt_s = gap_s if gap_s < MAX_STEP_S else MAX_STEP_S
            mine = (False, False, False) if helm.guard else ours
            missing = missing_of(self._demand, given, _short(attained), mine)
        eta, nu, disturbance = (x, y, psi), (u, v, r), (d_x or 0.0, d_y or 0.0, d_n or 0.0)
        along_m = self._along_m(request_id)
        seen = Seen(dt_s, eta, nu, given, missing, disturbance, ours, along_m, self.wall.latest)
        if entering:
            guidance.engage(helm, seen)
        self._demand = X, Y, N = guidance.step(helm, seen)
        self._running, self._ours, self._state_ns, self._jumps = guidance, ours, stamp_ns, jumps
        self._order = request_id
        Z = self._depth.step(dt_s, helm.z_m, state, attained) if self._depth else None
        self.wrench.publish(Wrench(origin_ns=origin_ns, surge_n=X, sway_n=Y, heave_n=Z, yaw_nm=N))

    def _usable(self, helm: HelmState, state: NavigationState, now_s: float) -> bool:
        """Whether what this law goes by is known: the pose, or the wall."""
        known = state if helm.law != DistanceGuidance.law else self.wall.fresh(now_s)
        return known is not None and known.status in ("tracking", "predicting")

    def _along_m(self, request_id: str) -> float:
        """Return how far the path of this request was followed, by this process or the one before it."""
        former = self.former.latest
        if former is not None and former.along_m is not None:
            self._followed = former.request_id, former.along_m
        followed, along_m = self._followed
        return along_m if followed == request_id and along_m > 0.0 else 0.0

    def _tell(self, helm: HelmState | None, now_s: float) -> None:
        if self._running is None or helm is None:
            self.status.publish(ControlStatus(law="", in_charge=False))
            return
        attained = self.attained.fresh(now_s)
        self.status.publish(
            ControlStatus(
                in_charge=not helm.suspended,
                saturated=attained is not None and attained.limited,
                request_id=self._order,
                error_z_m=self._depth.error_m if self._depth else None,
                **self._running.told(),
            )
        )


def _ours(helm: HelmState) -> tuple[bool, bool, bool]:
    """Return which of surge, sway and yaw are the controller's."""
    source = helm.sources.get
    surge, sway, yaw = source("surge", "controller"), source("sway", "controller"), source("yaw", "controller")
    return surge == "controller", sway == "controller", yaw == "controller"


def _given(attained: AttainedWrench | None) -> Vector3:
    """Return [X Y N] as attained; zero when the allocator is silent: it has stopped the actuators."""
    if attained is None:
        return ZERO
    return attained.surge_n or 0.0, attained.sway_n or 0.0, attained.yaw_nm or 0.0


def _short(attained: AttainedWrench | None) -> Vector3:
    """Return [X Y N] attained less demanded: zero within the limits."""
    if attained is None or not attained.limited:
        return ZERO
    X, Y, N = _given(attained)
    return (
        X - (attained.demanded_surge_n or 0.0),
        Y - (attained.demanded_sway_n or 0.0),
        N - (attained.demanded_yaw_nm or 0.0),
    )
