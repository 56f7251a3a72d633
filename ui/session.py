"""One page's connection, apart from any socket: what a page may say, and what becomes of it when it goes.

Nothing here reads a clock or a socket: `ui.web` moves the bytes, the tests play the page.
"""

from __future__ import annotations

import ipaddress
import json
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from bus import topics
from bus.messages import (
    CalibrationRequest,
    ExperimentPlan,
    Message,
    Mode,
    Name,
    OperatorActuator,
    OperatorJoystick,
    OperatorRequest,
    SimulationFault,
    Stick,
    Tuning,
    TuningRequest,
    WayPoints,
)
from bus.service import first_line
from bus.topics import Topic

Submit = Callable[[Topic[Any], Message], None]

LEASE_S = 3.0
"""A page renews its lease every second."""
SILENCE_S = 3.0
"""A page that says nothing for so long is gone: it sends a sign of life twice a second."""
STICK_SILENCE_S = 0.3
"""A deflected stick is repeated at 20 Hz; after this silence it counts as let go (the helm waits 0.5 s)."""
RATE_LIMIT = 100
"""Messages per second that are taken from one page; a stop is always taken."""


class _FromPage(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class JoystickMessage(_FromPage):
    """Stick positions; repeated at 20 Hz in mode manual."""

    type: Literal["joystick"]
    surge: Stick = 0.0
    sway: Stick = 0.0
    heave: Stick = 0.0
    yaw: Stick = 0.0


class ModeMessage(_FromPage):
    """A wish for a mode, with the reference that it needs (m and rad, in {E})."""

    type: Literal["mode"]
    request_id: Name
    mode: Mode
    x_m: float | None = None
    y_m: float | None = None
    psi_rad: float | None = None
    z_m: float | None = None
    speed_m_s: float | None = None
    distance_m: float | None = None
    points: WayPoints = ()
    smooth: bool = False
    experiment: ExperimentPlan | None = None
    take: bool = False


class RenewMessage(_FromPage):
    """The page still holds the lease."""

    type: Literal["renew"]


class AliveMessage(_FromPage):
    """Nothing but a sign of life."""

    type: Literal["alive"]


class FaultMessage(_FromPage):
    """An order to the simulator."""

    type: Literal["fault"]
    fault: SimulationFault


class TuningMessage(_FromPage):
    """A wish for another control law or other gains; null: those of the configuration file."""

    type: Literal["tuning"]
    request_id: Name
    tuning: Tuning | None


class ActuatorMessage(_FromPage):
    """An operator's word about an actuator."""

    type: Literal["actuator"]
    actuator: Name
    works: bool


class CalibrationMessage(_FromPage):
    """A wish to the calibration of the camera."""

    type: Literal["calibration"]
    request: CalibrationRequest


PageMessage = Annotated[
    JoystickMessage
    | ModeMessage
    | RenewMessage
    | AliveMessage
    | FaultMessage
    | ActuatorMessage
    | CalibrationMessage
    | TuningMessage,
    Field(discriminator="type"),
]
_PARSER: TypeAdapter[PageMessage] = TypeAdapter(PageMessage)


@dataclass(frozen=True)
class Update:
    """What one step hands to all pages: newest payload of each key (JSON, checked), pictures as they came."""

    now_ns: int
    values: Mapping[str, bytes]
    images: Mapping[str, bytes] = field(default_factory=dict)
    answers: tuple[tuple[str, bytes], ...] = ()
    """(client, payload) of each answer of the helm: none of them is skipped, unlike values."""


class Session:
    """One connected page. `submit` takes what it wants published, in the order it was said."""

    def __init__(self, client: str, submit: Submit) -> None:
        self.client = client
        self.refused = 0
        """Messages of this page that made no sense."""
        self._submit = submit
        self._deflected = False
        self._wants_lease = False
        self._second = 0
        self._messages = 0
        self._renewals = 0
        self._now_ns = 0
        self._values: dict[str, bytes] = {}
        self._images: dict[str, bytes] = {}
        self._answers: list[bytes] = []
        self._refusal = ""

    # --- from the page

    @property
    def patience_s(self) -> float:
        """How long to wait for the page's next message before `fall_silent`."""
        return STICK_SILENCE_S if self._deflected else SILENCE_S

    def receive(self, text: str | bytes, now_s: float) -> str:
        """Act on one message of the page; return why it was refused, in one line, or an empty string."""
        try:
            message = _PARSER.validate_json(text)
            is_stop = isinstance(message, ModeMessage) and message.mode == "stop"
            if not self._within_rate(now_s) and not is_stop:
                raise ValueError(f"more than {RATE_LIMIT} messages a second")
        except (ValidationError, ValueError) as error:
            self.refused += 1
            self._refusal = first_line(error)
            return self._refusal
        self._act(message)
        return ""

    def _within_rate(self, now_s: float) -> bool:
        second = int(now_s)
        self._messages = self._messages + 1 if second == self._second else 1
        self._second = second
        return self._messages <= RATE_LIMIT

    def _act(self, message: PageMessage) -> None:
        match message:
            case JoystickMessage():
                self._stick(message.surge, message.sway, message.heave, message.yaw)
            case ModeMessage():
                self._wants_lease = message.mode != "stop"
                wish = {name: value for name, value in message if name not in ("type", "request_id")}
                self._request(message.request_id, "mode", **wish)
            case RenewMessage():
                self._wants_lease = True
                self._renewals += 1
                self._request(f"{self.client}-renew-{self._renewals}", "renew")
            case FaultMessage():
                self._submit(topics.SIMULATION_FAULT, _unstamped(message.fault))
            case TuningMessage():
                request = TuningRequest(request_id=message.request_id, client=self.client, tuning=message.tuning)
                self._submit(topics.OPERATOR_TUNING, request)
            case ActuatorMessage(actuator=actuator, works=works):
                word = OperatorActuator(client=self.client, actuator=actuator, works=works)
                self._submit(topics.OPERATOR_ACTUATOR, word)
            case CalibrationMessage():
                self._submit(topics.OPERATOR_CALIBRATION, _unstamped(message.request))
            case AliveMessage():
                pass

    def _stick(self, surge: float = 0.0, sway: float = 0.0, heave: float = 0.0, yaw: float = 0.0) -> None:
        self._deflected = any((surge, sway, heave, yaw))
        self._submit(
            topics.OPERATOR_JOYSTICK,
            OperatorJoystick(client=self.client, surge=surge, sway=sway, heave=heave, yaw=yaw),
        )

    def _request(self, request_id: str, action: Literal["mode", "renew", "release"], **wish: Any) -> None:
        request = OperatorRequest(request_id=request_id, client=self.client, action=action, lease_s=LEASE_S, **wish)
        self._submit(topics.OPERATOR_REQUEST, request)

    def fall_silent(self) -> bool:
        """Note that `patience_s` passed without a message: let the stick go, or else return that the page is gone."""
        if not self._deflected:
            return True
        self._stick()
        return False

    def close(self) -> None:
        """Let go of everything: zero stick at once, and the lease back, so that `manual` ends and `hold` goes on."""
        if self._deflected or self._wants_lease:
            self._stick()
        if self._wants_lease:
            self._request(f"{self.client}-release", "release")
            self._wants_lease = False

    # --- to the page

    def offer(self, update: Update) -> None:
        """Take over what is new; what a slow page has not fetched yet is replaced, so memory stays bounded."""
        self._now_ns = update.now_ns
        self._values.update(update.values)
        self._images.update(update.images)
        self._answers = [*self._answers, *(p for client, p in update.answers if client == self.client)][-32:]

    def take(self, status: Mapping[str, Any]) -> list[str | bytes]:
        """Return the frames to send now: one text with all new values, then one binary message a picture.

        A picture's message: one byte length of its key, the key, then the payload as it is on the bus.
        """
        frame: dict[str, bytes] = {
            "now_ns": b"%d" % self._now_ns,
            "values": _json_object(self._values),
            "answers": b"[" + b",".join(self._answers) + b"]",
            "server": json.dumps({"client": self.client, **status}).encode(),
        }
        if self._refusal:
            frame["refused"] = json.dumps(self._refusal).encode()
        pictures = [bytes([len(key)]) + key.encode() + payload for key, payload in self._images.items()]
        self._values, self._images, self._answers, self._refusal = {}, {}, [], ""
        return [_json_object(frame).decode(), *pictures]


def _unstamped(message: Message) -> Message:
    """Return a message of a page without the header that it may have made up."""
    return message.model_copy(update={"stamp_ns": 0, "origin_ns": None})


def _json_object(items: Mapping[str, bytes]) -> bytes:
    """Return a JSON object of members that are JSON already."""
    return b"{" + b",".join(json.dumps(key).encode() + b":" + value for key, value in items.items()) + b"}"


def may_connect(origin: str | None, host: str, names: tuple[str, ...] = ()) -> bool:
    """Return whether a websocket is one of our own page's.

    Any web site that the operator opens could otherwise connect to the page's port and drive the vessel. So the page
    must come from the address it connects to, and that address must be a number or a name of this machine (a
    foreign name that resolves to us is an attack known as DNS rebinding). Programs send no origin: they may.
    """
    if origin is None:
        return True
    if origin.partition("://")[2] != host:
        return False
    own = socket.gethostname().lower()
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name in {"localhost", own, f"{own}.local", *names} or bool(ipaddress.ip_address(name))
    except ValueError:
        return False
