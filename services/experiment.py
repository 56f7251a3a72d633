"""Identification experiments on the running system: one axis pushed by a state machine, the others held.

The helm gives the axis (mode experiment); the record is made of measured poses and delivered forces, not of the
estimator's state, whose filter knows a model already.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Deployment, Section
from bus.messages import (
    ControlGains,
    ExperimentPlan,
    ExperimentResult,
    ExperimentStatus,
    HelmState,
    IdentifiedModel,
    IdentifiedParameter,
    NavigationState,
    Wrench,
)
from bus.service import Input, Output, Service
from marine.allocation import axis_limits
from marine.identification.experiments import Experiment, ExperimentError, Motion, Relay, design
from marine.identification.record import Record, along, compare, on_grid, response
from marine.identification.result import IdentificationError, Identified
from marine.vessel import DegreeOfFreedom, Pool, Vessel
from services.identified_vessel import IdentifiedVesselError, write_models, write_vessel

STATUS_PERIOD_S = 0.2
PLOTTED = 300
"""Points of the response that the result carries."""
START_S = 1.0
"""The helm may be suspended for so long at the beginning."""
FIELDS = {"surge": "surge_n", "sway": "sway_n", "heave": "heave_n", "yaw": "yaw_nm"}
ROWS = {"surge": 0, "sway": 1, "heave": 2, "yaw": 5}


class ExperimentConfig(Section):
    """Section [experiment]."""

    longest_s: float = Field(180.0, gt=0, description="of an experiment whose plan names no duration")
    sample_s: float | None = Field(None, gt=0, description="of the grid of the record; none: that of the poses")
    delay_s: float = Field(
        0.0,
        ge=0,
        description="known delay from command to thrust besides the vessel file's: a radio's, a polled port's",
    )
    save: bool = Field(True, description="write a vessel file with each identified model beside the recordings")


class Run:
    """One experiment under way: its machine, and what was measured so far."""

    def __init__(self, run: str, plan: ExperimentPlan, machine: Experiment, state: NavigationState) -> None:
        self.run, self.plan, self.machine = run, plan, machine
        self.start = (state.x_m, state.y_m, state.z_m or 0.0, state.psi_rad)
        self.poses: list[tuple[float, float, float, float]] = []
        self.forces: list[tuple[float, float]] = []
        self.turned_rad = 0.0
        self.psi_rad = state.psi_rad

    def eta(self, state: NavigationState) -> float:
        """Return the way along the axis, or the angle turned, since the start."""
        x, y, z, psi = self.start
        if self.plan.axis == "yaw":
            self.turned_rad += math.remainder(state.psi_rad - self.psi_rad, math.tau)
            self.psi_rad = state.psi_rad
            return self.turned_rad
        if self.plan.axis == "heave":
            return (state.z_m or 0.0) - z
        c, s = math.cos(psi), math.sin(psi)
        dx, dy = state.x_m - x, state.y_m - y
        return dx * c + dy * s if self.plan.axis == "surge" else dy * c - dx * s

    def record(self, sample_s: float | None, delay_s: float) -> Record:
        """Return the record of the measurement; raise IdentificationError when there is none."""
        if not self.poses:
            raise IdentificationError("no camera pose came in this time")
        t, x, y, psi = np.array(self.poses).T
        angular = self.plan.axis == "yaw"
        eta = psi if angular else along(x, y, self.start[3], sway=self.plan.axis == "sway")
        tau_s, tau = np.array(self.forces).reshape(-1, 2).T
        machine = self.machine
        return on_grid(
            t,
            eta,
            tau_s,
            tau,
            axis="angular" if angular else "linear",
            begin_s=machine.used_from_s,
            end_s=machine.ended_s or t[-1],
            sample_s=sample_s,
            delay_s=delay_s,
        )


class Experiments(Service):
    """Push one axis as an experiment says, watch its guards, identify, publish and save the model."""

    name = "experiment"
    rate_hz = 10.0
    helm = Input(topics.HELM_STATE, max_age_s=1.0, wakes=True)
    navigation = Input(topics.NAVIGATION_STATE, max_age_s=0.25, wakes=True)
    pose = Input(topics.CAMERA_POSE, queue=32)
    delivered = Input(topics.ACTUATOR_DELIVERED, queue=64)
    former = Input(topics.EXPERIMENT_STATUS)  # of a process before this one, from the hub
    gains = Input(topics.CONTROL_GAINS, changed_only=True)
    wrench = Output(topics.EXPERIMENT_WRENCH)
    status = Output(topics.EXPERIMENT_STATUS)
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

    def step(self, now_s: float) -> None:
        """Begin, push, end."""
        helm = self.helm.fresh(now_s)
        state = self.navigation.fresh(now_s)
        if self._run is not None and self._status.state == "identifying":
            self._identify(self._run)
        elif self._run is not None:
            self._go_on(self._run, helm, state, now_s)
        elif helm is not None and helm.experiment and helm.experiment_run != self._seen:
            self._begin(helm, helm.experiment, state, now_s)
        if self.gains.updated and self.gains.latest:
            self._save_engaged(self.gains.latest)
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
            machine = self._design(plan, state)
        except ExperimentError as error:
            self._tell(ExperimentStatus(state="failed", reason=str(error)[:400], **name), now_s)
            return
        self._run = Run(helm.experiment_run, plan, machine, state)
        self._tell(ExperimentStatus(state="running", **name), now_s)
        self._push(self._run, state, now_s)

    def _design(self, plan: ExperimentPlan, state: NavigationState) -> Experiment:
        dof = _dof(self._vessel, plan.axis)
        if plan.axis == "heave" and state.z_m is None:
            raise ExperimentError("no depth is measured")
        return design(
            plan.name,
            plan.amplitude,
            plan.direction,
            dof,
            self._limits[ROWS[plan.axis]],
            angular=plan.axis == "yaw",
            hysteresis=plan.hysteresis,
            count=plan.oscillations,
            longest_s=plan.duration_s or self._config.longest_s,
            room_m=room(self._vessel.pool, self._vessel.radius_m, plan.axis, state),
        )

    def _go_on(self, run: Run, helm: HelmState | None, state: NavigationState | None, now_s: float) -> None:
        began_s = run.machine.began_s or now_s
        if helm is None or helm.experiment_run != run.run:
            problem = f"ended by the helm: {helm.reason or helm.mode}" if helm else "the helm is silent"
        elif state is None or state.status not in ("tracking", "predicting"):
            problem = "the pose is lost"
        elif helm.suspended and now_s - began_s > START_S:
            problem = f"the helm has suspended: {helm.reason}"
        else:
            problem = ""
        if problem or state is None:
            self._end(run, "failed", problem, now_s)
            return
        self._take_in(run)
        if self.navigation.updated:
            self._push(run, state, now_s, helm.guard if helm else "")

    def _take_in(self, run: Run) -> None:
        for pose in self.pose.take():
            good = pose.name in ("", self._vessel.name) and not pose.heading_ambiguous and pose.quality >= 0.3
            if good and pose.x_m is not None and pose.y_m is not None:
                run.poses.append((pose.stamp_ns / NS, pose.x_m, pose.y_m, pose.psi_rad))
        for wrench in self.delivered.take():
            run.forces.append((wrench.stamp_ns / NS, getattr(wrench, FIELDS[run.plan.axis]) or 0.0))

    def _push(self, run: Run, state: NavigationState, now_s: float, guard: str = "") -> None:
        ahead_m, behind_m = room(self._vessel.pool, self._vessel.radius_m, run.plan.axis, state)
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
        self.wrench.publish(Wrench(origin_ns=state.origin_ns, **{FIELDS[run.plan.axis]: force}))

    def _end(self, run: Run, state: Literal["done", "failed"], reason: str, now_s: float) -> None:
        self._run = None
        self._tell(_progress(run, now_s).model_copy(update={"state": state, "reason": reason[:400]}), now_s)

    def _tell(self, status: ExperimentStatus, now_s: float) -> None:
        self._status, self._told_s = status, now_s
        self.status.publish(status.model_copy(update={"stamp_ns": 0}))

    # --- the result

    def _identify(self, run: Run) -> None:
        """Identify by all methods that suit, publish, save. The vessel is in the helm's hands again."""
        now_s = self._told_s
        self._run = None
        try:
            record = run.record(self._config.sample_s, self._config.delay_s + self._vessel.command_delay_s)
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


def room(pool: Pool, radius_m: float, axis: str, state: NavigationState) -> tuple[float, float]:
    """Return the free way ahead and behind along an axis of the vessel, in m; without walls for yaw and heave."""
    if axis not in ("surge", "sway"):
        return math.inf, math.inf
    psi = state.psi_rad + (math.pi / 2.0 if axis == "sway" else 0.0)
    ways = [math.inf, math.inf]
    for place, size, c in ((state.x_m, pool.length_x_m, math.cos(psi)), (state.y_m, pool.length_y_m, math.sin(psi))):
        if abs(c) < 1e-3:
            continue
        to_end, to_origin = (size - radius_m - place) / abs(c), (place - radius_m) / abs(c)
        ahead, behind = (to_end, to_origin) if c > 0.0 else (to_origin, to_end)
        ways = [min(ways[0], ahead), min(ways[1], behind)]
    return ways[0], ways[1]


def as_message(method: str, found: Identified | IdentificationError) -> IdentifiedModel:
    """Return a result, or why there is none, as it goes over the bus."""
    if isinstance(found, IdentificationError):
        return IdentifiedModel(method=method, failure=str(found)[:400])
    return IdentifiedModel(
        method=found.method,
        model=found.model,
        parameters=tuple(
            IdentifiedParameter(name=p.name, value=p.value, unit=p.unit, std=p.std if math.isfinite(p.std) else None)
            for p in found.parameters
        ),
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
