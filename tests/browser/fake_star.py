"""A made-up star for the page alone: a helm with a lease, and a vessel that does what it is told or goes round.

`python tests/browser/fake_star.py [PORT]` shows the page without anything else running.
"""

from __future__ import annotations

import contextlib
import logging
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from bus import messages as m
from bus import topics
from bus.clock import NS
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.service import Input, Output, Service
from bus.topics import Topic
from camera_tracker.calibration_service import CameraCalibration
from marine.vessel import Vessel
from services.simulator.board import HELD_S, MOVED_S
from services.simulator.camera import Renderer
from services.vessels import load_vessel
from ui.server import Page, PageConfig

M = TypeVar("M", bound=m.Message)
VESSEL = load_vessel("pladypos")
SCALE = VESSEL.camera.scale_px_per_m


class FakeHelm(Service):
    """Modes, a lease and refusals, as the page sees them."""

    name = "helm"
    rate_hz = 10.0
    request = Input(topics.OPERATOR_REQUEST, queue=16, wakes=True)
    answer = Output(topics.HELM_ANSWER)
    state = Output(topics.HELM_STATE)

    def __init__(self) -> None:
        self.wanted = m.HelmState(mode="stop", status="disarmed")

    def step(self, now_s: float) -> None:
        now_ns = round(now_s * NS)
        if self.wanted.lease_expires_ns < now_ns:
            self._release()
        for request in self.request.take():
            reason = self._act(request, now_ns)
            if request.action == "mode":
                answer = m.HelmAnswer(
                    request_id=request.request_id, client=request.client, accepted=not reason, reason=reason
                )
                self.answer.publish(answer)
        self.state.publish(self.wanted)

    def _act(self, request: m.OperatorRequest, now_ns: int) -> str:
        other = self.wanted.holder not in ("", request.client)
        if request.action == "release":
            if not other:
                self._release()
            return ""
        if other and not request.take and request.mode != "stop":
            return f"{self.wanted.holder} has the helm: take over to act"
        lease = {"holder": request.client, "attended": True, "lease_expires_ns": now_ns + round(request.lease_s * NS)}
        if request.action == "mode":
            names = ("mode", "x_m", "y_m", "psi_rad", "points", "smooth", "speed_m_s", "request_id")
            fields = {name: getattr(request, name) for name in names}
            fields["sources"] = {"surge": "manual"} if request.mode == "manual" else {}
            armed = "disarmed" if request.mode == "stop" else "armed"
            self.wanted = self.wanted.model_copy(update=fields | {"status": armed, "suspended": False, "reason": ""})
        self.wanted = self.wanted.model_copy(update=lease)
        return ""

    def _release(self) -> None:
        mode = "stop" if self.wanted.mode == "manual" else self.wanted.mode
        self.wanted = self.wanted.model_copy(update={"holder": "", "attended": False, "mode": mode})


class FakeVessel(Service):
    """Everything between camera and thrusters: moves by the stick, glides to a reference, else goes round."""

    name = "simulator"
    rate_hz = 30.0
    joystick = Input(topics.OPERATOR_JOYSTICK, max_age_s=0.5)
    helm = Input(topics.HELM_STATE)
    fault = Input(topics.SIMULATION_FAULT, queue=8)
    pose = Output(topics.CAMERA_POSE)
    image = Output(topics.CAMERA_IMAGE)
    camera = Output(topics.CAMERA_STATUS)
    state = Output(topics.NAVIGATION_STATE)
    control = Output(topics.CONTROL_STATUS)
    command = Output(topics.ACTUATOR_COMMAND)
    word = Input(topics.OPERATOR_ACTUATOR, queue=8)
    health = Output(topics.ACTUATOR_HEALTH)
    link = Output(topics.LINK_STATUS)
    recorder = Output(topics.RECORDER_STATUS)
    truth = Output(topics.SIMULATION_TRUTH)

    def __init__(self) -> None:
        self.x, self.y, self.psi = 3.4, 1.9, 0.0
        self.nu = (0.0, 0.0, 0.0)
        self.frame = 0
        self.black = self.board = False
        self.unplugged = ""
        """What the tracker says of a camera that is missing."""
        self.pictures = 0
        self.faults: list[m.SimulationFault] = []
        self.crew = m.ActuatorHealth()
        self._crew_told_s = 0.0
        self.circles = True
        self.jumps = self.rejected = 0
        self._noise = np.random.default_rng(1)
        self._water = self._noise.normal(0.0, 6.0, (600, 800, 3))

    def step(self, now_s: float) -> None:
        for word in self.word.take():
            self.crew = m.ActuatorHealth()
            if not word.works:
                self.crew = m.ActuatorHealth(
                    failed={word.actuator: "operator"}, reason=f"{word.actuator} has failed (operator)"
                )
        if now_s - self._crew_told_s > 0.2:  # the page forgets it when it is not told again
            self._crew_told_s = now_s
            self.health.publish(self.crew.model_copy())
        self.faults += self.fault.take()
        for fault in self.fault.take():
            self.black = fault.active if fault.kind == "camera_black" else self.black and fault.kind != "clear"
            self.board = fault.active if fault.kind == "board" else self.board and fault.kind != "clear"
        self._move(1.0 / self.rate_hz, now_s)
        self.frame += 1
        self._publish()
        if self.frame % 6 == 0:
            self._publish_image()
        if self.frame % 30 == 0:
            self._publish_status()

    def _move(self, dt: float, now_s: float) -> None:
        helm, stick = self.helm.latest, self.joystick.fresh(now_s)
        u = v = r = 0.0
        if helm is not None and helm.mode == "manual":
            if stick is not None:
                u, v, r = 0.36 * stick.surge, 0.36 * stick.sway, 1.9 * stick.yaw
        elif helm is not None and helm.mode == "hold":
            ex, ey = (helm.x_m or self.x) - self.x, (helm.y_m or self.y) - self.y
            ex, ey = 2.0 * ex, 2.0 * ey
            u = math.cos(self.psi) * ex + math.sin(self.psi) * ey
            v = -math.sin(self.psi) * ex + math.cos(self.psi) * ey
            r = 2.0 * math.remainder((helm.psi_rad or 0.0) - self.psi, math.tau)
        elif self.circles:
            u, r = 0.25, 0.28
        self.nu = (u, v, r)
        c, s = math.cos(self.psi), math.sin(self.psi)
        self.x += (u * c - v * s) * dt
        self.y += (u * s + v * c) * dt
        self.psi = math.remainder(self.psi + r * dt, math.tau)

    def _publish(self) -> None:
        noise = self._noise.normal(0.0, 0.002, 3)
        x, y, psi = self.x + noise[0], self.y + noise[1], self.psi + noise[2]
        u, v, r = self.nu
        x_px, y_px = x * SCALE - 0.5, y * SCALE - 0.5
        quality = 0.0 if self.black else 0.93
        self.pose.publish(
            m.CameraPose(
                frame=self.frame,
                x_px=x_px,
                y_px=y_px,
                x_m=x,
                y_m=y,
                psi_rad=psi,
                quality=quality,
                region_px=(round(x_px) - 80, round(y_px) - 80, round(x_px) + 80, round(y_px) + 80),
            )
        )
        self.state.publish(
            m.NavigationState(
                status="lost" if self.unplugged else "predicting" if self.black else "tracking",
                x_m=x,
                y_m=y,
                psi_rad=psi,
                surge_m_s=u,
                sway_m_s=v,
                yaw_rad_s=r,
                disturbance_x_n=0.045,
                disturbance_y_n=-0.02,
                disturbance_yaw_nm=0.0004,
                measurement_age_s=0.004,
                rejected=self.rejected,
                jumps=self.jumps,
            )
        )
        commands = {t.name: round(15 * math.sin(self.psi + i), 0) for i, t in enumerate(VESSEL.thrusters)}
        self.command.publish(m.ActuatorCommand(commands=commands))
        helm = self.helm.latest
        if helm is not None and helm.points:
            end = helm.points[-1]
            self.control.publish(
                m.ControlStatus(
                    law="ipd",
                    in_charge=True,
                    request_id=helm.request_id,
                    reference_x_m=end.x_m,
                    reference_y_m=end.y_m,
                    reference_psi_rad=0.0,
                    leg=max(0, len(helm.points) - 2),
                )
            )
        elif helm is not None and helm.x_m is not None and helm.y_m is not None:
            self.control.publish(
                m.ControlStatus(
                    law="positioning",
                    in_charge=helm.mode == "hold",
                    error_x_m=helm.x_m - x,
                    error_y_m=helm.y_m - y,
                    error_psi_rad=math.remainder((helm.psi_rad or 0.0) - psi, math.tau),
                )
            )
        self.truth.publish(
            m.SimulationTruth(
                x_m=self.x,
                y_m=self.y,
                psi_rad=self.psi,
                surge_m_s=u,
                sway_m_s=v,
                yaw_rad_s=r,
                current_x_m_s=0.05,
                current_y_m_s=-0.02,
                surge_n=0.1,
                sway_n=0.0,
                yaw_nm=0.01,
                commands=commands,
            )
        )

    def _publish_image(self) -> None:
        picture = np.full((600, 800, 3), (0, 0, 0) if self.black else (120, 96, 52), np.uint8)
        if not self.black:
            picture = np.clip(picture + self._water, 0, 255).astype(np.uint8)
            cv2.circle(picture, self._pixel(0.0), 48, (70, 70, 70), -1, cv2.LINE_AA)
            cv2.circle(picture, self._pixel(0.13), 12, (40, 40, 230), -1, cv2.LINE_AA)
            cv2.circle(picture, self._pixel(-0.13), 18, (40, 200, 60), -1, cv2.LINE_AA)
        self.pictures += 1
        if self.board:  # held for two pictures in each of the simulator's poses
            at_s = self.pictures // 2 * (HELD_S + MOVED_S)
            picture = self._renderer.render(self.x, self.y, self.psi, board_at_s=at_s)
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        self.image.publish(m.CameraImage(frame=self.frame, width_px=800, height_px=600, data=data))

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(VESSEL)

    def _pixel(self, ahead_m: float) -> tuple[int, int]:
        x, y = self.x + ahead_m * math.cos(self.psi), self.y + ahead_m * math.sin(self.psi)
        return round(x * SCALE - 0.5), round(y * SCALE - 0.5)

    def _publish_status(self) -> None:
        self.camera.publish(
            m.CameraStatus(
                state="no_camera" if self.unplugged else "searching" if self.black else "tracking",
                error=self.unplugged,
                camera="fake://",
                frames=self.frame,
                poses=self.frame,
                rate_hz=30.0,
                latency_s=0.0031,
                width_px=800,
                height_px=600,
                scale_px_per_m=SCALE,
            )
        )
        self.link.publish(
            m.LinkStatus(state="connected", port="pty:///tmp/fake", sent=self.frame, rate_hz=30.0, round_trip_s=0.0021)
        )
        self.recorder.publish(
            m.RecorderStatus(
                state="recording",
                file="recordings/2026-01-31T10-15-00.mcap",
                messages=self.frame * 9,
                size_bytes=self.frame * 21_000,
            )
        )


class FakeStar:
    """The star on a `MemoryBus`, kept to real time by a thread of its own."""

    def __init__(self, port: int = 0, recordings: Path = Path("recordings"), vessel: Vessel = VESSEL) -> None:
        """vessel: the one that the page is told of."""
        self.helm, self.vessel = FakeHelm(), FakeVessel()
        self.calibration = CameraCalibration(Deployment(recordings_dir=recordings))
        self.page = Page(PageConfig(port=port), vessel)
        self.joysticks: list[m.OperatorJoystick] = []
        self.requests: list[m.OperatorRequest] = []
        self.paused = False
        self._jobs: list[Callable[[MemoryBus], None]] = []
        self._end = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="star")

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.page.port}/"

    def do(self, job: Callable[[MemoryBus], None]) -> None:
        """Have something done on the bus, from the star's own thread."""
        self._jobs.append(job)

    def publish(self, topic: Topic[M], message: M) -> None:
        self.do(lambda bus: bus.publish(topic, message))

    @contextlib.contextmanager
    def running(self) -> Iterator[FakeStar]:
        self._thread.start()
        assert self._ready.wait(5.0)
        try:
            yield self
        finally:
            self._end.set()
            self._thread.join(5.0)

    def _run(self) -> None:
        bus = MemoryBus()
        bus.tap(topics.OPERATOR_JOYSTICK, self.joysticks.append)
        bus.tap(topics.OPERATOR_REQUEST, self.requests.append)
        for service in (self.page, self.helm, self.vessel, self.calibration):
            bus.add(service)
        self._ready.set()
        begin, start_s = time.monotonic(), bus.now_s
        while not self._end.wait(0.005):
            if self.paused:
                begin, start_s = time.monotonic(), bus.now_s
                continue
            while self._jobs:
                self._jobs.pop(0)(bus)
            bus.run_for(max(0.0, start_s + time.monotonic() - begin - bus.now_s))
        bus.stop("ui")


def wait_for(
    condition: Callable[[], object], what: str | Mapping[str, object] = "condition", timeout_s: float = 5.0
) -> None:
    """Wait until a condition holds; fail with what was waited for."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"not within {timeout_s} s: {what}"
        time.sleep(0.005)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    with FakeStar(int(sys.argv[1]) if len(sys.argv) > 1 else 8080).running() as star:
        print(star.url)
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()
