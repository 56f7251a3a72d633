"""What a command hears on a real bus, and what it is answered."""

from __future__ import annotations

import os
import sys
import threading
import time
import uuid
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from services.cli.errors import CliError

if TYPE_CHECKING:
    from bus.messages import HelmAnswer, Message, OperatorRequest, TuningRequest
    from bus.service import RawSample
    from bus.topics import Topic
    from bus.zenoh_bus import ZenohBus

    M = TypeVar("M", bound=Message)

ANSWER_S = 3.0
THERE_S = 10.0
"""So long a command waits for the service that shall answer: at the start of a star, or when it is started again."""
TELL_S = 1.0
"""After so long it says that it waits."""
_LOOK_S = 0.05
CLIENT = f"cli-{os.getpid()}"


def identity() -> dict[str, str]:
    """Return the fields of a new request that say who asks what."""
    return {"request_id": uuid.uuid4().hex[:12], "client": CLIENT}


class Conversation:
    """The newest message of each topic that is listened to, and requests with their answers."""

    def __init__(self, bus: ZenohBus, *heard: Topic[Any]) -> None:
        self.bus = bus
        self._changed = threading.Condition()
        self._newest: dict[str, Message] = {}
        self._answers: dict[str, HelmAnswer] = {}
        for topic in heard:
            bus.subscribe(topic.key, partial(self._hear, topic))

    def newest(self, topic: Topic[M]) -> M | None:
        """Return the newest message of a topic that is listened to."""
        return self._newest.get(topic.key)  # type: ignore[return-value]  # what `_hear` has decoded

    def wait(self, until: Callable[[], object], timeout_s: float) -> bool:
        """Wait until something is so, looked at after each message; return whether it is."""
        with self._changed:
            return bool(self._changed.wait_for(until, timeout_s))

    def ask(self, request: OperatorRequest | TuningRequest, topic: Topic[Any], answers: Topic[Any]) -> HelmAnswer:
        """Publish a request once somebody is there to answer it, and return the answer, of a topic listened to.

        Raises CliError without one. A request that nobody hears is lost, as they are not kept. A stop is sent at once
        as well, and after THERE_S in any case.
        """
        if getattr(request, "mode", "") == "stop":  # of a wish, not of tuning
            self._send(request, topic)
        there = self._await(answers.publisher)
        self._send(request, topic)
        if not self.wait(lambda: request.request_id in self._answers, ANSWER_S):
            lacks = f"did not answer within {ANSWER_S:.0f} s" if there else f"was not there within {THERE_S:.0f} s"
            raise CliError(f"the {answers.publisher} {lacks}: see `starboard status`")
        return self._answers[request.request_id]

    def _send(self, request: OperatorRequest | TuningRequest, topic: Topic[Any]) -> None:
        self.bus.publish(topic, request.stamped(self.bus.clock.now_ns(), 0, "cli"))

    def _await(self, service: str) -> bool:
        """Wait until a service is on the bus; return whether it is."""
        begin_s, told = time.monotonic(), False
        while service not in self.bus.alive():
            waited_s = time.monotonic() - begin_s
            if waited_s > THERE_S:
                return False
            if waited_s > TELL_S and not told:
                told = True
                print(f"waiting for the {service}, which is not there yet", file=sys.stderr, flush=True)
            time.sleep(_LOOK_S)
        return True

    def _hear(self, topic: Topic[Any], sample: RawSample) -> None:
        from bus.messages import HelmAnswer

        message = topic.message.decode(sample.payload)
        with self._changed:
            self._newest[topic.key] = message
            if isinstance(message, HelmAnswer):
                self._answers[message.request_id] = message
            self._changed.notify_all()


def granted(answer: HelmAnswer) -> None:
    """Raise CliError with the reason unless a request was accepted."""
    if not answer.accepted:
        raise CliError(f"refused: {answer.reason}")
