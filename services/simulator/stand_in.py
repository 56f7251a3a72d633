"""Camera and tracker in one, without pictures: for closed loops on `MemoryBus`."""

from __future__ import annotations

import random
from collections import deque

from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Section
from bus.messages import CameraPose, CameraStatus, SimulationTruth
from bus.service import Input, Output, Service
from marine.frames import wrap_angle
from marine.vessel import Vessel
from services.simulator.faults import CameraFaults

STATUS_PERIOD_S = 1.0


class StandInConfig(Section):
    """How good the poses are."""

    seed: int = 1
    position_noise_px: float = Field(0.05, ge=0)
    heading_noise_rad: float = Field(0.002, ge=0)
    latency_s: float = Field(0.0, ge=0, description="from capture to publishing, rounded up to whole frames")


class PoseStandIn(Service):
    """Publishes the simulator's truth as the camera tracker would, with noise, latency and the camera's faults."""

    name = "camera_tracker"
    rate_hz = 2.0

    truth = Input(topics.SIMULATION_TRUTH, wakes=True, queue=16)
    fault = Input(topics.SIMULATION_FAULT, queue=16)
    pose = Output(topics.CAMERA_POSE)
    status = Output(topics.CAMERA_STATUS)

    def __init__(self, config: StandInConfig, vessel: Vessel) -> None:
        self._config = config
        self._camera = vessel.camera
        self._random = random.Random(config.seed)
        self._faults = CameraFaults()
        self._latency_ns = round(config.latency_s * NS)
        self._under_way: deque[tuple[int, CameraPose]] = deque()
        """Poses, each with the time when it is to be published."""
        self._frames = 0
        self._poses = 0
        self._told_s = 0.0

    def step(self, now_s: float) -> None:
        """See what the camera would see."""
        for order in self.fault.take():
            self._faults = self._faults.after(order)
        for truth in self.truth.take():
            self._frames += 1
            lost = self._random.random() < self._faults.dropout
            if not (lost or self._faults.black or self._faults.board):
                stamp_ns = truth.stamp_ns
                self._under_way.append((stamp_ns + self._latency_ns, self._seen(truth, stamp_ns)))
        now_ns = round(now_s * NS)
        while self._under_way and self._under_way[0][0] <= now_ns:
            self.pose.publish(self._under_way.popleft()[1])
            self._poses += 1
        if now_s - self._told_s >= STATUS_PERIOD_S:
            self._told_s = now_s
            self._tell()

    def _seen(self, truth: SimulationTruth, stamp_ns: int) -> CameraPose:
        scale, noise, gauss = self._camera.scale_px_per_m, self._config.position_noise_px, self._random.gauss
        x_px = truth.x_m * scale - 0.5 + self._faults.shift_px[0] + gauss(0.0, noise)
        y_px = truth.y_m * scale - 0.5 + self._faults.shift_px[1] + gauss(0.0, noise)
        return CameraPose(
            stamp_ns=stamp_ns,
            origin_ns=stamp_ns,
            frame=self._frames,
            x_px=x_px,
            y_px=y_px,
            x_m=(x_px + 0.5) / scale,
            y_m=(y_px + 0.5) / scale,
            psi_rad=wrap_angle(truth.psi_rad + gauss(0.0, self._config.heading_noise_rad)),
            quality=1.0,
        )

    def _tell(self) -> None:
        self.status.publish(
            CameraStatus(
                state="searching" if self._faults.black else "tracking",
                camera="stand-in",
                frames=self._frames,
                poses=self._poses,
                latency_s=self._config.latency_s,
                rate_hz=self._camera.rate_hz,
                width_px=self._camera.width_px,
                height_px=self._camera.height_px,
                scale_px_per_m=self._camera.scale_px_per_m,
            )
        )
