"""The authority: a switch per axis between joystick, controller and experiment. Nobody else feeds the allocator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

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
from marine.guidance.keep_inside import GAP_M, PoolGuard
from marine.vessel import Vessel
from services.helm_modes import (
    CONTROLLER,
    EXPERIMENT,
    MANUAL,
    MODES,
    WALL_LAW,
    Checks,
    Reference,
    Refused,
    Task,
    law_of,
)
from services.models_in_force import vessel_in_force

STATE_PERIOD_S = 0.2
RESTORE_S = 1.0
"""How long a helm that has just started waits for its former state from the hub."""
GUARD_TOLD_S = 0.5
"""How long helm/state tells of the guard after it has last changed a wrench."""


class HelmConfig(Section):
    """Section [helm]."""

    resume_within_s: float = Field(10.0, gt=0, description="suspended for longer: stop")
    guard: bool = Field(True, description="no mode, the stick included, may drive the hull into a wall of the pool")
    request_max_age_s: float = Field(2.0, gt=0, description="an older request is refused: it may have lain somewhere")


@dataclass
class Lease:
    """Who has the helm, and until when. An attended one excludes other clients."""

    holder: str = ""
    attended: bool = False
    expires_s: float = 0.0

    def excludes(self, client: str, now_s: float) -> bool:
        """Whether another client is kept out."""
        return self.attended and self.holder not in ("", client) and now_s < self.expires_s


class Helm(Service):
    """Grant requests, pass on the wrench of the source in charge, suspend when source or pose go silent."""

    name = "helm"
    rate_hz = 20.0
    quick = True
    requests = Input(topics.OPERATOR_REQUEST, queue=32, wakes=True)
    joystick = Input(topics.OPERATOR_JOYSTICK, max_age_s=0.5, wakes=True)
    control = Input(topics.CONTROL_WRENCH, max_age_s=0.25, wakes=True)
    guidance = Input(topics.CONTROL_STATUS, max_age_s=1.0)
    experiment = Input(topics.EXPERIMENT_WRENCH, max_age_s=0.25, wakes=True)
    progress = Input(topics.EXPERIMENT_STATUS, wakes=True)
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25)
    wall = Input(topics.NAVIGATION_WALL, max_age_s=0.5)
    actuators = Input(topics.ACTUATOR_HEALTH)
    gains = Input(topics.CONTROL_GAINS, changed_only=True)
    former = Input(topics.HELM_STATE)
    wrench = Output(topics.HELM_WRENCH)
    state = Output(topics.HELM_STATE)
    answer = Output(topics.HELM_ANSWER)

    def __init__(self, config: HelmConfig, vessel: Vessel) -> None:
        self.config = config
        self._limits = axis_limits(vessel)
        self._take_vessel(vessel)
        self._guarded, self._guarded_s = "", -math.inf
        self._undertake("stop")
        self._fault = False
        self._suspended_at_s: float | None = None
        self._reason = ""
        self._request = ""
        self._lease = Lease()
        self._refused = 0
        self._restored = False
        self._started_s = 0.0
        self._told_s = 0.0
        self._told: tuple[object, ...] = ()

    def _take_vessel(self, vessel: Vessel) -> None:
        """Check and guard by the models of this vessel."""
        self.vessel, self._checks = vessel, Checks(vessel)
        self._guard = PoolGuard(vessel) if self.config.guard else None

    def _undertake(self, mode: Mode, reference: Reference | None = None, plan: ExperimentPlan | None = None) -> None:
        self._task = Task(mode, reference or Reference(), plan, heave=self._limits[2] > 0.0)

    def start(self, now_s: float) -> None:
        """Remember when: the former state may come from the hub within RESTORE_S."""
        self._started_s = now_s

    def step(self, now_s: float) -> None:
        """Restore once, answer requests, watch the lease, publish the wrench."""
        if (vessel := vessel_in_force(self.vessel, self.gains)) is not self.vessel:
            self._take_vessel(vessel)
        if not self._restored:
            self._restore(now_s)
        for request in self.requests.take():
            self._answer(request, now_s)
        self._watch_lease(now_s)
        self._steer(now_s)
        self._tell(now_s)

    # --- requests and lease ---------------------------------------------------------------------------------

    def _restore(self, now_s: float) -> None:
        """After a restart: take the former mode up again only if the operator's lease still lives."""
        former = self.former.latest
        if former is None:
            self._restored = now_s - self._started_s >= RESTORE_S
            return
        self._restored = True
        expires_s = former.lease_expires_ns / NS
        if former.mode in ("stop", "experiment") or former.mode not in MODES or now_s >= expires_s:
            return
        self._undertake(former.mode, Reference.of(former))
        self._lease = Lease(former.holder, former.attended, expires_s)
        self._request = former.request_id
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
            HelmAnswer(request_id=request.request_id, client=request.client, accepted=accepted, reason=reason[:400])
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
        """Without an operator a mode stays, stops, or becomes `hold`, as its row says."""
        self._lease = Lease()
        afterwards = self._task.rule.afterwards
        if afterwards == "stop":
            self._stop(reason)
        elif afterwards == "hold":
            self._hold_here(reason)

    def _enter(self, request: OperatorRequest, mode: Mode, now_s: float) -> str:
        self._checks.rule(mode)
        reference = Reference()
        plan = self._checks.plan(request) if mode == "experiment" else None
        if mode != "manual":
            pose, problem = self._pose(now_s, mode, law_of(mode, plan))
            if pose is None:
                raise Refused(f"no {mode} without a pose: {problem}")
            reference = self._checks.reference(request, mode, pose, self.wall.fresh(now_s))
            if plan and plan.speed_m_s is not None:
                reference = replace(reference, speed_m_s=plan.speed_m_s)
        self._request, self._fault = request.request_id, False
        entering = mode != self._task.mode
        self._undertake(mode, reference, plan)
        if entering:
            self._reason, self._suspended_at_s = "", None
        return str(reference)

    def _hold_here(self, reason: str) -> None:
        """Give all axes to the controller: hold the place where the vessel is; a vessel that cannot do that stops."""
        state = self.navigation.latest
        if state is None or not self._checks.can_hold:
            self._stop(reason)
            return
        self._hold(self._checks.here(state, GAP_M if self._guard else 0.0), reason)

    def _hold(self, reference: Reference, reason: str) -> None:
        self._undertake("hold", reference)
        self._reason = reason

    # --- the switch -----------------------------------------------------------------------------------------

    def _steer(self, now_s: float) -> None:
        if self._task.plan:
            self._watch_experiment()
        if self._task.law == "path":
            self._watch_path(now_s)
        if self._task.law:
            self._pass_on_or_suspend(now_s)
        elif self._task.mode == "manual":
            self._suspended_at_s = None
            self._publish(self._stick(now_s), None, self.navigation.fresh(now_s), now_s)
        else:
            self._publish_zero()

    def _stick(self, now_s: float) -> dict[str, float]:
        """Scale the stick with what the vessel can do on each axis; a silent or foreign joystick gives zero."""
        stick, (X, Y, Z, _, _, N) = self.joystick.fresh(now_s), self._limits
        ours = stick is not None and stick.client == self._lease.holder
        surge, sway, heave, yaw = (stick.surge, stick.sway, stick.heave, stick.yaw) if stick and ours else (0.0,) * 4
        wrench = {"surge_n": surge * X, "sway_n": sway * Y, "yaw_nm": yaw * N}
        return wrench | ({"heave_n": heave * Z} if Z else {})

    def _watch_experiment(self) -> None:
        status = self.progress.latest
        if status is not None and status.run == self._request and status.state not in ("idle", "running"):
            told = "the run is over" if status.state == "identifying" else status.state
            self._hold_here(f"{status.name}: {status.reason or told}")

    def _watch_path(self, now_s: float) -> None:
        """At the end of a path: hold there, or stop."""
        status = self.guidance.fresh(now_s)
        if status is None or not status.arrived or status.request_id != self._request:
            return
        reason = "the end of the path is reached"
        if not self._checks.can_hold:
            self._stop(reason)
            return
        x_m, y_m, psi_rad = status.reference_x_m, status.reference_y_m, status.reference_psi_rad
        self._hold(Reference(x_m, y_m, psi_rad, self._task.reference.z_m), reason)

    def _pass_on_or_suspend(self, now_s: float) -> None:
        """Pass on the wrench of the sources in charge while they and the pose are fresh; else suspend, later stop."""
        task, control = self._task, self.control
        wrench, problem = self._demand(now_s)
        state, lost = self._pose(now_s, task.mode, task.law)
        problem = lost or problem
        if not problem and wrench is not None and state is not None:
            if self._suspended_at_s is not None or task.plan:
                self._suspended_at_s, self._reason = None, ""
            if control.updated or (task.plan and self.experiment.updated):
                self._publish(wrench, control.latest, state, now_s)  # never twice: an old wrench stays old
            return
        self._suspend(problem, now_s)
        if self._suspended_at_s is not None and now_s - self._suspended_at_s > self.config.resume_within_s:
            self._stop(f"suspended for {self.config.resume_within_s:.0f} s: {problem}", fault=True)
        self._publish_zero()

    def _demand(self, now_s: float) -> tuple[dict[str, float] | None, str]:
        """Return what the sources of all axes demand, or None and who is silent."""
        task, control = self._task, self.control.fresh(now_s)
        if control is None:
            return None, "no wrench from the controller"
        said: dict[str, Mapping[str, float | None]] = {CONTROLLER: vars(control)}
        if task.plan:
            part = self.experiment.fresh(now_s)
            if part is None:
                return None, "no wrench from the experiment"
            said[EXPERIMENT] = vars(part)
        if task.has_stick:
            said[MANUAL] = self._stick(now_s)
        demand = {}
        for field, source in task.fields:
            value = said[source][field]
            if value is not None:
                demand[field] = value
        return demand, ""

    def _pose(self, now_s: float, mode: Mode, law: str) -> tuple[NavigationState | None, str]:
        """Return the estimated state if it may be used in this mode, or None and why not.

        What goes by the wall may lose the pose meanwhile.
        """
        state = self.navigation.fresh(now_s)
        if state is None:
            return None, "the estimator is silent"
        if law == WALL_LAW:
            wall = self.wall.fresh(now_s)
            seen = wall is not None and wall.status != "lost"
            return (state, "") if seen else (None, "the laser module has not seen the wall for too long")
        status, age_s = state.status, state.measurement_age_s
        if status not in ("tracking", "predicting") or age_s > self._checks.longest_s[mode]:
            return None, f"the pose is lost ({status}, last seen {age_s:.1f} s ago)"
        return state, ""

    def _publish(
        self, wrench: dict[str, float], origin: Wrench | None, state: NavigationState | None, now_s: float
    ) -> None:
        """Publish what acts: the guard has the last word."""
        speed_m_s = None
        if state is not None:
            told = vars(state)
            u, v = told["surge_m_s"], told["sway_m_s"]
            speed_m_s = math.hypot(u, v)
            if self._guard and told["status"] in ("tracking", "predicting"):
                (X, Y, N), why = self._guard.kept(
                    (wrench.get("surge_n", 0.0), wrench.get("sway_n", 0.0), wrench.get("yaw_nm", 0.0)),
                    (told["x_m"], told["y_m"], told["psi_rad"]),
                    (u, v, told["yaw_rad_s"]),
                    (told["disturbance_x_n"] or 0.0, told["disturbance_y_n"] or 0.0, told["disturbance_yaw_nm"] or 0.0),
                    (told["x_std_m"] or 0.0, told["y_std_m"] or 0.0),
                )
                if why:
                    wrench = wrench | {"surge_n": X, "sway_n": Y, "yaw_nm": N}
                    self._guarded, self._guarded_s = why, now_s
        origin_ns = origin.origin_ns if origin else None
        self.wrench.publish(HelmWrench(mode=self._task.mode, origin_ns=origin_ns, speed_m_s=speed_m_s, **wrench))

    def _publish_zero(self) -> None:
        self.wrench.publish(HelmWrench(mode=self._task.mode, surge_n=0.0, sway_n=0.0, yaw_nm=0.0))

    def _suspend(self, reason: str, now_s: float) -> None:
        if self._suspended_at_s is None:
            self._suspended_at_s = now_s
        self._reason = reason

    def _stop(self, reason: str, *, fault: bool = False) -> None:
        self._undertake("stop")
        self._fault, self._reason, self._suspended_at_s = fault, reason, None
        self._lease = Lease()

    def _tell(self, now_s: float) -> None:
        """Publish the latched state, at every change and five times a second."""
        if not self._restored:
            return  # it would overwrite the former state in the hub
        health = self.actuators.latest
        reason = self._reason or (health.reason if health else "")
        task, moving = self._task, self._suspended_at_s is None
        guarded = self._guarded if task.mode != "stop" and now_s - self._guarded_s < GUARD_TOLD_S else ""
        content = (
            task.mode, self._fault, moving, reason, task.reference, self._lease.holder, self._refused, task.plan,
            self._request, guarded,
        )  # fmt: skip
        if content == self._told and now_s - self._told_s < STATE_PERIOD_S:
            return
        self._told, self._told_s = content, now_s
        self.state.publish(
            HelmState(
                mode=task.mode,
                status="fault" if self._fault else "disarmed" if task.mode == "stop" else "armed",
                suspended=not moving,
                reason=reason,
                **vars(task.reference),
                request_id=self._request,
                guard=guarded,
                sources=task.sources,
                law=task.law,
                experiment=task.plan,
                experiment_run=self._request if task.plan else "",
                holder=self._lease.holder,
                attended=self._lease.attended,
                lease_expires_ns=round(self._lease.expires_s * NS),
                refused=self._refused,
            )
        )

    def stop(self, now_s: float) -> None:
        """Let go of the actuators."""
        self._publish_zero()
