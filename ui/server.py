"""The service behind the operator's page: everything on the bus to the browser, its wishes back to the bus."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import socket
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pydantic import Field
from pydantic_core import from_json

from bus import topics
from bus.clock import NS
from bus.config import Section
from bus.messages import HelmAnswer, Message, TuningAnswer
from bus.service import Output, RawInput, Service, first_line
from bus.topics import Qos, Topic
from bus.units import unit_of
from marine.actuators import Drive
from marine.control.laws import laws_document
from marine.guidance.abilities import AXIS_NAMES
from marine.vessel import INSTRUMENTS, Vessel
from services.tuning import serving, tuned_axes
from ui.session import Update
from ui.tuning import Previews

if TYPE_CHECKING:
    from ui.web import WebServer

FEED_S = 0.04
"""Real time between two batches of values to the pages, however fast the star's runs: all that a screen can show."""
_RETRY_S = 2.0
_MAX_KEYS = 1000
_MAX_BYTES = 65_536
_ANSWERS: dict[str, type[HelmAnswer]] = {topics.HELM_ANSWER.key: HelmAnswer, topics.CONTROL_ANSWER.key: TuningAnswer}


class PageConfig(Section):
    """Where the page listens, and what it is called."""

    host: str = Field("127.0.0.1", description="0.0.0.0: every computer in the network may drive the vessel")
    port: int = Field(8080, ge=0, le=65535, description="0: any free port")
    names: tuple[str, ...] = Field((), description="further host names under which the page is opened")
    title: str = Field("", description="in the page's head; empty: the vessel's title")


class Page(Service):
    """Feed the pages with the newest value of every key, and publish what operators ask for."""

    name = "ui"
    rate_hz = 25.0  # no input wakes it: what is new goes to the pages in batches
    everything = RawInput("**")
    joystick = Output(topics.OPERATOR_JOYSTICK)
    request = Output(topics.OPERATOR_REQUEST)
    actuator = Output(topics.OPERATOR_ACTUATOR)
    fault = Output(topics.SIMULATION_FAULT)
    calibration = Output(topics.OPERATOR_CALIBRATION)
    tuning = Output(topics.OPERATOR_TUNING)

    def __init__(self, config: PageConfig, vessel: Vessel) -> None:
        self.port: int | None = None
        """The port it listens on, None before."""
        self._config = config
        self._previews = Previews(vessel)
        self._documents = {
            "/api/system": json.dumps(system_document(vessel, config.title)).encode(),
            "/api/topics": json.dumps(topics_document()).encode(),
        }
        self._outbox: deque[tuple[Topic[Any], Message]] = deque(maxlen=1000)
        self._wake_fd: int | None = None
        self._web: WebServer | None = None
        self._retry_s = 0.0
        self._fed_s = 0.0
        self._topics: dict[str, Topic[Any] | None] = {}
        self._malformed = 0

    def files(self) -> Sequence[int]:
        """Name the eventfd by which a page's wish wakes the loop."""
        return () if self._wake_fd is None else (self._wake_fd,)

    def start(self, now_s: float) -> None:
        """Listen, if the port is free."""
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._listen(now_s)

    def step(self, now_s: float) -> None:
        """Publish what pages asked for, then send them what is new."""
        if self._wake_fd is not None:
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
        self._publish()
        if 0.0 <= now_s - self._fed_s < 0.9 * FEED_S * self.warp:
            return
        self._fed_s = now_s
        update = self._update(round(now_s * NS))
        if self._web is None:
            if now_s >= self._retry_s:
                self._listen(now_s)
            return
        if not self._web.alive:
            raise RuntimeError("the web server's thread has ended")
        self._web.deliver(update, {"malformed": self._malformed, "dropped": self.everything.dropped})

    def stop(self, now_s: float) -> None:
        """Close all pages; what they held is let go on the bus before this returns."""
        if self._web is not None:
            self._web.stop(0.8)
            self._publish()
        if self._wake_fd is not None:
            fd, self._wake_fd = self._wake_fd, None
            os.close(fd)

    def submit(self, topic: Topic[Any], message: Message) -> None:
        """Have a message published by the next step, which comes at once; called from the web thread."""
        self._outbox.append((topic, message))
        if self._wake_fd is not None:
            with contextlib.suppress(OSError):  # closed meanwhile
                os.eventfd_write(self._wake_fd, 1)

    def _publish(self) -> None:
        outputs: dict[str, Output[Any]] = {o.topic.key: o for o in self.outputs}
        while self._outbox:
            topic, message = self._outbox.popleft()
            outputs[topic.key].publish(message)

    def _listen(self, now_s: float) -> None:
        from ui.web import WebServer

        host, port = self._config.host, self._config.port
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            listener = socket.create_server((host, port), family=family, backlog=64)
        except OSError as error:
            if not self.note:
                reason = os.strerror(error.errno) if error.errno else str(error)
                self.note = f"cannot listen on {host}:{port}: {reason}; trying again every {_RETRY_S:.0f} s"
                self.log.error("%s", self.note)
            self._retry_s = now_s + _RETRY_S
            return
        self.note = ""
        self.port = listener.getsockname()[1]
        self._web = WebServer(self._documents, self.submit, self._config.names, {"/api/tuning": self._previews})
        self._web.start(listener)
        self.log.info("the operator's page: http://%s:%d/", host, self.port)

    def _update(self, now_ns: int) -> Update:
        newest: dict[str, bytes] = {}
        answers: list[tuple[str, bytes]] = []
        for key, payload, _ in self.everything.take():
            newest[key] = payload
            if key in _ANSWERS and self._fits(key, payload):
                answers.append((_ANSWERS[key].decode(payload).client, payload))
        good = {key: payload for key, payload in newest.items() if self._fits(key, payload)}
        images = {key: good.pop(key) for key in [*good] if self._is_image(key)}
        return Update(now_ns, good, images, tuple(answers))

    def _is_image(self, key: str) -> bool:
        topic = self._topics[key]
        return topic is not None and topic.qos is Qos.IMAGE

    def _fits(self, key: str, payload: bytes) -> bool:
        """Return whether a payload can go to the browser; one broken value must not spoil a page."""
        try:
            if key not in self._topics:
                if len(self._topics) >= _MAX_KEYS or len(key) > 200:
                    raise ValueError("too many or too long keys")
                self._topics[key] = topics.find(key)
            topic = self._topics[key]
            if topic is not None:
                topic.message.decode(payload)
            elif len(payload) > _MAX_BYTES or not isinstance(from_json(payload, allow_inf_nan=False), dict):
                raise ValueError("not a JSON object of at most 64 kB")
        except ValueError as error:
            self._malformed += 1
            if self._malformed == 1:
                self.log.warning("%s: not shown: %s (further ones are counted)", key[:200], first_line(error))
            return False
        return True


def system_document(vessel: Vessel, title: str = "") -> dict[str, Any]:
    """Return what the page must know of vessel and place, in SI: the document /api/system."""
    kinds = {sensor.kind for sensor in vessel.sensors}
    absent = {
        name
        for name, has in (
            ("camera_tracker", "camera" in kinds),
            ("camera_calibration", "camera" in kinds),
            ("laser_tracker", "laser" in kinds),
            ("sensors", kinds & INSTRUMENTS),
        )
        if not has
    }
    publishers = {t.publisher for t in topics.all_topics() if not t.key.startswith("simulation/")} - absent
    return {
        "title": title or vessel.title,
        "vessel": vessel.name,
        "radius_m": vessel.radius_m,
        "pool": dataclasses.asdict(vessel.pool),
        "camera": dataclasses.asdict(vessel.camera),
        "thrusters": [dataclasses.asdict(t) | {"max_n": Drive(t).upper} for t in vessel.thrusters],
        "actuators": [a.name for a in vessel.actuators],
        "sensors": [s.kind for s in vessel.sensors],
        "axes": [AXIS_NAMES[axis] for axis in vessel.controlled],
        "laws": [law for law in laws_document() if law["serves"] == serving(vessel)],
        "tuned": tuned_axes(vessel),
        "w0_rad_s": vessel.hold_w0_rad_s if "sway" in tuned_axes(vessel) else vessel.steering_w0_rad_s,
        "services": sorted(publishers - {"*", topics.OPERATOR}),
    }


def topics_document() -> list[dict[str, Any]]:
    """Return every topic with the unit and the meaning of its fields: the document /api/topics."""
    header = set(Message.model_fields)
    return [
        {
            "key": topic.key,
            "doc": topic.doc,
            "publisher": topic.publisher,
            "rate_hz": topic.rate_hz,
            "fields": {
                name: {"unit": unit_of(name), "doc": field.description or ""}
                for name, field in topic.message.model_fields.items()
                if name not in header and not field.exclude
            },
        }
        for topic in topics.all_topics()
    ]
