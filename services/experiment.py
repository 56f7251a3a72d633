"""Identification experiments on the running system: one axis pushed by a state machine, the others held.

The helm gives the axis (mode experiment); the record is made of what the vessel's own sensors measured and of delivered
forces, not of the estimator's state, whose filter knows a model already.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Deployment, Section
from bus.messages import (
    AXIS_FIELDS,
    ControlGains,
    ExperimentAxis,
    ExperimentPlan,
    ExperimentResult,
    ExperimentStatus,
    HelmState,
    IdentifiedModel,
    NavigationState,
    Wrench,
)
from bus.service import Input, Output, Service
from marine.allocation import axis_limits
from marine.guidance.abilities import yaw_limit_at
from marine.identification.experiments import Experiment, ExperimentError, Motion, Relay, design
from marine.identification.record import compare, response
from marine.identification.result import IdentificationError, Identified
from marine.vessel import DegreeOfFreedom, Vessel
from services.experiment_run import Run, Watch, as_parameters, period_of, room, room_before, running_estimate, sensor_of
from services.identified_vessel import IdentifiedVesselError, write_models, write_vessel
from services.models_in_force import vessel_in_force

STATUS_PERIOD_S = 0.2
ESTIMATE_PERIOD_S = 1.0
PLOTTED = 300
"""Points of the response that the result carries."""
START_S = 1.0
"""The helm may be suspended for so long at the beginning."""
ROWS = {"surge": 0, "sway": 1, "heave": 2, "yaw": 5}


class ExperimentConfig(Section):
    """Section [experiment]."""

    longest_s: float = Field(180.0, gt=0, description="of an experiment whose plan names no duration")
    sample_s: float | None = Field(None, gt=0, description="of the grid of the record; none: that of the sensor")
    delay_s: float | None = Field(
        None,
        ge=0,
        description="known delay to the thrust besides the vessel file's; none: half the link's shortest round trip",
    )
    instruments: bool | None = Field(
        None, description="record compass, position and depth, not the camera; none: where there is no camera"
    )
    always_yaw: bool = Field(False, description="estimate yaw all the time, from whatever turns the vessel")
    save: bool = Field(True, description="write a vessel file with each identified model beside the recordings")


class Experiments(Service):
    """Push one axis as an experiment says, watch its guards, identify, publish and save the model."""

    name = "experiment"
    rate_hz = 10.0
    helm = Input(topics.HELM_STATE, max_age_s=1.0, wakes=True)
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25, wakes=True)
    pose = Input(topics.CAMERA_POSE, queue=32)
    compass = Input(topics.SENSOR_COMPASS, queue=32)
    position = Input(topics.SENSOR_POSITION, queue=32)
    depth = Input(topics.SENSOR_DEPTH, queue=32)
    laser = Input(topics.SENSOR_LASER, queue=32)
    wall = Input(topics.NAVIGATION_WALL, max_age_s=0.5)
    link = Input(topics.LINK_STATUS)
    delivered = Input(topics.ACTUATOR_DELIVERED, queue=64)
    former = Input(topics.EXPERIMENT_STATUS)  # of a process before this one, from the hub
    gains = Input(topics.CONTROL_GAINS, changed_only=True)
    wrench = Output(topics.EXPERIMENT_WRENCH)
    status = Output(topics.EXPERIMENT_STATUS)
    estimate = Output(topics.EXPERIMENT_ESTIMATE)
    result = Output(topics.EXPERIMENT_RESULT)

    def __init__(self, config: ExperimentConfig, vessel: Vessel, deployment: Deployment) -> None:
        self._config = config
        self._vessel = vessel
        self._vessel_path = deployment.vessel_path
        self._folder = deployment.recordings_dir / "identified"
        self._limits = axis_limits(vessel)
        self._run: Run | None = None
        self._seen = ""
        """The last run that was begun or refused."""
        self._status = ExperimentStatus(state="idle")
        self._told_s = 0.0
        self._estimated_s = 0.0
        self._round_trip_s = math.inf
        """The shortest seen: what is longer has waited somewhere."""
        self._yaw: Watch | None = None

    def step(self, now_s: float) -> None:
        """Begin, push, end."""
        helm = self.helm.fresh(now_s)
        state = self.navigation.fresh(now_s)
        self._vessel = vessel_in_force(self._vessel, self.gains)
        if self.link.latest is not None and self.link.latest.round_trip_s is not None:
            self._round_trip_s = min(self._round_trip_s, self.link.latest.round_trip_s)
        if self._run is not None and self._status.state == "identifying":
            self._identify(self._run)
        elif self._run is not None:
            self._go_on(self._run, helm, state, now_s)
        elif helm is not None and helm.experiment and helm.experiment_run != self._seen:
            self._begin(helm, helm.experiment, state, now_s)
        if self.gains.updated and self.gains.latest:
            self._save_engaged(self.gains.latest)
        if self._config.always_yaw and self._run is None:
            self._watch_yaw(now_s)
        if now_s - self._told_s >= STATUS_PERIOD_S:
            self._tell(self._status, now_s)

    # --- beginning and end

    def _begin(self, helm: HelmState, plan: ExperimentPlan, state: NavigationState | None, now_s: float) -> None:
        if state is None:
            return  # the helm waits, and stops if none comes
        self._seen = helm.experiment_run
        name = {"run": helm.experiment_run, "name": plan.name, "axis": plan.axis}
        former = self.former.latest
        if former is not None and former.run == helm.experiment_run:
            self._tell(
                ExperimentStatus(state="failed", reason="the experiment's process has started again", **name), now_s
            )
            return
        try:
            machine = self._design(plan, state, now_s)
        except ExperimentError as error:
            self._tell(ExperimentStatus(state="failed", reason=str(error)[:400], **name), now_s)
            return
        self._measured(plan.axis, plan.sensor).take()  # what came before
        live = running_estimate(machine.setup.dof, plan.axis, machine.setup.C, self._delay_s)
        self._run = Run(helm.experiment_run, plan, machine, Watch(plan.axis, live, state), state)
        self._tell(ExperimentStatus(state="running", **name), now_s)
        self._push(self._run, state, now_s)

    def _room(self, plan: ExperimentPlan, state: NavigationState, now_s: float) -> tuple[float, float]:
        if plan.sensor == "laser":
            return room_before(self.wall.fresh(now_s), self._vessel)
        return room(self._vessel.pool, self._vessel.radius_m, plan.axis, state)

    def _design(self, plan: ExperimentPlan, state: NavigationState, now_s: float) -> Experiment:
        dof = _dof(self._vessel, plan.axis)
        if plan.axis == "heave" and state.z_m is None:
            raise ExperimentError("no depth is measured")
        limit = self._limits[ROWS[plan.axis]]
        if plan.speed_m_s is not None:
            limit = yaw_limit_at(self._vessel, plan.speed_m_s)
        return design(
            plan.name,
            plan.amplitude,
            plan.direction,
            dof,
            limit,
            angular=plan.axis == "yaw",
            hysteresis=plan.hysteresis,
            count=plan.oscillations,
            longest_s=plan.duration_s or self._config.longest_s,
            room_m=self._room(plan, state, now_s),
        )

    def _go_on(self, run: Run, helm: HelmState | None, state: NavigationState | None, now_s: float) -> None:
        began_s = run.machine.began_s or now_s
        if helm is None or helm.experiment_run != run.run:
            problem = f"ended by the helm: {helm.reason or helm.mode}" if helm else "the helm is silent"
        elif state is None or (run.plan.sensor is None and state.status not in ("tracking", "predicting")):
            problem = "the pose is lost"
        elif helm.suspended and now_s - began_s > START_S:
            problem = f"the helm has suspended: {helm.reason}"
        else:
            problem = ""
        if problem or state is None:
            self._end(run, "failed", problem, now_s)
            return
        run.take(self._measured(run.plan.axis, run.plan.sensor).take(), self.delivered.take(), self._vessel.name)
        self._tell_estimate(run.watch, run.run, now_s)
        if self.navigation.updated:
            self._push(run, state, now_s, helm.guard if helm else "")

    def _sensor(self, axis: ExperimentAxis, sensor: Literal["laser"] | None = None) -> str:
        return sensor_of(self._vessel, axis, self._config.instruments, sensor)

    def _measured(self, axis: ExperimentAxis, sensor: Literal["laser"] | None = None) -> Input[Any]:
        """Return the port of the sensor that an axis is recorded from."""
        port: Input[Any] = getattr(self, self._sensor(axis, sensor))
        return port

    @property
    def _delay_s(self) -> float:
        """Known delay from delivered force to motion."""
        known = self._config.delay_s
        if known is None:
            known = 0.5 * self._round_trip_s if math.isfinite(self._round_trip_s) else 0.0
        return known + self._vessel.actuation_delay_s

    def _push(self, run: Run, state: NavigationState, now_s: float, guard: str = "") -> None:
        ahead_m, behind_m = self._room(run.plan, state, now_s)
        nu = {
            "surge": state.surge_m_s,
            "sway": state.sway_m_s,
            "heave": state.heave_m_s or 0.0,
            "yaw": state.yaw_rad_s,
        }[run.plan.axis]
        machine = run.machine
        force = machine.step(Motion(now_s, run.eta(state), nu, ahead_m, behind_m, guard))
        self._status = _progress(run, now_s)
        if force is None:
            if machine.failure:
                self._end(run, "failed", machine.failure, now_s)
            else:
                self._tell(self._status.model_copy(update={"state": "identifying", "reason": machine.note}), now_s)
            return
        self.wrench.publish(Wrench(origin_ns=state.origin_ns, **{AXIS_FIELDS[run.plan.axis]: force}))

    def _end(self, run: Run, state: Literal["done", "failed"], reason: str, now_s: float) -> None:
        self._run = None
        self._tell(_progress(run, now_s).model_copy(update={"state": state, "reason": reason[:400]}), now_s)

    def _tell(self, status: ExperimentStatus, now_s: float) -> None:
        self._status, self._told_s = status, now_s
        self.status.publish(status.model_copy(update={"stamp_ns": 0}))

    def _tell_estimate(self, watch: Watch, run: str, now_s: float) -> None:
        if now_s - self._estimated_s >= ESTIMATE_PERIOD_S:
            self._estimated_s = now_s
            self.estimate.publish(watch.estimate(run))

    def _watch_yaw(self, now_s: float) -> None:
        """Estimate yaw from whatever turns the vessel."""
        if self._yaw is None:
            dof = _dof(self._vessel, "yaw")
            self._yaw = Watch("yaw", running_estimate(dof, "yaw", 0.5 * self._limits[ROWS["yaw"]], self._delay_s))
        yaw = self._yaw
        yaw.take(self._measured("yaw").take(), self.delivered.take(), self._vessel.name)
        self._tell_estimate(yaw, "", now_s)

    # --- the result

    def _identify(self, run: Run) -> None:
        """Identify by all methods that suit, publish, save. The vessel is in the helm's hands again."""
        now_s = self._told_s
        self._run = None
        try:
            period_s = period_of(self._vessel, self._sensor(run.plan.axis, run.plan.sensor))
            record = run.record(self._config.sample_s, self._delay_s, period_s)
        except IdentificationError as error:
            self._end(run, "failed", str(error), now_s)
            return
        found = compare(record, run.plan.name)
        name, first = found[0]
        if isinstance(first, Identified) and run.machine.note:
            first = first.warned(run.machine.note)
            found[0] = (name, first)
        good = isinstance(first, Identified)
        saved = self._save(run, first) if isinstance(first, Identified) and self._config.save else ""
        shown = slice(None, None, max(1, len(record.t_s) // PLOTTED))
        simulated = response(record, first)[0] if isinstance(first, Identified) else np.empty(0)
        self.result.publish(
            ExperimentResult(
                run=run.run,
                plan=run.plan,
                began_ns=round(run.machine.used_from_s * NS),
                ended_ns=round((run.machine.ended_s or 0.0) * NS),
                force=run.machine.setup.C,
                methods=tuple(as_message(n, one) for n, one in found),
                vessel_file=saved,
                t_s=tuple(record.t_s[shown].tolist()),
                measured=tuple((record.eta - record.eta[0])[shown].tolist()),
                simulated=tuple((simulated - record.eta[0])[shown].tolist()) if good else (),
            )
        )
        reason = str(first) if isinstance(first, IdentificationError) else run.machine.note
        self._end(run, "done" if good else "failed", reason, now_s)

    def _save(self, run: Run, found: Identified) -> str:
        when = _when(run.machine.ended_s or 0.0)
        return self._written(
            f"{run.plan.axis}-{when}",
            lambda source, target: write_vessel(source, target, run.plan.axis, found, f"{run.plan.name} {when} UTC"),
        )

    def _save_engaged(self, told: ControlGains) -> None:
        """Write a vessel file with all models of the tuning that was engaged, where they are not the file's."""
        models: dict[str, dict[str, tuple[float, float]]] = {
            axis: {name: (value, 0.0) for name, value in model}
            for axis, model in told.tuning.models.items()
            if told.engaged and model != told.configured.models[axis]
        }
        when = _when(told.since_ns / NS)
        if models and self._config.save:
            saved = self._written(
                f"engaged-{when}",
                lambda source, target: write_models(source, target, models, f"engaged by {told.by} {when} UTC"),
            )
            self.note = f"engaged models: {saved}"[:400] if saved else self.note

    def _written(self, name: str, write: Callable[[Path, Path], None]) -> str:
        """Return the path of a vessel file beside the recordings, empty when it cannot be written."""
        if self._vessel_path is None:
            return ""
        target = self._folder / f"{self._vessel.name}-{name}.toml"
        try:
            write(self._vessel_path, target)
        except (IdentifiedVesselError, OSError) as error:
            self.note = f"no vessel file was written: {error}"
            self.log.warning(self.note)
            return ""
        return str(target)


def _when(stamp_s: float) -> str:
    return datetime.fromtimestamp(stamp_s, UTC).strftime("%Y%m%d-%H%M%S")


def as_message(method: str, found: Identified | IdentificationError) -> IdentifiedModel:
    """Return a result, or why there is none, as it goes over the bus."""
    if isinstance(found, IdentificationError):
        return IdentifiedModel(method=method, failure=str(found)[:400])
    return IdentifiedModel(
        method=found.method,
        model=found.model,
        parameters=as_parameters(found),
        warnings=tuple(w[:400] for w in found.warnings),
    )


def _dof(vessel: Vessel, axis: str) -> DegreeOfFreedom:
    dof: DegreeOfFreedom | None = getattr(vessel.model, axis)
    if dof is None:
        raise ExperimentError(f"{vessel.name} has no model of {axis}")
    return dof


def _progress(run: Run, now_s: float) -> ExperimentStatus:
    machine = run.machine
    monitor = machine.monitor if isinstance(machine, Relay) else None
    last = monitor.swings[-1] if monitor and monitor.swings else None
    return ExperimentStatus(
        state="running",
        run=run.run,
        name=run.plan.name,
        axis=run.plan.axis,
        unit="rad" if run.plan.axis == "yaw" else "m",
        phase=machine.phase,
        progress=max(0.0, min(1.0, machine.progress)),
        elapsed_s=max(0.0, now_s - (machine.began_s or now_s)),
        force=machine.force,
        oscillations=monitor.consecutive if monitor else 0,
        half_period_s=monitor.halves[-1] if monitor and monitor.halves else None,
        amplitude=last.X_m if last else None,
        bias=last.x_0 if last else None,
        spread=monitor.spread if monitor else None,
        advice=machine.advice[:400],
    )
