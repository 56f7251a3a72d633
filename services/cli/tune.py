"""`starboard tune VESSEL DOF`: design a loop by a model function, and see what it will do before it is engaged."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from marine.control.preview import StepResponse
    from marine.control.stability import Margins
    from marine.control.structures import LoopDesign
    from marine.vessel import DegreeOfFreedom, Vessel

DOFS = {"surge": ("m", "N", 0), "sway": ("m", "N", 1), "heave": ("m", "N", 2), "yaw": ("deg", "Nm", 5)}
"""Degree of freedom -> unit of a step, unit of tau, component of the wrench."""

DURATION = 20.0
"""Of the predicted step, in units of 1/w0."""
STEPS = 4000


@dataclass(frozen=True)
class Candidate:
    """One design with everything that is said of it; a refused one has a reason and no prediction."""

    name: str
    model_function: tuple[float, ...]
    loop: LoopDesign | None = None
    margins: Margins | None = None
    response: StepResponse | None = None
    refused: str = ""


def tune(  # noqa: PLR0917 - typer makes options of them
    vessel: Annotated[
        str | None, typer.Argument(help="A name in config/vessels, or the path of a vessel file.")
    ] = None,
    dof: Annotated[str | None, typer.Argument(help=f"{', '.join(DOFS)}.")] = None,
    w0: Annotated[
        float | None, typer.Option(help="Characteristic frequency in rad/s; without it the vessel file's.")
    ] = None,
    model: Annotated[str, typer.Option(help="Model function: bessel, butterworth, or a1,a2,a3.")] = "bessel",
    structure: Annotated[str, typer.Option(help="P, PD, P-D, PI, I-P, PID, PI-D, I-PD.")] = "I-PD",
    step: Annotated[float | None, typer.Option(help="Step to predict: m (1), yaw in degrees (90).")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the predicted steps: FILE.svg or FILE.html.")] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the positioning laws and their parameters.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Show gains, margins, bounds and the predicted step beside the present gains. Exit code 1: not allowed."""
    if show_list:
        _list(as_json)
        return
    if vessel is None or dof is None:
        raise CliError(f"say which vessel and which of {', '.join(DOFS)}, or --list for the laws")
    if dof not in DOFS:
        raise CliError(f"no degree of freedom is called {dof!r}; known: {', '.join(DOFS)}")
    from services.vessels import load_vessel

    loaded = load_vessel(vessel)
    wanted = step if step is not None else (90.0 if dof == "yaw" else 1.0)
    if not (math.isfinite(wanted) and wanted != 0.0):
        raise CliError("--step must be a number other than zero")
    candidates = _candidates(loaded, dof, structure, model, w0, wanted)
    if plot:
        from services.cli.tune_plot import write_plot

        write_plot(plot, f"{loaded.title}: {dof}", candidates, *DOFS[dof][:2], wanted)
    if as_json:
        print(json.dumps(_document(loaded, dof, wanted, candidates)))
    else:
        _print(loaded, dof, wanted, candidates)
    if candidates[0].refused:
        raise typer.Exit(1)


def _candidates(  # noqa: PLR0917
    vessel: Vessel, dof: str, structure: str, model: str, w0: float | None, step: float
) -> list[Candidate]:
    """Return the proposed design, and the present one unless it is the same; raise CliError for nonsense."""
    from marine.allocation import axis_limits
    from marine.control.model_function import bessel, model_function
    from marine.control.structures import STRUCTURES

    identified: DegreeOfFreedom | None = getattr(vessel.model, dof)
    limit = axis_limits(vessel)[DOFS[dof][2]]
    if identified is None:
        raise CliError(f"{vessel.name} has no model of {dof}")
    if limit == 0.0:
        raise CliError(f"no actuator of {vessel.name} acts on {dof}: nothing to tune")
    if structure not in STRUCTURES:
        raise CliError(f"no structure is called {structure!r}; known: {', '.join(STRUCTURES)}")
    present = bessel(3, vessel.hold_w0_rad_s)
    try:
        a = model_function(model, STRUCTURES[structure].order, vessel.hold_w0_rad_s if w0 is None else w0)
    except ValueError as error:
        raise CliError(str(error)) from None
    size = math.radians(step) if dof == "yaw" else step
    if structure == "I-PD" and a == present:
        return [_candidate("present", structure, identified, a, size, limit)]
    return [
        _candidate("proposed", structure, identified, a, size, limit),
        _candidate("present", "I-PD", identified, present, size, limit),
    ]


def _candidate(  # noqa: PLR0917
    name: str, structure: str, identified: DegreeOfFreedom, a: tuple[float, ...], step: float, limit: float
) -> Candidate:
    from marine.control.preview import natural_time_s, step_response
    from marine.control.stability import limited, margins
    from marine.control.structures import STRUCTURES, design

    try:
        loop = design(STRUCTURES[structure], identified, a)
    except ValueError as error:
        return Candidate(name, a, refused=str(error))
    try:
        loop = limited(loop)
    except ValueError as error:
        return Candidate(name, a, loop, margins(loop), refused=str(error))
    duration_s = DURATION * natural_time_s(loop)
    response = step_response(loop, identified, step, limit, duration_s, duration_s / STEPS)
    return Candidate(name, a, loop, margins(loop), response)


def _figures(c: Candidate, limit: float) -> dict[str, Any]:
    """Return what is said of a design: gains, bounds and prediction, None for what there is not (infinity included)."""
    from services.tuning import loop_figures, step_figures

    out: dict[str, Any] = {"name": c.name, "model_function": c.model_function}
    out["allowed"], out["reason"] = not c.refused, c.refused
    if c.loop is not None:
        out |= loop_figures(c.loop)
    if c.response is not None:
        out["predicted"] = step_figures(c.response, limit)
    return out


def _document(vessel: Vessel, dof: str, step: float, candidates: list[Candidate]) -> dict[str, Any]:
    from marine.allocation import axis_limits

    limit = axis_limits(vessel)[DOFS[dof][2]]
    return {
        "vessel": vessel.name,
        "dof": dof,
        "step": step,
        "step_unit": DOFS[dof][0],
        "designs": [_figures(c, limit) for c in candidates],
    }


Row = tuple[str, tuple[str, ...], str]
"""Label, path in the figures, unit."""
_ROWS: tuple[Row, ...] = (
    ("K_I", ("gains", "k_i"), "{tau}/({eta} s)"),
    ("K_P", ("gains", "k_p"), "{tau}/{eta}"),
    ("K_D (constant drag taken off)", ("gains", "k_d"), "{tau} s/{eta}"),
    ("beta/alpha", ("drag_over_inertia_1_s",), "1/s"),
    ("must be below (8.23)", ("bound_1_s",), "1/s"),
    ("drag compensated up to (8.27)", ("speed_limit",), "{eta}/s"),
    ("phase margin", ("margins", "phase_deg"), "deg"),
    ("delay margin", ("margins", "delay_s"), "s"),
    ("gain may fall to", ("margins", "gain_down"), "times"),
    ("gain may rise to", ("margins", "gain_up"), "times"),
    ("overshoot", ("predicted", "overshoot_percent"), "%"),
    ("settled to 5 % after", ("predicted", "settling_s"), "s"),
    ("largest speed", ("predicted", "largest_speed"), "{eta}/s"),
    ("largest demand", ("predicted", "largest_demand"), "{tau}"),
    ("limit of the actuators", ("predicted", "limit"), "{tau}"),
    ("time at the limit", ("predicted", "saturated_s"), "s"),
    ("actuator activity (IADC)", ("predicted", "actuator_activity"), "{tau}"),
)


def _print(vessel: Vessel, dof: str, step: float, candidates: list[Candidate]) -> None:
    document = _document(vessel, dof, step, candidates)
    units = {"eta": "rad" if dof == "yaw" else "m", "tau": DOFS[dof][1]}
    print(f"{vessel.name} {dof}, step of {step:g} {DOFS[dof][0]}")
    print(f"{'':32}" + "".join(f"{c['name'] + ' ' + c.get('structure', ''):>18}" for c in document["designs"]))
    functions = (", ".join(f"{a:.4g}" for a in c["model_function"]) for c in document["designs"])
    print(f"{'model function a1, a2, ...':<32}" + "".join(f"{f:>18}" for f in functions))
    print("\n".join(rows_of(_ROWS, document["designs"], units)))
    for c in document["designs"]:
        print(f"{c['name']}: {'allowed' if c['allowed'] else 'NOT ALLOWED: ' + c['reason']}")


def rows_of(rows: Sequence[Row], columns: Sequence[dict[str, Any] | None], units: dict[str, str]) -> list[str]:
    """Return the rows of a table of figures, without those that no column has."""
    out = []
    for label, path, unit in rows:
        values = [_at(column or {}, path) for column in columns]
        if any(v is not None for v in values):
            cells = "".join(f"{'-' if v is None else f'{v:.4g}':>18}" for v in values)
            out.append(f"{label:<32}{cells}  {unit.format(**units)}")
    return out


def _at(document: dict[str, Any], path: tuple[str, ...]) -> float | None:
    value: Any = document
    for key in path:
        value = (value or {}).get(key)
    return value if value is None else float(value)


def _list(as_json: bool) -> None:
    from marine.control.laws import laws_document

    laws = laws_document()
    if as_json:
        print(json.dumps({"laws": laws}))
        return
    for law in laws:
        integral = "own integral" if law["integral"] else "disturbance from the estimator"
        print(f"{law['name']}  serves {law['serves']}; {integral}\n    {law['doc']}")
        for parameter in law["parameters"]:  # type: ignore[attr-defined]
            print(f"    {parameter['name']} = {parameter['default']}  {parameter['doc']}")
