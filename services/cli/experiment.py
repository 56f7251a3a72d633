"""`starboard experiment NAME`: run an identification experiment on the running system, or a whole campaign."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bus.clock import NS
from services.cli.conversation import CLIENT, Conversation, granted, identity
from services.cli.errors import CliError
from services.cli.options import Hub, Json
from services.cli.system import client

if TYPE_CHECKING:
    from bus.messages import (
        ExperimentEstimate,
        ExperimentPlan,
        ExperimentResult,
        ExperimentStatus,
        NavigationState,
    )
    from bus.zenoh_bus import ZenohBus
    from services.campaign import CampaignFile, Place

SILENT_S = 5.0
LEASE_S = 3600.0


def experiment(  # noqa: PLR0917 - typer makes options of them
    name: Annotated[str, typer.Argument(help="step, zigzag, self-oscillation, pull-out, prbs; or campaign, pull.")],
    axis: Annotated[Literal["surge", "sway", "heave", "yaw"], typer.Option(help="Which axis is pushed.")] = "yaw",
    amplitude: Annotated[float, typer.Option(min=0.01, max=1.0, help="Part of what the actuators can do.")] = 0.5,
    reverse: Annotated[bool, typer.Option("--reverse", help="Push the other way first.")] = False,
    hysteresis_m: Annotated[float | None, typer.Option(help="Reverse so far from the start.")] = None,
    hysteresis_deg: Annotated[float | None, typer.Option(help="The same for yaw.")] = None,
    oscillations: Annotated[int, typer.Option(min=2, max=50, help="Consecutive ones that must agree.")] = 5,
    duration_s: Annotated[float | None, typer.Option(help="Longest duration.")] = None,
    laser: Annotated[
        bool, typer.Option("--laser", help="Surge by the distance from the wall ahead, facing it.")
    ] = False,
    speed: Annotated[
        float | None, typer.Option(help="Of yaw: m/s ahead meanwhile; a vessel with a rudder runs, named or not.")
    ] = None,
    take: Annotated[bool, typer.Option("--take", help="Take over from a page that has the helm.")] = False,
    file: Annotated[Path | None, typer.Option(help="Of a campaign: its TOML file.")] = None,
    levels: Annotated[int, typer.Option(min=4, max=50, help="Of pull: forces each way.")] = 6,
    save: Annotated[Path | None, typer.Option(help="Of pull: write a vessel file with the thrust curve here.")] = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="Of pull: read the simulator, no balance.")] = False,
    hub: Hub = None,
    as_json: Json = False,
) -> None:
    """Run an experiment; shows its progress and prints the model. Ctrl-C ends it: the vessel holds where it is."""
    if name == "campaign":
        _campaign(file, hub, take, as_json)
        return
    if name == "pull":
        from services.cli.pull import pull

        with client(hub) as bus:
            pull(BusPilot(bus, take, quiet=True), axis, levels, save=save, simulated=simulated, as_json=as_json)
        return
    from pydantic import ValidationError

    from bus.messages import ExperimentPlan
    from bus.service import first_line

    try:
        plan = ExperimentPlan(
            name=name,
            axis=axis,
            amplitude=amplitude,
            direction=-1 if reverse else 1,
            hysteresis_m=hysteresis_m,
            hysteresis_rad=None if hysteresis_deg is None else math.radians(hysteresis_deg),
            oscillations=oscillations,
            duration_s=duration_s,
            sensor="laser" if laser else None,
            speed_m_s=speed,
        )
    except ValidationError as error:
        raise CliError(first_line(error)) from None
    with client(hub) as bus:
        pilot = BusPilot(bus, take, quiet=as_json)
        status, result = pilot.run(plan)
    if as_json:
        print(json.dumps({"state": status.state, "reason": status.reason, "result": _dump(result)}))
    else:
        print("\n".join(_lines(status, result)))
    if status.state != "done":
        raise typer.Exit(1)


class BusPilot(Conversation):
    """Asks the helm, and waits for what experiment and estimator say."""

    def __init__(self, bus: ZenohBus, take: bool, *, quiet: bool) -> None:
        from bus import topics

        super().__init__(
            bus,
            topics.HELM_ANSWER,
            topics.HELM_STATE,
            topics.EXPERIMENT_STATUS,
            topics.EXPERIMENT_RESULT,
            topics.EXPERIMENT_ESTIMATE,
            topics.NAVIGATION_STATE,
        )
        self._take, self._quiet = take, quiet
        self._asked = False

    def order(self, **wish: Any) -> str:
        """Ask the helm; return the request's id, raise CliError when it refuses."""
        from bus import topics
        from bus.messages import OperatorRequest

        request = OperatorRequest(**identity(), lease_s=LEASE_S, attended=False, take=self._take, **wish)
        granted(self.ask(request, topics.OPERATOR_REQUEST, topics.HELM_ANSWER))
        self._asked = True
        return request.request_id

    def run(self, plan: ExperimentPlan) -> tuple[ExperimentStatus, ExperimentResult | None]:
        """Run an experiment to its end; on Ctrl-C hold instead."""
        from bus import topics

        run = self.order(mode="experiment", experiment=plan)
        try:
            status = self._follow(run)
        except KeyboardInterrupt:
            self.order(mode="hold")
            raise CliError("ended: the vessel holds where it is") from None
        result = self.newest(topics.EXPERIMENT_RESULT)
        return status, result if result is not None and result.run == run else None

    def _follow(self, run: str) -> ExperimentStatus:
        from rich.console import Console

        from bus import topics

        console = Console(stderr=True, quiet=self._quiet)
        told = ""
        last_s, seen_ns = time.monotonic(), 0

        def told_of() -> ExperimentStatus | None:
            status = self.newest(topics.EXPERIMENT_STATUS)
            return status if status is not None and status.run == run and status.stamp_ns > seen_ns else None

        with console.status("waiting for the experiment") as line:
            while time.monotonic() - last_s < SILENT_S:
                self.wait(told_of, 1.0)
                if (status := told_of()) is None:
                    continue
                last_s, seen_ns = time.monotonic(), status.stamp_ns
                if status.state in ("done", "failed"):
                    return status
                estimate = self.newest(topics.EXPERIMENT_ESTIMATE)
                known = estimate_line(estimate) if estimate is not None and estimate.run == run else ""
                line.update(progress_line(status) + known)
                if status.advice and status.advice != told:
                    told = status.advice
                    console.print(f"advice: {told}")
        raise CliError("the experiment's process is silent: see `starboard status`")

    def rest_at(self, place: Place, campaign: CampaignFile) -> None:
        """Hold the place and wait for calm; raise CliError when it does not come, or somebody else took the helm."""
        from rich.console import Console

        from bus import topics
        from services.campaign import at_rest

        helm = self.newest(topics.HELM_STATE)
        if self._asked and helm is not None and helm.mode == "stop":
            raise CliError(f"the helm has stopped ({helm.reason}): the campaign ends here")
        if self._asked and helm is not None and helm.holder not in ("", CLIENT):
            raise CliError(f"{helm.holder} has taken the helm: the campaign ends here")
        self.order(mode="hold", x_m=place.x_m, y_m=place.y_m, psi_rad=place.psi_rad)
        clock, seen_ns = self.bus.clock, 0
        end_ns = clock.now_ns() + round(campaign.patience_s * NS)
        calm_since_ns: int | None = None

        def moved() -> NavigationState | None:
            state = self.newest(topics.NAVIGATION_STATE)
            return state if state is not None and state.stamp_ns > seen_ns else None

        with Console(stderr=True, quiet=self._quiet).status(f"to x {place.x_m:g} m, y {place.y_m:g} m, and calm there"):
            while calm_since_ns is None or seen_ns - calm_since_ns < campaign.calm_s * NS:
                self.wait(moved, 1.0)
                if (state := moved()) is not None:
                    seen_ns = state.stamp_ns
                    calm = at_rest(state, place, campaign)
                    calm_since_ns = (calm_since_ns or seen_ns) if calm else None
                if clock.now_ns() > end_ns:
                    raise CliError(f"no calm at x {place.x_m:g}, y {place.y_m:g} within {campaign.patience_s:g} s")


def progress_line(status: ExperimentStatus) -> str:
    """Return one line of live progress."""
    force = "Nm" if status.unit == "rad" else "N"
    parts = [
        f"{status.name} {status.axis}: {status.phase}",
        f"{100 * status.progress:3.0f} %",
        f"{status.elapsed_s:5.1f} s",
    ]
    parts.append(f"{status.force:+.3g} {force}")
    if status.half_period_s is not None:
        parts.append(f"half period {status.half_period_s:.2f} s")
    if status.amplitude is not None and status.bias is not None:
        parts.append(f"X_m {status.amplitude:.3f} {status.unit}, x_0 {status.bias:+.3f}")
    if status.spread is not None:
        parts.append(f"spread {100 * status.spread:.1f} %, {status.oscillations} in a row")
    return " · ".join(parts)


def estimate_line(estimate: ExperimentEstimate) -> str:
    """Return what recursive least squares know by now, as the end of a line of progress."""
    return "".join(
        f" · {p.name} {p.value:.4g}" + (f" +- {p.std:.1g}" if p.std is not None else "") for p in estimate.parameters
    )


def _lines(status: ExperimentStatus, result: ExperimentResult | None) -> list[str]:
    out = [f"{status.name} {status.axis}: {status.state}{': ' if status.reason else ''}{status.reason}"]
    for method in result.methods if result else ():
        out.append(f"{method.method}: {method.failure or method.model}")
        out += [
            f"  {p.name:15} {p.value:12.6g} {f'+- {p.std:.2g}' if p.std is not None else '':>10} {p.unit}"
            for p in method.parameters
        ]
        out += [f"  warning: {w}" for w in method.warnings]
    if result and result.vessel_file:
        out.append(f"vessel file: {result.vessel_file}")
    return out


def _dump(result: ExperimentResult | None) -> dict[str, Any] | None:
    return result.model_dump(mode="json", exclude={"t_s", "measured", "simulated"}) if result else None


def _campaign(path: Path | None, hub: str | None, take: bool, as_json: bool) -> None:
    from bus.config import parse, read_toml
    from services.campaign import CampaignFile, Results, drive, summary, table

    if path is None:
        raise CliError("a campaign needs --file FILE.toml: see docs/identification.md")
    campaign = parse(CampaignFile, read_toml(path), path)
    results = Results(path.with_suffix(".results.jsonl"))
    try:
        with client(hub) as bus:
            failed = drive(campaign, results, BusPilot(bus, take, quiet=as_json), lambda line: print(line, flush=True))
    except (CliError, KeyboardInterrupt) as why:
        ended = str(why) or "broken off: the vessel holds where it is going"
        made = len(results.of(campaign))
        raise CliError(f"{ended}; {made} runs are in {results.path}, the same command goes on with the rest") from None
    rows = summary(results.of(campaign))
    if as_json:
        print(json.dumps({"failed": failed, "results": [{k: _finite(v) for k, v in row.items()} for row in rows]}))
    else:
        print("\n".join(table(rows)) if rows else "no good run yet")
    if failed:
        raise typer.Exit(1)


def _finite(value: float | str | int) -> float | str | int | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value
