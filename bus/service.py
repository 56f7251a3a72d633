"""A service: a small class with typed ports and a synchronous `step`; no callbacks, no locks, no clock.

The same object runs live (`bus.run`), under a test and in a replay (`bus.memory_bus`). A transport offers samples to
the inputs from whatever thread it has; the loop takes them over with `refresh` before each step, so that inside a
step nothing changes.
"""

from __future__ import annotations

import copy
import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from pydantic import ValidationError

from bus.clock import NS
from bus.messages import Message, Text
from bus.topics import Topic

M = TypeVar("M", bound=Message)
Send = Callable[[Topic[Any], Message], None]

FUTURE_TOLERANCE_S = 0.1
"""A stamp further ahead of the clock than this is absurd and its message never fresh."""


BACKLOG = 8
"""Samples kept between two steps by an input that wants only the latest: a malformed one must not hide a good one."""
PATTERN_BACKLOG = 512
"""The same for an input of many keys, such as all heartbeats."""
MAX_GAP = 1_000_000
"""A greater jump in a sequence is no loss but another count, or nonsense."""
MAX_PAYLOAD_BYTES = 4_000_000
"""A larger payload is malformed without a look: parsing it would hold up the step."""
_RETAINED = 0
"""In place of a number: the sample is a last value, kept by the hub; the publisher's count is not compared with it."""
_HEADER = frozenset(Message.model_fields)
_stamped = Message.stamped  # looking up a method of a pydantic model takes longer than the call


class RawSample(NamedTuple):
    """One message as it came: key without the vessel, payload, arrival time."""

    key: str
    payload: bytes
    received_ns: int


@dataclass(slots=True)
class Moment:
    """The time of the running step and the name that goes into headers; shared by the ports of one service."""

    now_ns: int = 0
    source: str = ""


class _Line:
    """What came under one key: how many offers, from whom, and by how much his count is ahead of the offers.

    That grows by what was lost on the way, whatever the input itself drops or the hub keeps for late joiners.
    """

    __slots__ = ("ahead", "key", "offers", "publisher")

    def __init__(self, key: str) -> None:
        self.key = key
        self.offers = 0
        self.publisher: str | None = None
        self.ahead = 0


class Input(Generic[M]):
    """What a service reads: the latest message of a topic, or with `queue=n` all of them, at most n a step.

    max_age_s: `fresh` returns nothing older. wakes: a message makes the service step at once. min_interval_s: take
    over at most once in so many seconds; the last of a burst always arrives. changed_only: wake and set `updated` only
    when the content differs from the message before. A topic with a placeholder (`service/{name}/heartbeat`) is read
    on all its keys; the newest of each is in `by_key`.
    """

    __slots__ = (
        "_arrived",
        "_held_until_ns",
        "_lines",
        "_pending",
        "_taken",
        "by_key",
        "changed_only",
        "dropped",
        "gaps",
        "idle",
        "is_pattern",
        "latest",
        "malformed",
        "max_age_s",
        "min_interval_ns",
        "overwritten",
        "problem",
        "queue",
        "topic",
        "updated",
        "wakes",
    )

    def __init__(
        self,
        topic: Topic[M],
        *,
        max_age_s: float | None = None,
        wakes: bool = False,
        queue: int = 0,
        min_interval_s: float = 0.0,
        changed_only: bool = False,
    ) -> None:
        self.topic = topic
        self.max_age_s = max_age_s
        self.wakes = wakes
        self.queue = queue
        self.min_interval_ns = round(min_interval_s * NS)
        self.changed_only = changed_only
        self.is_pattern = topic.pattern != topic.key
        self.reset()

    def reset(self) -> None:
        """Forget all messages: each service object has a port of its own."""
        self.latest: M | None = None
        """The newest message whatever its age, None before the first."""
        self.by_key: dict[str, M] = {}
        """The newest message of each key, of a topic with a placeholder."""
        self.updated = False
        """Whether `latest` came (with `changed_only`: differs) since the step before."""
        self.malformed = 0
        self.gaps = 0
        self.dropped = 0
        """Messages pushed out of a full queue."""
        self.overwritten = 0
        """Messages that a newer one replaced before the service looked, where it wants only the latest."""
        self.problem = ""
        limit = self.queue or (PATTERN_BACKLOG if self.is_pattern else BACKLOG)
        self._pending: deque[tuple[_Line, int, bytes | Message]] = deque(maxlen=limit)
        self._lines: dict[str, _Line] = {"": _Line("")}
        self._arrived: list[M] = []
        self._taken: list[M] = []
        self._held_until_ns = 0
        self.idle = True
        """Whether `refresh` has nothing to do: most inputs, most of the time."""

    def offer(self, sample: bytes | Message, key: str = "", *, retained: bool = False) -> None:
        """Hand over a sample; called by the transport, from any thread. `key` matters to a topic of many keys only.

        retained: it is the last value that the hub kept: not taken when something newer came already. What its
        publisher sent between that and the first message that comes live is no loss.
        """
        pending, line = self._pending, self._lines.get(key) or self._lines.setdefault(key, _Line(key))
        number = _RETAINED
        if not retained:
            line.offers = number = line.offers + 1
        elif line.offers:
            return
        if len(pending) == pending.maxlen:
            self._miss(1)
        pending.append((line, number, sample))
        self.idle = False

    def refuse(self, reason: str) -> None:
        """Count a sample that cannot be taken over."""
        self.malformed += 1
        self.problem = f"{self.topic.key}: dropped a malformed message: {reason}"
        self.idle = False

    def due_ns(self, now_ns: int) -> int | None:
        """Return when the service should step for what was offered: now, after the interval, or None for not at all."""
        if self._held(now_ns) and (self._pending or self._arrived):
            return self._held_until_ns
        if self.changed_only:
            self._decode_pending()
        elif self._pending:
            return now_ns
        return now_ns if self._arrived else None

    def refresh(self, now_ns: int = 0) -> None:
        """Take over what was offered; called by the loop before each step."""
        self.updated = False
        if self._taken:
            self._taken = []
        self.idle = True  # before a look at what is pending: another thread may offer more at any time
        if not (self._pending or self._arrived):
            return
        self.idle = False  # `updated` and what is taken last until the next step
        if self.min_interval_ns and self._held(now_ns):
            return
        self._decode_pending()
        arrived = self._arrived
        if not arrived:
            return
        self._arrived = []
        self.updated = True
        self._held_until_ns = now_ns + self.min_interval_ns
        if self.queue:
            self._taken = arrived[-self.queue :]
        if len(arrived) > 1 and not self.is_pattern:
            self._miss(len(arrived) - max(len(self._taken), 1))

    def _held(self, now_ns: int) -> bool:
        return 0 < self._held_until_ns - now_ns <= self.min_interval_ns  # a clock set back holds nothing

    def _miss(self, count: int) -> None:
        if self.queue:
            self.dropped += count
        else:
            self.overwritten += count

    def _decode_pending(self) -> None:
        pending, kind = self._pending, self.topic.message
        while pending:
            line, number, sample = pending.popleft()
            message = sample if isinstance(sample, kind) else self._decode(sample)
            if message is None:
                continue
            content = message.__dict__  # of a pydantic model that is quicker than its attributes
            ahead, publisher = content["seq"] - number, content["source"]
            if (ahead != line.ahead or publisher != line.publisher) and number != _RETAINED:
                missing = ahead - line.ahead if publisher == line.publisher else 0
                self.gaps += missing if 0 < missing <= MAX_GAP else 0
                line.ahead, line.publisher = ahead, publisher
            before, self.latest = self.latest, message
            if self.is_pattern:
                before, self.by_key[line.key] = self.by_key.get(line.key), message
            if not (self.changed_only and before is not None and _content(before) == _content(message)):
                self._arrived.append(message)

    def _decode(self, sample: bytes | Message) -> M | None:
        try:
            if isinstance(sample, Message):
                raise ValueError(f"got a {type(sample).__name__}")
            if len(sample) > MAX_PAYLOAD_BYTES:
                raise ValueError(f"it has {len(sample)} bytes")
            return self.topic.message.decode(sample)
        except ValueError as error:
            self.refuse(first_line(error))
            return None

    def fresh(self, now_s: float) -> M | None:
        """Return the latest message unless its stamp is older than `max_age_s` or lies in the future."""
        latest, max_age_s = self.latest, self.max_age_s
        if latest is None or max_age_s is None:
            return latest
        return latest if -FUTURE_TOLERANCE_S <= now_s - latest.stamp_ns * 1e-9 <= max_age_s else None

    def take(self) -> list[M]:
        """Return the messages of a queued input that came since the step before, oldest first."""
        return self._taken


class RawInput:
    """Everything that fits a pattern, undecoded: for the recorder and the page."""

    __slots__ = ("_pending", "dropped", "pattern", "queue", "wakes")

    def __init__(self, pattern: str = "**", *, queue: int = 20000, wakes: bool = False) -> None:
        self.pattern = pattern
        self.queue = queue
        self.wakes = wakes
        self.dropped = 0
        """Samples lost because the service did not take them in time."""
        self._pending: deque[RawSample] = deque()

    def offer(self, sample: RawSample) -> None:
        """Hand over a sample; called by the transport, from any thread."""
        if len(self._pending) >= self.queue:
            self._pending.popleft()
            self.dropped += 1
        self._pending.append(sample)

    @property
    def waits(self) -> bool:
        """Whether something that should wake the service has not been taken."""
        return self.wakes and bool(self._pending)

    def take(self) -> list[RawSample]:
        """Return what came since the last call, oldest first."""
        return [self._pending.popleft() for _ in range(len(self._pending))]


class Output(Generic[M]):
    """What a service publishes."""

    __slots__ = ("_moment", "_send", "_sequence", "topic")

    def __init__(self, topic: Topic[M]) -> None:
        self.topic = topic
        self._sequence = 0
        self._moment = Moment()
        self._send: Send | None = None

    def bind(self, moment: Moment, send: Send) -> None:
        """Connect the port to a transport."""
        self._moment, self._send = moment, send

    def publish(self, message: M) -> M:
        """Fill in the header (a stamp that is set already stays) and send; return what was sent."""
        if self._send is None:
            raise RuntimeError(f"{self.topic.key}: the service is on no bus")
        moment = self._moment
        stamped = _stamped(message, moment.now_ns, self._sequence, moment.source)
        self._sequence += 1
        self._send(self.topic, stamped)
        return stamped


Port = Input[Any] | Output[Any] | RawInput


class Service:
    """Base of all services: declare ports as class attributes, work in `step`.

    `config` and `vessel` are given by name to `__init__` when it asks for them (see services.catalog).
    """

    name: ClassVar[str]
    rate_hz: ClassVar[float] = 10.0
    """`step` runs at the latest every 1 / rate_hz, and at once when an input that wakes has something."""
    quick: ClassVar[bool] = False
    """Whether a step always takes a few ms at most: then `bus.run` may run it in the bus' thread that brings a message
    (never two at a time), which saves the way to another thread. A long step there would hold up the connection."""
    ports: ClassVar[dict[str, Port]] = {}
    log: logging.Logger
    warp: float = 1.0
    """How many times faster than real time `now_s` runs: for what people and supervisors wait for in real time."""
    note: Text = ""
    """Last thing worth telling, such as a port that is taken; shown in the heartbeat."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own = {name: port for name, port in vars(cls).items() if isinstance(port, Input | Output | RawInput)}
        inherited = [vars(base).get("ports", {}) for base in reversed(cls.__mro__[1:])]
        cls.ports = {name: port for ports in [*inherited, own] for name, port in ports.items()}
        for name in own:  # an object's attribute that its class has, too, is looked up the long way
            delattr(cls, name)

    def __new__(cls, *_args: Any, **_kwargs: Any) -> Any:
        """Give each object ports of its own."""
        self = super().__new__(cls)
        for name, port in cls.ports.items():
            setattr(self, name, _own(port))
        self.log = logging.getLogger(getattr(cls, "name", cls.__name__))
        return self

    @property
    def inputs(self) -> list[Input[Any]]:
        """The typed inputs of this object."""
        return [p for n in self.ports if isinstance(p := getattr(self, n), Input)]

    @property
    def raw_inputs(self) -> list[RawInput]:
        """The undecoded inputs of this object."""
        return [p for n in self.ports if isinstance(p := getattr(self, n), RawInput)]

    @property
    def outputs(self) -> list[Output[Any]]:
        """The outputs of this object."""
        return [p for n in self.ports if isinstance(p := getattr(self, n), Output)]

    def files(self) -> Sequence[int]:
        """File descriptors that wake the loop when they become readable, besides the inputs."""
        return ()

    def start(self, now_s: float) -> None:
        """Open what the service holds; called once, on the bus, before the first step."""

    def step(self, now_s: float) -> None:
        """Do the work of one round: read inputs, publish outputs. `now_s` is the only clock."""
        raise NotImplementedError

    def stop(self, now_s: float) -> None:
        """Bring what the service holds into a safe state and close it; called once, whatever ended the loop."""


def _own(port: Port) -> Port:
    fresh = copy.copy(port)
    if isinstance(fresh, Input):
        fresh.reset()
    elif isinstance(fresh, RawInput):
        fresh._pending = deque()
    return fresh


def _content(message: Message) -> dict[str, Any]:
    return {name: value for name, value in message.__dict__.items() if name not in _HEADER}


def first_line(error: Exception) -> Text:
    """Return an error as one short line; of a validation error the first field and reason."""
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        return f"{where}: {first['msg']}"[:300] if where else str(first["msg"])[:300]
    return (str(error).splitlines() or [type(error).__name__])[0][:300]
