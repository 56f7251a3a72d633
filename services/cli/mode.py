"""`starboard mode NAME`: ask the helm for a mode and a reference."""

from __future__ import annotations

import json
import math
import os
import threading
import uuid
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from services.cli.errors import CliError
from services.cli.system import client

if TYPE_CHECKING:
    from bus.messages import HelmAnswer
    from bus.service import RawSample

ANSWER_S = 2.0


def mode(  # noqa: PLR0917 - typer makes options of them
    name: Annotated[str, typer.Argument(help="stop, manual, hold, ...")],
    x_m: Annotated[float | None, typer.Option(help="Reference in the tank, to the right in the picture.")] = None,
    y_m: Annotated[float | None, typer.Option(help="Reference in the tank, downwards in the picture.")] = None,
    psi_deg: Annotated[float | None, typer.Option(help="Reference heading, clockwise seen from above.")] = None,
    lease_s: Annotated[
        float, typer.Option(help="How long a restarted helm may take the mode up again by itself.")
    ] = 600.0,
    take: Annotated[bool, typer.Option("--take", help="Take over from a page that has the helm.")] = False,
    hub: Annotated[str | None, typer.Option(help="Address of the hub; without it the running system's.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the helm's answer as JSON.")] = False,
) -> None:
    """Ask the helm for a mode; prints what it answered. Exit code 1 when it refuses."""
    from bus import topics
    from bus.messages import HelmAnswer, Mode, OperatorRequest

    if name not in get_args(Mode):
        raise CliError(f"no mode is called {name!r}; known: {', '.join(get_args(Mode))}")
    request = OperatorRequest(
        request_id=uuid.uuid4().hex[:12],
        client=f"cli-{os.getpid()}",
        mode=name,
        x_m=x_m,
        y_m=y_m,
        psi_rad=None if psi_deg is None else math.radians(psi_deg),
        lease_s=lease_s,
        attended=False,
        take=take,
    )
    answers: list[HelmAnswer] = []
    answered = threading.Event()

    def hear(sample: RawSample) -> None:
        answer = HelmAnswer.decode(sample.payload)
        if answer.request_id == request.request_id:
            answers.append(answer)
            answered.set()

    with client(hub) as bus:
        bus.subscribe(topics.HELM_ANSWER.key, hear)
        bus.publish(topics.OPERATOR_REQUEST, request.stamped(bus.clock.now_ns(), 0, "cli"))
        if not answered.wait(ANSWER_S):
            raise CliError(f"the helm did not answer within {ANSWER_S:.0f} s: see `starboard status`")
    answer = answers[0]
    if as_json:
        print(json.dumps({"accepted": answer.accepted, "mode": name, "reason": answer.reason}))
    else:
        print(f"{name}: {'accepted' if answer.accepted else 'refused'}{': ' if answer.reason else ''}{answer.reason}")
    if not answer.accepted:
        raise typer.Exit(1)
