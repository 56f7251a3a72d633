"""`starboard mode NAME`: ask the helm for a mode and a reference: a place, a speed, a depth, a distance, way-points."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, get_args

import typer

from services.cli.conversation import Conversation, identity
from services.cli.errors import CliError
from services.cli.options import complete_mode
from services.cli.system import client


def mode(  # noqa: PLR0917 - typer makes options of them
    name: Annotated[
        str,
        typer.Argument(
            help="stop, manual, hold, heading, speed, depth, distance, line, path.", autocompletion=complete_mode
        ),
    ],
    file: Annotated[Path | None, typer.Argument(help="Of a path: a file with x,y in m on each line.")] = None,
    x_m: Annotated[float | None, typer.Option(help="Reference in the tank, to the right in the picture.")] = None,
    y_m: Annotated[float | None, typer.Option(help="Reference in the tank, downwards in the picture.")] = None,
    psi_deg: Annotated[float | None, typer.Option(help="Reference heading, clockwise seen from above.")] = None,
    speed_m_s: Annotated[
        float | None, typer.Option(help="Speed: ahead, or along a line or path (else half of the top).")
    ] = None,
    depth_m: Annotated[float | None, typer.Option(help="Depth, of a vessel that dives.")] = None,
    distance_m: Annotated[float | None, typer.Option(help="From the wall ahead, by the laser module.")] = None,
    from_x_m: Annotated[
        float | None, typer.Option(help="Beginning of a line; without it the line begins here.")
    ] = None,
    from_y_m: Annotated[float | None, typer.Option(help="The same.")] = None,
    to_x_m: Annotated[float | None, typer.Option(help="End of a line.")] = None,
    to_y_m: Annotated[float | None, typer.Option(help="The same.")] = None,
    point: Annotated[list[str] | None, typer.Option(help="Way-point x,y in m of a path; once for each.")] = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="A spline through the way-points.")] = False,
    lease_s: Annotated[
        float | None,
        typer.Option(
            help="How long a restarted helm may take the mode up again, and a line, path or speed goes on. "
            "Default: 600, of these an hour."
        ),
    ] = None,
    take: Annotated[bool, typer.Option("--take", help="Take over from a page that has the helm.")] = False,
    hub: Annotated[str | None, typer.Option(help="Address of the hub; without it the running system's.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the helm's answer as JSON.")] = False,
) -> None:
    """Ask the helm for a mode; prints what it answered. Exit code 1 when it refuses."""
    from pydantic import ValidationError

    from bus import topics
    from bus.messages import Mode, OperatorRequest
    from bus.service import first_line

    if name not in get_args(Mode):
        raise CliError(f"no mode is called {name!r}; known: {', '.join(get_args(Mode))}")
    places = [*_line((from_x_m, from_y_m), (to_x_m, to_y_m)), *_path(file, point or [])]
    try:
        request = OperatorRequest.model_validate(
            {
                **identity(),
                "mode": name,
                "x_m": x_m,
                "y_m": y_m,
                "psi_rad": None if psi_deg is None else math.radians(psi_deg),
                "z_m": depth_m,
                "speed_m_s": speed_m_s,
                "distance_m": distance_m,
                "points": [{"x_m": x, "y_m": y} for x, y in places],
                "smooth": smooth,
                "lease_s": lease_s or (3600.0 if name in ("line", "path", "speed") else 600.0),
                "attended": False,
                "take": take,
            }
        )
    except ValidationError as error:
        raise CliError(first_line(error)) from None
    with client(hub) as bus:
        answer = Conversation(bus, topics.HELM_ANSWER).ask(request, topics.OPERATOR_REQUEST, topics.HELM_ANSWER)
    if as_json:
        print(json.dumps({"accepted": answer.accepted, "mode": name, "reason": answer.reason}))
    else:
        print(f"{name}: {'accepted' if answer.accepted else 'refused'}{': ' if answer.reason else ''}{answer.reason}")
    if not answer.accepted:
        raise typer.Exit(1)


def _line(*ends: tuple[float | None, float | None]) -> list[tuple[float, float]]:
    """Return the ends of a line that are given; raise CliError for half of one."""
    given = []
    for (x, y), which in zip(ends, ("from", "to"), strict=True):
        if x is not None and y is not None:
            given.append((x, y))
        elif (x, y) != (None, None):
            raise CliError(f"--{which}-x-m and --{which}-y-m belong together")
    return given


def _path(file: Path | None, points: Sequence[str]) -> list[tuple[float, float]]:
    """Return way-points of a file (lines that begin with # or letters are not read) and of --point."""
    lines = [(f"--point {text}", text) for text in points]
    if file is not None:
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise CliError(f"{file}: cannot be read: {error}") from None
        read = [(f"{file}, line {n}", line.strip()) for n, line in enumerate(text.splitlines(), 1)]
        lines = [(where, line) for where, line in read if line and not (line[0] == "#" or line[0].isalpha())] + lines
    places = []
    for where, line in lines:
        try:
            x, y = (float(part) for part in line.split(","))
        except ValueError:
            raise CliError(f"{where}: a way-point is x,y in metres, not {line!r}") from None
        places.append((x, y))
    return places
