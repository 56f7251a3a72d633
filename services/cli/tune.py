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
LONGER = 5
"""So many times the prediction is made, each twice as long, until it ends at rest."""


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
    from marine.control.model_function import model_function
    from marine.control.preview import natural_time_s
    from marine.control.structures import STRUCTURES, design

    identified: DegreeOfFreedom | None = getattr(vessel.model, dof)
    limit = axis_limits(vessel)[DOFS[dof][2]]
    if identified is None:
        raise CliError(f"{vessel.name} has no model of {dof}")
    if limit == 0.0:
        raise CliError(f"no actuator of {vessel.name} acts on {dof}: nothing to tune")
    if structure not in STRUCTURES:
        raise CliError(f"no structure is called {structure!r}; known: {', '.join(STRUCTURES)}")
    size = math.radians(step) if dof == "yaw" else step
    present = _present(vessel, dof)
    shown = [_judged("present", present, _coefficients(present), vessel, dof, size)] if present else []
    if (structure, model, w0) == ("I-PD", "bessel", None) and present:
        return shown
    usual = 1.0 / natural_time_s(present) if present else vessel.hold_w0_rad_s
    try:
        a = model_function(model, STRUCTURES[structure].order, usual if w0 is None else w0)
    except ValueError as error:
        raise CliError(str(error)) from None
    try:
        loop = design(STRUCTURES[structure], identified, a)
    except ValueError as error:
        return [Candidate("proposed", a, refused=str(error)), *shown]
    return [_judged("proposed", loop, a, vessel, dof, size), *shown]


def _present(vessel: Vessel, dof: str) -> LoopDesign | None:
    """Return the loop that runs by the vessel file alone; None where there is none for a place."""
    from marine.control.heading import HeadingParameters, bessel_design
    from marine.control.model_function import bessel
    from marine.control.structures import STRUCTURES, design
    from services.tuning import serving

    model, w0 = vessel.model, vessel.hold_w0_rad_s
    if dof == "heave" and model.heave is not None:
        return bessel_design(model.heave, w0)
    if serving(vessel) == "positioning":
        return design(STRUCTURES["I-PD"], getattr(model, dof), bessel(3, w0))
    if dof == "yaw":
        return HeadingParameters().design(vessel)
    return design(STRUCTURES["I-PD"], model.surge, bessel(3, w0)) if vessel.sensor("laser") else None


def _coefficients(loop: LoopDesign) -> tuple[float, ...]:
    """Return the model function of an I-PD loop."""
    g = loop.gains
    return g.proportional / g.integral, g.derivative / g.integral, loop.model.alpha / g.integral


def _judged(  # noqa: PLR0917
    name: str, loop: LoopDesign, a: tuple[float, ...], vessel: Vessel, dof: str, step: float
) -> Candidate:
    """Return a design with its prediction, or why it is not allowed."""
    from marine.allocation import axis_limits
    from marine.control.preview import natural_time_s, step_response
    from marine.control.stability import limited, margins
    from services.tuning import too_late

    try:
        loop = limited(loop)
    except ValueError as error:
        return Candidate(name, a, loop, margins(loop), refused=str(error))
    if reason := too_late(loop, vessel, dof):
        return Candidate(name, a, loop, margins(loop), refused=reason)
    duration_s = DURATION * natural_time_s(loop)
    dt_s, limit = duration_s / STEPS, axis_limits(vessel)[DOFS[dof][2]]
    for _ in range(LONGER):
        response = step_response(loop, loop.model, step, limit, duration_s, dt_s)
        if math.isfinite(response.settling_s):
            break
        duration_s *= 2.0  # limited by the actuators it takes longer than w0 says
    return Candidate(name, a, loop, margins(loop), response)


def _figures(c: Candidate, vessel: Vessel, dof: str) -> dict[str, Any]:
    """Return what is said of a design: gains, bounds and prediction, None for what there is not (infinity included)."""
    from marine.allocation import axis_limits
    from marine.control.preview import natural_time_s
    from services.tuning import loop_delay_s, loop_figures, step_figures

    out: dict[str, Any] = {"name": c.name, "model_function": c.model_function}
    out["allowed"], out["reason"] = not c.refused, c.refused
    if c.loop is not None:
        out |= {"w0_rad_s": 1.0 / natural_time_s(c.loop), "loop_delay_s": loop_delay_s(vessel, dof)}
        out |= loop_figures(c.loop)
    if c.response is not None:
        out["predicted"] = step_figures(c.response, axis_limits(vessel)[DOFS[dof][2]])
    return out


def _document(vessel: Vessel, dof: str, step: float, candidates: list[Candidate]) -> dict[str, Any]:
    return {
        "vessel": vessel.name,
        "dof": dof,
        "step": step,
        "step_unit": DOFS[dof][0],
        "designs": [_figures(c, vessel, dof) for c in candidates],
    }


Row = tuple[str, tuple[str, ...], str]
"""Label, path in the figures, unit."""
_ROWS: tuple[Row, ...] = (
    ("w0", ("w0_rad_s",), "rad/s"),
    ("K_I", ("gains", "k_i"), "{tau}/({eta} s)"),
    ("K_P", ("gains", "k_p"), "{tau}/{eta}"),
    ("K_D (constant drag taken off)", ("gains", "k_d"), "{tau} s/{eta}"),
    ("beta/alpha", ("drag_over_inertia_1_s",), "1/s"),
    ("must be below (8.23)", ("bound_1_s",), "1/s"),
    ("drag compensated up to (8.27)", ("speed_limit",), "{eta}/s"),
    ("phase margin", ("margins", "phase_deg"), "deg"),
    ("delay margin", ("margins", "delay_s"), "s"),
    ("must be above: sensor, command", ("loop_delay_s",), "s"),
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
    for k in range(max(len(c["model_function"]) for c in document["designs"])):
        values = (f"{a[k]:.4g}" if k < len(a) else "-" for a in (c["model_function"] for c in document["designs"]))
        print(f"{f'a{k + 1} of the model function':<32}" + "".join(f"{value:>18}" for value in values) + f"  s^{k + 1}")
    print("\n".join(rows_of(_ROWS, document["designs"], units)))
    for c in document["designs"]:
        print(f"{c['name']}: {'allowed' if c['allowed'] else 'NOT ALLOWED: ' + c['reason']}")
    if document["designs"][-1]["name"] != "present":
        print(f"present: none; {vessel.name} keeps no place in {dof}, but a speed (I-P, Table 8.1): docs/guidance.md")


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
