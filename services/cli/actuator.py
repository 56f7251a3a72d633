"""`starboard actuator [NAME failed|works]`: which actuators are left out, and an operator's word about one."""

from __future__ import annotations

import json
import os
import threading
from typing import TYPE_CHECKING, Annotated

import typer

from services.cli.errors import CliError
from services.cli.options import Hub, Json
from services.cli.system import client

if TYPE_CHECKING:
    from bus.messages import ActuatorHealth
    from bus.service import RawSample

ANSWER_S = 3.0


def actuator(
    name: Annotated[str | None, typer.Argument(help="Actuator of the vessel file; without it only the list.")] = None,
    word: Annotated[str | None, typer.Argument(help="failed: it is left out, the others take over; works.")] = None,
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Show which actuators have failed, and who says so; or say that one has failed, or works (again)."""
    from bus import topics
    from bus.messages import ActuatorHealth, OperatorActuator

    if word not in ({"failed", "works"} if name else {None}):
        raise CliError("say `starboard actuator NAME failed` or `starboard actuator NAME works`")
    heard: list[ActuatorHealth] = []
    told = threading.Event()

    def hear(sample: RawSample) -> None:
        health = ActuatorHealth.decode(sample.payload)
        heard.append(health)
        if name is None or (name in health.failed) == (word == "failed"):
            told.set()

    with client(hub) as bus:
        if name is not None:
            order = OperatorActuator(client=f"cli-{os.getpid()}", actuator=name, works=word == "works")
            bus.publish(topics.OPERATOR_ACTUATOR, order.stamped(bus.clock.now_ns(), 0, "cli"))
        bus.subscribe(topics.ACTUATOR_HEALTH.key, hear)
        done = told.wait(ANSWER_S)
    if not heard:
        raise CliError("the allocator is silent: see `starboard status`")
    health = heard[-1]
    if as_json:
        print(json.dumps({"failed": health.failed, "lost": health.lost, "reason": health.reason}))
    else:
        print(health.reason or "all actuators work")
    if not done:
        raise CliError(f"the allocator did not follow: is there an actuator {name!r}? see `starboard vessels`")
