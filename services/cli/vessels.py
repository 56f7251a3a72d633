"""`starboard vessels`: what vessels there are and what each can do."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated, Any

import typer

from services.cli.errors import CliError

MODELS = {
    "HorizontalModel": "uncoupled",
    "CoupledModel": "coupled",
    "SixDofModel": "six_dof",
    "SmallVesselModel": "small_vessel",
    "AsvModel": "asv",
}
"""How a vessel file calls what marine.vessel makes of it."""
ACTUATORS = {
    "QuadraticThrust": "quadratic",
    "AffineThrust": "affine",
    "AsymmetricThrust": "asymmetric",
    "QuadraticLinearThrust": "quadratic_linear",
    "BilinearThrust": "bilinear",
    "Rudder": "rudder",
    "Direct": "direct",
}


def vessels(
    name: Annotated[
        str | None, typer.Argument(help="A name in config/vessels or a file; all vessels without it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw what the vessel can do on each pair of axes into this SVG file.")
    ] = None,
) -> None:
    """Print the vessels: degrees of freedom they control, actuators, sensors, sources."""
    from services.vessels import known_vessels, load_vessel

    if plot is not None:
        from services.cli.attainable_plot import draw_attainable

        if name is None:
            raise CliError("--plot needs one vessel: starboard vessels NAME --plot FILE.svg")
        draw_attainable(load_vessel(name), plot)
    documents = [_document(load_vessel(each)) for each in ([name] if name else known_vessels())]
    if as_json:
        typer.echo(json.dumps({"vessels": documents}, indent=2))
        return
    for document in documents:
        typer.echo(_text(document))


def _document(vessel: Any) -> dict[str, Any]:
    from services.vessels import controllable

    return {
        "name": vessel.name,
        "title": vessel.title,
        "model": MODELS[type(vessel.dynamics).__name__],
        "controlled": list(vessel.controlled),
        "rank": controllable(vessel.actuators),
        "actuators": [_actuator(a) for a in vessel.actuators],
        "sensors": [dataclasses.asdict(s) for s in vessel.sensors],
        "sources": list(vessel.sources),
    }


def _actuator(actuator: Any) -> dict[str, Any]:
    shape = getattr(actuator, "characteristic", actuator)
    return {"kind": ACTUATORS[type(shape).__name__], **dataclasses.asdict(actuator)}


def _text(document: dict[str, Any]) -> str:
    actuators = ", ".join(f"{a['name']} ({a['kind']})" for a in document["actuators"])
    sensors = ", ".join(f"{s['kind']} {s['sample_time_s']:.3g} s" for s in document["sensors"])
    lines = [
        f"{document['name']}: {document['title']}",
        f"  controls   {' '.join(document['controlled'])}; allocation of rank {document['rank']}",
        f"  model      {document['model']}",
        f"  actuators  {actuators}",
        f"  sensors    {sensors}",
        *(f"  source     {source}" for source in document["sources"]),
    ]
    return "\n".join(lines)
