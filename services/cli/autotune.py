"""`starboard autotune AXIS`: thesis Algorithm 8.4 on the running system, from a self-oscillation to the engaged law."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from services.cli.conversation import Conversation, granted, identity
from services.cli.errors import CliError
from services.cli.options import Hub, Json
from services.cli.system import client, running
from services.cli.tune import Row, rows_of

if TYPE_CHECKING:
    from bus.messages import AxisModel, ControlGains, ExperimentResult, TunedAxis, Tuning
    from bus.zenoh_bus import ZenohBus
    from marine.vessel import Vessel

GAINS_S = 5.0

ROWS: tuple[Row, ...] = (
    ("inertia alpha", ("model", "alpha"), "{tau} s2/{eta}"),
    ("constant drag beta", ("model", "beta"), "{tau} s/{eta}"),
    ("linear drag beta_quadratic", ("model", "beta_quadratic"), "{tau} s2/{eta}2"),
    ("K_I", ("gains", "k_i"), "{tau}/({eta} s)"),
    ("K_P", ("gains", "k_p"), "{tau}/{eta}"),
    ("K_D (constant drag taken off)", ("gains", "k_d"), "{tau} s/{eta}"),
    ("beta/alpha", ("drag_over_inertia_1_s",), "1/s"),
    ("must be below (8.23)", ("bound_1_s",), "1/s"),
    ("phase margin", ("margins", "phase_deg"), "deg"),
    ("delay margin", ("margins", "delay_s"), "s"),
    ("pushed aside: overshoot", ("aside", "overshoot_percent"), "%"),
    ("back within 5 % after", ("aside", "settling_s"), "s"),
    ("new reference: overshoot", ("step", "overshoot_percent"), "%"),
    ("within 5 % after", ("step", "settling_s"), "s"),
    ("time at the limit", ("aside", "saturated_s"), "s"),
    ("actuator activity (IADC)", ("aside", "actuator_activity"), "{tau}"),
)


def autotune(  # noqa: PLR0917 - typer makes options of them
    axis: Annotated[Literal["yaw", "surge", "sway", "all"], typer.Argument(help="Which axis is identified.")] = "yaw",
    law: Annotated[str | None, typer.Option(help="Law to design: `starboard tune --list`; none: the present.")] = None,
    w0: Annotated[float | None, typer.Option(help="Characteristic frequency in rad/s, of the axes identified.")] = None,
    amplitude: Annotated[float, typer.Option(min=0.01, max=1.0, help="Part of what the actuators can do.")] = 0.7,
    oscillations: Annotated[int, typer.Option(min=2, max=50, help="Consecutive ones that must agree.")] = 3,
    back: Annotated[bool, typer.Option("--back", help="No experiment: go back to what ran before.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Engage without asking, if it is allowed.")] = False,
    take: Annotated[bool, typer.Option("--take", help="Take over from a page that has the helm.")] = False,
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Identify, design, show beside the present gains, engage when you agree. Exit code 1: not allowed, not engaged."""
    with client(hub) as bus:
        desk = Desk(bus)
        present = desk.gains()
        if back:
            if present.before is None and not present.engaged:
                raise CliError("the configuration file's law runs, and nothing was engaged before it")
            desk.engage(present.before)
            print("engaged: what ran before")
            return
        vessel = _vessel()
        models = {one: _identified(bus, one, amplitude, oscillations, take, as_json) for one in _axes(axis, vessel)}
        proposal = proposed(present, law, w0, models)
        refused, document = compared(vessel, proposal, present)
        if not as_json:
            print("\n".join(lines(document, [*models])))
        if refused:
            raise CliError(f"not allowed: {refused}")
        engaged = yes or (not as_json and sys.stdin.isatty() and typer.confirm("Engage?"))
        if engaged:
            desk.engage(proposal)
    if as_json:
        print(json.dumps({"engaged": engaged, "tuning": proposal.model_dump(mode="json"), "axes": document}))
    else:
        print("engaged" if engaged else "not engaged")
    if not engaged:
        raise typer.Exit(1)


class Desk(Conversation):
    """Asks the controller, and hears what it runs."""

    def __init__(self, bus: ZenohBus) -> None:
        from bus import topics

        super().__init__(bus, topics.CONTROL_GAINS, topics.CONTROL_ANSWER)

    def gains(self) -> ControlGains:
        """Return what is in force, which is told every second; raise CliError when it is not."""
        from bus import topics

        self.wait(lambda: self.newest(topics.CONTROL_GAINS), GAINS_S)
        if (told := self.newest(topics.CONTROL_GAINS)) is None:
            raise CliError("the controller does not tell its gains: see `starboard status`")
        return told

    def engage(self, tuning: Tuning | None) -> None:
        """Have a tuning engaged (None: the configuration file's); raise CliError when it is refused."""
        from bus import topics
        from bus.messages import TuningRequest

        request = TuningRequest(**identity(), tuning=tuning)
        granted(self.ask(request, topics.OPERATOR_TUNING, topics.CONTROL_ANSWER))


def _axes(axis: str, vessel: Vessel) -> tuple[TunedAxis, ...]:
    from services.tuning import tuned_axes

    order: tuple[TunedAxis, ...] = ("yaw", "surge", "sway")
    can = tuned_axes(vessel)
    if axis != "all" and axis not in can:
        raise CliError(f"{vessel.name} has no law that acts on {axis}: tune {', '.join(can)}")
    return tuple(one for one in order if one in can and axis in ("all", one))


def _vessel() -> Vessel:
    from services.catalog import load_settings
    from services.vessels import load_vessel

    system = running()
    return load_vessel(load_settings(system.config if system else None).system.vessel)


def _identified(  # noqa: PLR0917
    bus: ZenohBus, axis: TunedAxis, amplitude: float, oscillations: int, take: bool, quiet: bool
) -> AxisModel:
    from bus.messages import ExperimentPlan
    from services.cli.experiment import BusPilot

    plan = ExperimentPlan(name="self-oscillation", axis=axis, amplitude=amplitude, oscillations=oscillations)
    status, result = BusPilot(bus, take, quiet=quiet).run(plan)
    if status.state != "done" or result is None:
        raise CliError(f"{axis} was not identified: {status.reason or status.advice or status.state}")
    if not quiet:
        print(f"{axis}: {result.methods[0].method}, {status.elapsed_s:.0f} s; vessel file: {result.vessel_file or '-'}")
    return model_of(result)


def model_of(result: ExperimentResult) -> AxisModel:
    """Return the model that an experiment's best method gave."""
    from bus.messages import AxisModel

    found = {p.name: p.value for p in result.methods[0].parameters}
    return AxisModel(**{name: found.get(name, 0.0) for name in AxisModel.model_fields})


def proposed(present: ControlGains, law: str | None, w0: float | None, models: dict[TunedAxis, AxisModel]) -> Tuning:
    """Return the present tuning with the identified models, perhaps another law, and w0 (rad/s) where it is theirs."""
    from bus.messages import Tuning

    same = law in (None, present.tuning.law)
    parameters = dict(present.tuning.parameters) if same else {}
    if w0 is not None:
        parameters |= {"yaw_w0_rad_s": w0} if "yaw" in models else {}
        parameters |= {"w0_rad_s": w0} if {"surge", "sway"} & set(models) else {}
    return Tuning(law=law or present.tuning.law, parameters=parameters, models={**present.tuning.models, **models})


def compared(vessel: Vessel, proposal: Tuning, present: ControlGains) -> tuple[str, dict[str, dict[str, Any]]]:
    """Return why a proposal is not allowed, and by axis what it and the present law do on the proposal's models."""
    from services.tuning import TuningError, horizontal_limits, preview

    limits, refused = horizontal_limits(vessel), ""
    document: dict[str, dict[str, Any]] = {}
    for name, tuning in (("proposed", proposal), ("present", present.tuning)):
        try:
            found = preview(tuning, vessel, limits, present.shaping, proposal.models)
        except TuningError as error:
            refused = refused or (str(error) if name == "proposed" else "")
            continue
        for axis, figures in found.items():
            document.setdefault(axis, {})[name] = figures | {"model": tuning.models[axis].model_dump()}
    return refused, document


def lines(document: dict[str, dict[str, Any]], axes: list[TunedAxis]) -> list[str]:
    """Return the comparison as text, a table for each axis."""
    out = []
    for axis in axes:
        units = {"eta": "rad", "tau": "Nm"} if axis == "yaw" else {"eta": "m", "tau": "N"}
        out.append(f"{axis:<32}{'proposed':>18}{'present':>18}")
        out += rows_of(ROWS, [document.get(axis, {}).get(name) for name in ("proposed", "present")], units)
    return out
