"""The estimator: where the vessel is, how fast, and what pushes it, from poses of the camera or from instruments."""

from __future__ import annotations

import copy
import math
from collections import deque
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from bus import topics
from bus.clock import NS
from bus.config import Section
from bus.messages import CameraPose, NavigationState, SensorCompass, SensorPosition
from bus.service import FUTURE_TOLERANCE_S, Input, Output, Service
from marine.allocation import axis_limits
from marine.dynamics.integrate import State
from marine.estimation.depth import DepthFilter
from marine.estimation.ekf import Array, EkfTuning, PoseEkf, Verdict
from marine.estimation.smoothing import CausalVelocities
from marine.frames import wrap_angle
from marine.vessel import Sensor, Vessel
from services.actuator_monitor import ActuatorMonitor, can_be_monitored
from services.models_in_force import vessel_in_force
from services.wall_tracker import WallTracker
from services.wrenches import Wrenches

_NEAREST_NS = 1_000_000
_FUTURE_NS = round(FUTURE_TOLERANCE_S * NS)
WALL_PERIOD_S = 0.1
DEPTH_LOST_S = 1.0
"""A depth sensor that says nothing for so long says nothing about now."""

JUMP_M, JUMP_RAD = 0.1, math.radians(10.0)
"""A measured pose that comes to lie so far from the estimate has jumped."""

Status = Literal["initialising", "tracking", "predicting", "lost"]


class EstimatorConfig(Section):
    """Section [estimator]. Walks are the random change within one second."""

    enabled: bool = Field(True, description="false: measured values are the estimates, velocities by a causal filter")
    position_noise_px: float = Field(0.2, gt=0)
    heading_noise_rad: float = Field(0.003, gt=0)
    velocity_walk_m_s: float = Field(0.003, gt=0)
    yaw_rate_walk_rad_s: float = Field(0.012, gt=0)
    force_walk_n: float = Field(0.06, gt=0)
    moment_walk_nm: float = Field(0.004, gt=0)
    gate: float = Field(25.0, gt=0, description="largest squared Mahalanobis distance of an innovation")
    jump_after: int = Field(5, ge=2, description="refused poses in a row that are believed")
    min_quality: float = Field(0.3, ge=0, le=1)
    predicting_after_s: float = Field(0.1, gt=0)
    lost_after_s: float = Field(1.0, gt=0)
    ready_std_m_s: float = Field(0.03, gt=0, description="initialising until surge and sway are known so well")
    fault_detection: bool = Field(True, description="look for actuators that do not give what they are commanded")
    smoothing_window: int = Field(15, ge=3)
    smoothing_order: int = Field(2, ge=1)

    @model_validator(mode="after")
    def _smoothing_is_possible(self) -> Self:
        if self.smoothing_order >= self.smoothing_window:
            raise ValueError("smoothing_order must be smaller than smoothing_window")
        return self


class Estimator(Service):
    """EKF of pose, velocity and disturbance (`marine.estimation.ekf`).

    The filter lives at the capture time of the last pose, which is older than now by the latency of camera and tracker.
    What is published is predicted from there to now, with the wrench that the allocator says is delivered. When the
    timer ends before the next pose comes (25 Hz against the camera's 30 Hz), a prediction is published.

    A vessel that dives has depth and heave from its depth sensor (`marine.estimation.depth`).
    One with a laser module has the wall before it (`services.wall_tracker`).
    Without a camera a position and the heading of the same moment are a pose, as exact as the vessel file says.
    """

    name = "estimator"
    rate_hz = 25.0
    quick = True

    pose = Input(topics.CAMERA_POSE, wakes=True, queue=16)
    position = Input(topics.SENSOR_POSITION, wakes=True, queue=16)
    compass = Input(topics.SENSOR_COMPASS, queue=16)
    depth = Input(topics.SENSOR_DEPTH, queue=16)
    laser = Input(topics.SENSOR_LASER, queue=16)
    delivered = Input(topics.ACTUATOR_DELIVERED, queue=16)
    command = Input(topics.ACTUATOR_COMMAND, queue=16)
    order = Input(topics.OPERATOR_ACTUATOR, queue=16)
    gains = Input(topics.CONTROL_GAINS, changed_only=True)
    state = Output(topics.NAVIGATION_STATE)
    wall = Output(topics.NAVIGATION_WALL)
    fault = Output(topics.ACTUATOR_FAULT)

    def __init__(self, config: EstimatorConfig, vessel: Vessel) -> None:
        self._config = config
        self._vessel = vessel
        self._pool = vessel.pool
        receiver, compass = vessel.sensor("position"), vessel.sensor("compass")
        position_m = config.position_noise_px / vessel.camera.scale_px_per_m
        heading_rad = config.heading_noise_rad
        self._lost_after_s, self._ready_std_m_s = config.lost_after_s, config.ready_std_m_s
        self._instruments = False
        if vessel.sensor("camera") is None and receiver and compass:
            self._instruments = True
            position_m, heading_rad = max(position_m, _std(receiver)), max(heading_rad, _std(compass))
            self._lost_after_s = max(self._lost_after_s, 3.0 * receiver.sample_time_s + receiver.delay_s)
            self._ready_std_m_s = max(self._ready_std_m_s, position_m)  # as well as 1 s of the receiver shows it
        self._wall, self._wall_s = WallTracker(vessel), 0.0
        unused: tuple[str, ...] = ("pose",) if self._instruments else ("position",)
        if not self._wall.possible:
            unused += ("laser", "wall") if self._instruments else ("laser", "wall", "compass")
        self._monitor: ActuatorMonitor | None = None
        if config.fault_detection and not self._instruments and can_be_monitored(vessel):
            self._monitor = ActuatorMonitor(vessel)
        else:
            unused += ("command", "order", "fault")
        self._depth = DepthTracker(vessel)
        if not self._depth.possible:
            unused += ("depth",)
        self.ports = {n: p for n, p in self.ports.items() if n not in unused}  # type: ignore[misc]  # of this object alone
        self._headings: deque[tuple[int, float]] = deque(maxlen=64)
        self._tuning = EkfTuning(
            position_m=position_m,
            heading_rad=heading_rad,
            velocity_walk_m_s=config.velocity_walk_m_s,
            yaw_rate_walk_rad_s=config.yaw_rate_walk_rad_s,
            force_walk_n=config.force_walk_n,
            moment_walk_nm=config.moment_walk_nm,
            gate=config.gate,
            jump_after=config.jump_after,
        )
        self._ekf: PoseEkf | None = None
        self._filter_ns = 0  # where the filter is
        self._smoother = CausalVelocities(config.smoothing_window, config.smoothing_order)
        self._measured: State | None = None
        self._names = ("", vessel.name)  # the tracker may follow other vehicles too
        self._used_ns = 0  # capture time of the last pose used
        self._seen_ns = 0  # of the last pose that came
        self._ready = False
        self._rejected = self._jumps = 0
        self._wrenches = Wrenches()

    def step(self, now_s: float) -> None:
        """Take in what came, publish the state at now."""
        now_ns = round(now_s * NS)
        if (vessel := vessel_in_force(self._vessel, self.gains)) is not self._vessel:
            self._take_models(vessel)
        for wrench in self.delivered.take():
            surge, sway, self._depth.heave_n, _, _, yaw = wrench.vector()
            stamp_ns, tau = wrench.stamp_ns, (surge, sway, yaw)
            if stamp_ns <= now_ns + _FUTURE_NS:
                self._wrenches.add(stamp_ns, tau)
                if self._wall.possible:
                    self._wall.wrench(stamp_ns, tau)
        if self._seen_ns > now_ns + _FUTURE_NS:  # the machine's clock was set back
            self._forget()
            self._seen_ns = self._used_ns = 0
            self._wrenches.clear()
        if headings := self.compass.take():
            self._headings.extend((c.stamp_ns, c.psi_rad) for c in headings)
        for pose in self._fixes() if self._instruments else self.pose.take():
            if pose.name not in self._names:
                continue
            if not self._acceptable(pose, now_ns) or not self._take_in(pose):
                self._rejected += 1
        for sample in self.depth.take():
            self._depth.take(sample.stamp_ns, sample.z_m)
        self._publish(now_ns)
        if self._wall.possible:
            self._tell_wall(self._wall, headings, now_s)
        if self._monitor is not None:
            self._tell_faults(self._monitor, now_s)

    def _take_models(self, vessel: Vessel) -> None:
        """Go on with the models for which the law in force is designed: identified ones may be among them."""
        self._vessel = vessel
        if self._ekf is not None:
            self._ekf.exchange(vessel.model)
        self._wall.exchange(vessel.model)
        if self._monitor is not None:
            self._monitor = ActuatorMonitor(vessel)

    def _tell_faults(self, monitor: ActuatorMonitor, now_s: float) -> None:
        for command in self.command.take():
            monitor.command(command)
        for order in self.order.take():
            monitor.order(order)
        if message := monitor.tell(now_s):
            self.fault.publish(message)

    def _tell_wall(self, wall: WallTracker, headings: list[SensorCompass], now_s: float) -> None:
        for heading in headings:
            wall.compass(heading)
        for sample in self.laser.take():
            wall.laser(sample)
        if now_s - self._wall_s > WALL_PERIOD_S - 1e-3:
            self._wall_s = now_s
            self.wall.publish(wall.told(round(now_s * NS)))

    def _fixes(self) -> list[CameraPose]:
        """Return the poses that instruments give: a position with the heading nearest to it in time."""
        if not self._headings:
            return []
        fixes = []
        for fix in self.position.take():
            at_ns, psi_rad = min(self._headings, key=lambda heading: abs(heading[0] - fix.stamp_ns))
            if abs(at_ns - fix.stamp_ns) <= self._lost_after_s * NS:
                fixes.append(_pose(fix, psi_rad))
        return fixes

    def _acceptable(self, pose: CameraPose, now_ns: int) -> bool:
        """Whether a pose is worth looking at: in time and in order, in the pool, good and with a heading."""
        stamp_ns, x_m, y_m, pool = pose.stamp_ns, pose.x_m, pose.y_m, self._pool
        age_s = (now_ns - stamp_ns) / NS
        if not -FUTURE_TOLERANCE_S <= age_s <= self._lost_after_s or stamp_ns < self._seen_ns + _NEAREST_NS:
            return False
        self._seen_ns = stamp_ns
        return (
            x_m is not None
            and y_m is not None
            and abs(x_m - 0.5 * pool.length_x_m) < pool.length_x_m
            and abs(y_m - 0.5 * pool.length_y_m) < pool.length_y_m
            and pose.quality >= self._config.min_quality
            and not pose.heading_ambiguous
        )

    def _take_in(self, pose: CameraPose) -> bool:
        """Correct the estimate by a pose; return whether the pose was used."""
        stamp_ns, x_m, y_m, psi_rad = pose.stamp_ns, pose.x_m or 0.0, pose.y_m or 0.0, pose.psi_rad
        if (stamp_ns - self._used_ns) / NS > self._lost_after_s:
            self._forget()
        if self._config.enabled:
            if not self._filter(stamp_ns, x_m, y_m, psi_rad, _noise(pose)):
                return False
        else:
            self._measure(stamp_ns, x_m, y_m, psi_rad)
        self._used_ns = stamp_ns
        if self._monitor is not None:
            self._monitor.pose(stamp_ns, x_m, y_m, psi_rad)
        return True

    def _forget(self) -> None:
        self._ekf, self._measured, self._ready = None, None, False
        self._smoother.clear()

    def _measure(self, stamp_ns: int, x_m: float, y_m: float, psi_rad: float) -> None:
        self._measured = (x_m, y_m, psi_rad, *self._smoother.add(stamp_ns / NS, x_m, y_m, psi_rad))
        self._ready = True

    def _filter(self, stamp_ns: int, x_m: float, y_m: float, psi_rad: float, noise: Array | None) -> bool:
        if self._ekf is None:
            self._ekf = PoseEkf(self._vessel.model, self._tuning, x_m, y_m, psi_rad)
            self._filter_ns = stamp_ns
            return True
        ekf = self._ekf
        self._advance(ekf, self._filter_ns, stamp_ns)
        self._filter_ns = stamp_ns
        self._wrenches.forget_before(stamp_ns)
        before = ekf.state
        verdict = ekf.update(x_m, y_m, psi_rad, noise)
        if verdict is Verdict.REFUSED:
            return False
        if verdict is Verdict.JUMPED:
            moved_m = math.hypot(x_m - before[0], y_m - before[1])
            self._tell_jump(moved_m, abs(wrap_angle(psi_rad - before[2])))
        if not self._ready:
            self._ready = float(ekf.covariance.diagonal()[3:5].max()) < self._ready_std_m_s**2
        return True

    def _tell_jump(self, moved_m: float, turned_rad: float) -> None:
        """Tell of a jump that no model explains: with one that is far off, the filter lags behind by less."""
        if moved_m < JUMP_M and turned_rad < JUMP_RAD:
            return
        self._jumps += 1
        self.note = (
            f"the measured pose jumped by {moved_m:.2f} m and {math.degrees(turned_rad):.0f} degrees: "
            f"believed after {self._tuning.jump_after} poses"
        )
        self.log.warning(self.note)

    def _advance(self, ekf: PoseEkf, from_ns: int, to_ns: int) -> None:
        """Predict from one time to another with the wrenches that were in force between."""
        for dt_s, tau in self._wrenches.between(from_ns, to_ns):
            ekf.predict(dt_s, tau)

    def _publish(self, now_ns: int) -> None:
        age_s = (now_ns - self._used_ns) / NS
        d_x = d_y = d_n = x_std = y_std = psi_std = None
        if (ekf := self._ekf) is not None:
            if now_ns > self._filter_ns:
                ekf = copy.copy(ekf)
                self._advance(ekf, self._filter_ns, min(now_ns, self._used_ns + round(self._lost_after_s * NS)))
            x_m, y_m, psi_rad, u, v, r = ekf.state
            d_x, d_y, d_n = ekf.disturbance
            x_std, y_std, psi_std = map(math.sqrt, ekf.covariance.diagonal().tolist()[:3])
        elif self._measured is not None:
            x_m, y_m, psi_rad, u, v, r = self._measured
        else:
            return
        z_m, heave_m_s = self._depth.at(now_ns)
        self.state.publish(
            NavigationState(
                origin_ns=self._used_ns,
                status=self._status(age_s),
                filtered=ekf is not None,
                x_m=x_m,
                y_m=y_m,
                z_m=z_m,
                psi_rad=psi_rad,
                surge_m_s=u,
                sway_m_s=v,
                heave_m_s=heave_m_s,
                yaw_rad_s=r,
                disturbance_x_n=d_x,
                disturbance_y_n=d_y,
                disturbance_yaw_nm=d_n,
                x_std_m=x_std,
                y_std_m=y_std,
                psi_std_rad=psi_std,
                measurement_age_s=age_s,
                rejected=self._rejected,
                jumps=self._jumps,
            )
        )

    def _status(self, age_s: float) -> Status:
        if age_s > self._lost_after_s:
            return "lost"
        if not self._ready:
            return "initialising"
        return "predicting" if age_s > self._config.predicting_after_s else "tracking"


class DepthTracker:
    """The depth filter at the time of the last sample, and a look ahead to now."""

    def __init__(self, vessel: Vessel) -> None:
        self._model, self._sensor = vessel.model.heave, vessel.sensor("depth")
        self._force_n = axis_limits(vessel)[2]
        self._filter: DepthFilter | None = None
        self._sample_ns = 0
        self.heave_n = 0.0
        """What the actuators give."""

    @property
    def possible(self) -> bool:
        """Whether the vessel dives and measures how deep."""
        return self._model is not None and self._sensor is not None and self._force_n > 0.0

    def take(self, stamp_ns: int, z_m: float) -> None:
        """Take in a sample; after a long pause begin again."""
        gap_s = (stamp_ns - self._sample_ns) / NS
        self._sample_ns = max(stamp_ns, self._sample_ns)
        if self._filter is None or not gap_s < DEPTH_LOST_S:
            assert self._model is not None
            assert self._sensor is not None
            self._filter = DepthFilter(self._model, self._sensor, z_m, self._force_n)
        elif gap_s > 0.0:
            self._filter.update(gap_s, self.heave_n, z_m)

    def at(self, now_ns: int) -> tuple[float | None, float | None]:
        """Return depth in m and heave speed in m/s, None when the sensor is silent."""
        age_s = (now_ns - self._sample_ns) / NS
        if self._filter is None or not 0.0 <= age_s < DEPTH_LOST_S:
            return None, None
        return self._filter.predicted(age_s, self.heave_n)


def _std(sensor: Sensor) -> float:
    """Return the standard deviation of a sensor's samples, in its unit: noise and rounding."""
    return math.hypot(sensor.noise, sensor.quantisation / math.sqrt(12.0))


def _pose(fix: SensorPosition, psi_rad: float) -> CameraPose:
    """Return position and heading as the filter takes them."""
    return CameraPose(
        stamp_ns=fix.stamp_ns, frame=0, x_px=0.0, y_px=0.0, x_m=fix.x_m, y_m=fix.y_m, psi_rad=psi_rad, quality=1.0
    )


def _noise(pose: CameraPose) -> Array | None:
    """Return the covariance (3, 3) of what changes from pose to pose, where a calibrated camera tells it.

    The rest of its error, the camera's place, is alike in all poses: the vessel is held in the camera's {E}.
    """
    if pose.noise_covariance is None:
        return None
    xx, xy, xp, yy, yp, pp = pose.noise_covariance
    return np.array([(xx, xy, xp), (xy, yy, yp), (xp, yp, pp)])
