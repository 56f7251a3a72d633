"""The authority: a switch per axis between joystick, controller and experiment. Nobody else feeds the allocator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Section
from bus.messages import (
    ExperimentPlan,
    HelmAnswer,
    HelmState,
    HelmWrench,
    Mode,
    NavigationState,
    OperatorRequest,
    Wrench,
)
from bus.service import Input, Output, Service
from marine.allocation import axis_limits
from marine.frames import wrap_angle
from marine.vessel import Vessel

Source = Literal["manual", "controller", "experiment"]
_MANUAL: Source = "manual"
_CONTROLLER: Source = "controller"
_EXPERIMENT: Source = "experiment"

HORIZONTAL = ("surge", "sway", "yaw")
AXIS_FIELDS = {"surge": "surge_n", "sway": "sway_n", "heave": "heave_n", "yaw": "yaw_nm"}
LAWS: dict[Mode, str] = {"hold": "positioning", "heading": "positioning", "experiment": "positioning"}
"""Modes that a control law serves -> the law that the controller runs."""
MODES: tuple[Mode, ...] = ("stop", "manual", "hold", "heading", "experiment")
"""Modes that there are so far."""
STATE_PERIOD_S = 0.2
RESTORE_S = 1.0
"""How long a helm that has just started waits for its former state from the hub."""


class HelmConfig(Section):
    """Section [helm]."""

    resume_within_s: float = Field(10.0, gt=0, description="suspended for longer: stop")
    request_max_age_s: float = Field(2.0, gt=0, description="an older request is refused: it may have lain somewhere")


@dataclass(frozen=True)
class Reference:
    """Where to hold: position in {E} in m, heading in rad."""

    x_m: float
    y_m: float
    psi_rad: float


@dataclass
class Lease:
    """Who has the helm, and until when. An attended one excludes other clients."""

    holder: str = ""
    attended: bool = False
    expires_s: float = 0.0

    def excludes(self, client: str, now_s: float) -> bool:
        """Whether another client is kept out."""
        return self.attended and self.holder not in ("", client) and now_s < self.expires_s


class Refused(Exception):  # noqa: N818 - it is an answer, not an error
    """A request that cannot be granted; the text is the reason."""


class Helm(Service):
    """Grant requests, pass on the wrench of the source in charge, suspend when source or pose go silent."""

    name = "helm"
    rate_hz = 20.0
    requests = Input(topics.OPERATOR_REQUEST, queue=32, wakes=True)
    joystick = Input(topics.OPERATOR_JOYSTICK, max_age_s=0.5, wakes=True)
    control = Input(topics.CONTROL_WRENCH, max_age_s=0.25, wakes=True)
    experiment = Input(topics.EXPERIMENT_WRENCH, max_age_s=0.25, wakes=True)
    progress = Input(topics.EXPERIMENT_STATUS, wakes=True)
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25)
    former = Input(topics.HELM_STATE)
    wrench = Output(topics.HELM_WRENCH)
    state = Output(topics.HELM_STATE)
    answer = Output(topics.HELM_ANSWER)

    def __init__(self, config: HelmConfig, vessel: Vessel) -> None:
        self.config = config
        self.vessel = vessel
        self._limits = axis_limits(vessel)
        self._mode: Mode = "stop"
        self._fault = False
        self._suspended_at_s: float | None = None
        self._reason = ""
        self._reference: Reference | None = None
        self._plan: ExperimentPlan | None = None
        self._run = ""
        self._lease = Lease()
        self._refused = 0
        self._restored = False
        self._started_s = 0.0
        self._told_s = 0.0
        self._told: tuple[object, ...] = ()

    def start(self, now_s: float) -> None:
        """Remember when: the former state may come from the hub within RESTORE_S."""
        self._started_s = now_s

    def step(self, now_s: float) -> None:
        """Restore once, answer requests, watch the lease, publish the wrench."""
        self._restore(now_s)
        for request in self.requests.take():
            self._answer(request, now_s)
        self._watch_lease(now_s)
        self._steer(now_s)
        self._tell(now_s)

    # --- requests and lease ---------------------------------------------------------------------------------

    def _restore(self, now_s: float) -> None:
        """After a restart: take the former mode up again only if the operator's lease still lives."""
        if self._restored:
            return
        former = self.former.latest
        if former is None:
            self._restored = now_s - self._started_s >= RESTORE_S
            return
        self._restored = True
        expires_s = former.lease_expires_ns / NS
        if former.mode not in ("manual", "hold", "heading") or now_s >= expires_s:
            return
        self._mode = former.mode
        self._lease = Lease(former.holder, former.attended, expires_s)
        if former.x_m is not None and former.y_m is not None and former.psi_rad is not None:
            self._reference = Reference(former.x_m, former.y_m, former.psi_rad)
        self._suspend("the helm has started again", now_s)

    def _answer(self, request: OperatorRequest, now_s: float) -> None:
        self._restored = True  # who asks now decides, not the past
        try:
            reason = self._grant(request, now_s)
            accepted = True
        except Refused as refusal:
            reason, accepted = str(refusal), False
            self._refused += 1
        self.answer.publish(
            HelmAnswer(request_id=request.request_id, client=request.client, accepted=accepted, reason=reason)
        )

    def _grant(self, request: OperatorRequest, now_s: float) -> str:
        if request.action == "mode" and request.mode == "stop":  # from anyone, however old, at any time
            self._stop("stopped by " + request.client)
            return ""
        age_s = now_s - request.stamp_ns / NS
        if abs(age_s) > self.config.request_max_age_s:
            raise Refused(f"the request is {age_s:.1f} s old: ask again")
        if request.action != "mode":
            return self._renew_or_release(request, now_s)
        if request.mode is None:
            raise Refused("no mode named")
        if self._lease.excludes(request.client, now_s) and not request.take:
            raise Refused(f"{self._lease.holder} has the helm: take over to act")
        reason = self._enter(request, request.mode, now_s)
        self._lease = Lease(request.client, request.attended, now_s + request.lease_s * self.warp)
        return reason

    def _renew_or_release(self, request: OperatorRequest, now_s: float) -> str:
        if request.client != self._lease.holder:
            raise Refused(f"{request.client} does not have the helm")
        if request.action == "renew":
            self._lease.expires_s = now_s + request.lease_s * self.warp
        else:
            self._end_lease("the operator has let go")
        return ""

    def _watch_lease(self, now_s: float) -> None:
        if self._lease.holder and now_s >= self._lease.expires_s:
            self._end_lease("the operator's page is gone")

    def _end_lease(self, reason: str) -> None:
        """Without an operator `manual` ends, `hold` goes on, an experiment and `heading` become `hold`."""
        self._lease = Lease()
        if self._mode == "manual":
            self._stop(reason)
        elif self._mode in ("experiment", "heading"):
            self._hold_here(reason)

    def _enter(self, request: OperatorRequest, mode: Mode, now_s: float) -> str:
        if mode not in MODES:
            raise Refused(f"{self.vessel.name} has no mode {mode} yet; known: {', '.join(MODES)}")
        if mode == "heading":  # the place is the stick's
            request = request.model_copy(update={"x_m": None, "y_m": None})
        reference = None if mode == "manual" else self._checked_reference(request, now_s)
        self._plan = self._checked_plan(request) if mode == "experiment" else None
        self._run = request.request_id
        entering = mode != self._mode
        self._mode, self._reference, self._fault = mode, reference, False
        if entering:
            self._reason, self._suspended_at_s = "", None
        if reference is None:
            return ""
        if mode == "heading":
            return f"psi {math.degrees(reference.psi_rad):.1f} deg"
        return f"x {reference.x_m:.3f} m, y {reference.y_m:.3f} m, psi {math.degrees(reference.psi_rad):.1f} deg"

    def _checked_plan(self, request: OperatorRequest) -> ExperimentPlan:
        """Return the plan of an experiment that the vessel has an axis for."""
        plan = request.experiment
        if plan is None:
            raise Refused("which experiment? the request names none")
        component = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}[plan.axis]
        if component not in self.vessel.controlled:
            raise Refused(f"{self.vessel.name} has no actuators for {plan.axis}")
        return plan

    def _hold_here(self, reason: str) -> None:
        """Give all axes to the controller: hold the place where the vessel is."""
        state, margin, pool = self.navigation.latest, self.vessel.radius_m, self.vessel.pool
        if state is not None:
            x_m = max(margin, min(pool.length_x_m - margin, state.x_m))
            y_m = max(margin, min(pool.length_y_m - margin, state.y_m))
            self._reference = Reference(x_m, y_m, state.psi_rad)
        self._mode, self._plan, self._reason = "hold", None, reason

    def _checked_reference(self, request: OperatorRequest, now_s: float) -> Reference:
        """Return the reference of a hold; what the request leaves open is where the vessel is now."""
        pose, problem = self._pose(now_s)
        if pose is None:
            raise Refused(f"no hold without a pose: {problem}")
        reference = Reference(
            pose.x_m if request.x_m is None else request.x_m,
            pose.y_m if request.y_m is None else request.y_m,
            wrap_angle(pose.psi_rad if request.psi_rad is None else request.psi_rad),
        )
        margin, pool = self.vessel.radius_m, self.vessel.pool
        if request.x_m is None and request.y_m is None:
            return reference  # here is where it floats: never refused, not even at the wall
        for axis, value, size in (("x", reference.x_m, pool.length_x_m), ("y", reference.y_m, pool.length_y_m)):
            if not margin <= value <= size - margin:
                raise Refused(f"{axis} must lie in {margin:.2f} ... {size - margin:.2f} m, inside the pool")
        return reference

    # --- the switch -----------------------------------------------------------------------------------------

    def _steer(self, now_s: float) -> None:
        if self._mode == "experiment":
            self._watch_experiment()
        if self._mode in LAWS:
            self._pass_on_or_suspend(now_s)
        elif self._mode == "manual":
            self._manual(now_s)
        else:
            self._publish_zero()

    def _manual(self, now_s: float) -> None:
        """Pass on what the stick asks for."""
        self._suspended_at_s = None
        speed_m_s = _speed_m_s(self.navigation.fresh(now_s))
        self.wrench.publish(HelmWrench(mode="manual", speed_m_s=speed_m_s, **self._stick(now_s)))

    def _stick(self, now_s: float) -> dict[str, float]:
        """Scale the stick with what the vessel can do on each axis; a silent or foreign joystick gives zero."""
        stick, (X, Y, _, _, _, N) = self.joystick.fresh(now_s), self._limits
        if stick is None or stick.client != self._lease.holder:
            return {"surge_n": 0.0, "sway_n": 0.0, "yaw_nm": 0.0}
        return {"surge_n": stick.surge * X, "sway_n": stick.sway * Y, "yaw_nm": stick.yaw * N}

    def _watch_experiment(self) -> None:
        status = self.progress.latest
        if status is not None and status.run == self._run and status.state not in ("idle", "running"):
            self._hold_here(f"{status.name}: {status.reason or status.state}")

    def _pass_on_or_suspend(self, now_s: float) -> None:
        """Pass on the wrench of the sources in charge while they and the pose are fresh; else suspend, later stop."""
        wrench, problem = self._demand(now_s)
        state, lost = self._pose(now_s)
        problem = lost or problem
        if not problem and wrench is not None:
            if self._suspended_at_s is not None or self._mode == "experiment":
                self._suspended_at_s, self._reason = None, ""
            if self.control.updated or (self._plan and self.experiment.updated):
                self._pass_on(wrench, state)  # never published twice: an old wrench stays old
            return
        self._suspend(problem, now_s)
        if self._suspended_at_s is not None and now_s - self._suspended_at_s > self.config.resume_within_s:
            self._stop(f"suspended for {self.config.resume_within_s:.0f} s: {problem}", fault=True)
        self._publish_zero()

    def _demand(self, now_s: float) -> tuple[Wrench | None, str]:
        """Return the controller's wrench, with the axes of other sources from there, or None and who is silent."""
        wrench = self.control.fresh(now_s)
        if wrench is not None and self._mode == "heading":
            return wrench.model_copy(update=self._stick(now_s) | {"yaw_nm": wrench.yaw_nm}), ""
        if wrench is None or self._plan is None:
            return wrench, "" if wrench else "no wrench from the controller"
        part = self.experiment.fresh(now_s)
        if part is None:
            return None, "no wrench from the experiment"
        field = AXIS_FIELDS[self._plan.axis]
        return wrench.model_copy(update={field: getattr(part, field)}), ""

    def _pose(self, now_s: float) -> tuple[NavigationState | None, str]:
        """Return the estimated state if it may be used in this mode, or None and why not."""
        state = self.navigation.fresh(now_s)
        if state is None:
            return None, "the estimator is silent"
        validity = self.vessel.validity
        longest_s = validity.heading_s if self._mode == "heading" else validity.hold_s
        if state.status not in ("tracking", "predicting") or state.measurement_age_s > longest_s:
            return None, f"the pose is lost ({state.status}, last seen {state.measurement_age_s:.1f} s ago)"
        return state, ""

    def _pass_on(self, wrench: Wrench, state: NavigationState | None) -> None:
        speed_m_s, content = _speed_m_s(state), wrench.components()
        self.wrench.publish(HelmWrench(mode=self._mode, origin_ns=wrench.origin_ns, speed_m_s=speed_m_s, **content))

    def _publish_zero(self) -> None:
        self.wrench.publish(HelmWrench(mode=self._mode, surge_n=0.0, sway_n=0.0, yaw_nm=0.0))

    def _suspend(self, reason: str, now_s: float) -> None:
        if self._suspended_at_s is None:
            self._suspended_at_s = now_s
        self._reason = reason

    def _stop(self, reason: str, *, fault: bool = False) -> None:
        self._mode, self._fault, self._reason = "stop", fault, reason
        self._reference, self._suspended_at_s, self._plan = None, None, None
        self._lease = Lease()

    def _tell(self, now_s: float) -> None:
        """Publish the latched state, at every change and five times a second."""
        if not self._restored:
            return  # it would overwrite the former state in the hub
        content = (
            self._mode, self._fault, self._suspended_at_s is None, self._reason, self._reference, self._lease.holder,
            self._refused, self._plan, self._run,
        )  # fmt: skip
        if content == self._told and now_s - self._told_s < STATE_PERIOD_S:
            return
        self._told, self._told_s = content, now_s
        reference = self._reference
        self.state.publish(
            HelmState(
                mode=self._mode,
                status="fault" if self._fault else "disarmed" if self._mode == "stop" else "armed",
                suspended=self._suspended_at_s is not None,
                reason=self._reason,
                x_m=reference.x_m if reference else None,
                y_m=reference.y_m if reference else None,
                psi_rad=reference.psi_rad if reference else None,
                sources=self._sources(),
                law=LAWS.get(self._mode, ""),
                experiment=self._plan,
                experiment_run=self._run if self._plan else "",
                holder=self._lease.holder,
                attended=self._lease.attended,
                lease_expires_ns=round(self._lease.expires_s * NS),
                refused=self._refused,
            )
        )

    def _sources(self) -> dict[str, Source]:
        """Return who has which axis."""
        if self._mode == "stop":
            return {}
        everything = dict.fromkeys(HORIZONTAL, _MANUAL if self._mode in ("manual", "heading") else _CONTROLLER)
        if self._mode == "heading":
            everything["yaw"] = _CONTROLLER
        return everything | ({self._plan.axis: _EXPERIMENT} if self._plan else {})

    def stop(self, now_s: float) -> None:
        """Let go of the actuators."""
        self._publish_zero()


def _speed_m_s(state: NavigationState | None) -> float | None:
    return math.hypot(state.surge_m_s, state.sway_m_s) if state else None
