"""A campaign of experiments from one file: levels x directions x repeats, from the same place, in calm water."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Literal, Protocol

from pydantic import Field

from bus.config import Section
from bus.messages import (
    ExperimentAxis,
    ExperimentName,
    ExperimentPlan,
    ExperimentResult,
    ExperimentStatus,
    NavigationState,
)
from marine.frames import wrap_angle


class Place(Section):
    """Where a run starts, in {E}."""

    x_m: float
    y_m: float
    psi_deg: float = 0.0

    @property
    def psi_rad(self) -> float:
        """The heading in rad."""
        return math.radians(self.psi_deg)


class CampaignFile(Section):
    """The file. Runs go through amplitudes, then directions, then repeats."""

    name: ExperimentName
    axis: ExperimentAxis
    amplitudes: tuple[float, ...] = Field(min_length=1, description="parts of what the actuators can do")
    directions: tuple[Literal[-1, 1], ...] = (1, -1)
    repeats: int = Field(5, ge=1)
    tries: int = Field(2, ge=1, description="of each run: a lost pose spoils one, not the campaign")
    hysteresis_m: float | None = None
    hysteresis_rad: float | None = None
    oscillations: int = 5
    duration_s: float | None = None
    start: Place = Field(description="where runs with direction 1 start")
    start_back: Place | None = Field(None, description="where runs with direction -1 start; none: the same place")
    near_m: float = Field(0.05, gt=0, description="so near to the start,")
    near_deg: float = Field(3.0, gt=0, description="so near to its heading, and")
    calm_m_s: float = Field(0.01, gt=0, description="so slow, turning included (rad/s x 0.3 m),")
    calm_s: float = Field(3.0, ge=0, description="for so long before each run")
    patience_s: float = Field(120.0, gt=0, description="longest wait for that")

    def runs(self) -> Iterator[tuple[str, Place, ExperimentPlan]]:
        """Yield each run: what it is called in the results, where it starts, what it does."""
        for amplitude in self.amplitudes:
            for repeat in range(1, self.repeats + 1):
                for direction in self.directions:  # opposite runs follow each other: a current changes slowly
                    back = self.start_back if direction < 0 else None
                    plan = ExperimentPlan(
                        name=self.name,
                        axis=self.axis,
                        amplitude=amplitude,
                        direction=direction,
                        hysteresis_m=self.hysteresis_m,
                        hysteresis_rad=self.hysteresis_rad,
                        oscillations=self.oscillations,
                        duration_s=self.duration_s,
                    )
                    yield f"{amplitude:g} {direction:+d} {repeat}", back or self.start, plan


class Pilot(Protocol):
    """What a campaign needs of the running system."""

    def rest_at(self, place: Place, campaign: CampaignFile) -> None:
        """Hold the place and wait for calm; raise TimeoutError when it does not come."""

    def run(self, plan: ExperimentPlan) -> tuple[ExperimentStatus, ExperimentResult | None]:
        """Run an experiment to its end."""


def at_rest(state: NavigationState, place: Place, campaign: CampaignFile) -> bool:
    """Whether the vessel is at a place, turned as wanted, and slow."""
    away_m = math.hypot(state.x_m - place.x_m, state.y_m - place.y_m)
    turned_deg = math.degrees(abs(wrap_angle(state.psi_rad - place.psi_rad)))
    speed_m_s = math.hypot(state.surge_m_s, state.sway_m_s) + 0.3 * abs(state.yaw_rad_s)
    return away_m <= campaign.near_m and turned_deg <= campaign.near_deg and speed_m_s <= campaign.calm_m_s


@dataclass
class Results:
    """What came out so far: a line of JSON per good run, so that a campaign goes on after a break."""

    path: Path

    def of(self, campaign: CampaignFile) -> dict[str, ExperimentResult]:
        """Return the good runs of a campaign by name; what was made by another plan is left out."""
        plans = {name: plan for name, _, plan in campaign.runs()}
        return {name: result for name, result in self._read() if plans.get(name) == result.plan}

    def _read(self) -> Iterator[tuple[str, ExperimentResult]]:
        """Yield what is in the file; a half-written line is left out."""
        for line in self.path.read_text(encoding="utf-8").splitlines() if self.path.exists() else ():
            try:
                entry = json.loads(line)
                yield entry["run"], ExperimentResult.model_validate(entry["result"])
            except (ValueError, KeyError, TypeError):
                continue

    def add(self, run: str, result: ExperimentResult) -> None:
        """Append a run."""
        text = json.dumps({"run": run, "result": result.model_dump(mode="json")}) + "\n"
        with self.path.open("ab+") as file:
            if file.tell():
                file.seek(-1, os.SEEK_END)
                text = text if file.read(1) == b"\n" else "\n" + text  # the process before was killed while it wrote
            file.write(text.encode())


def drive(campaign: CampaignFile, results: Results, pilot: Pilot, tell: Callable[[str], None]) -> int:
    """Make the runs that are not in the results yet; return how many failed."""
    done = results.of(campaign)
    wanted = list(campaign.runs())
    failed = 0
    for number, (name, place, plan) in enumerate(wanted, 1):
        title = f"{number} of {len(wanted)}, {name}"
        if name in done:
            tell(f"{title}: made before")
            continue
        for _ in range(campaign.tries):
            pilot.rest_at(place, campaign)
            status, result = pilot.run(plan)
            if result is not None and status.state == "done":
                results.add(name, result)
                tell(f"{title}: " + ", ".join(f"{p.name} {p.value:.4g} {p.unit}" for p in result.methods[0].parameters))
                break
            tell(f"{title}: failed: {status.reason}")
        else:
            failed += 1
    return failed


def summary(results: dict[str, ExperimentResult]) -> list[dict[str, float | str | int]]:
    """Return mean and standard deviation (ddof = 1) of each parameter by each method, as pladypos Table 2.

    First over all runs (amplitude 0), then by amplitude. Runs with a warning that they end short of their steady state
    count in `marked`.
    """
    levels = sorted({result.plan.amplitude for result in results.values()})
    rows = _means(0.0, list(results.values()))
    for level in levels if len(levels) > 1 else ():
        rows += _means(level, [result for result in results.values() if result.plan.amplitude == level])
    return rows


def _means(amplitude: float, results: list[ExperimentResult]) -> list[dict[str, float | str | int]]:
    values: dict[tuple[str, str, str], list[float]] = {}
    marked: dict[str, int] = {}
    for result in results:
        for method in result.methods:
            marked[method.method] = marked.get(method.method, 0) + any("steady state" in w for w in method.warnings)
            for p in method.parameters:
                values.setdefault((method.method, p.name, p.unit), []).append(p.value)
    rows: list[dict[str, float | str | int]] = []
    for (how, name, unit), found in values.items():
        std = stdev(found) if len(found) > 1 else math.nan
        rows.append(
            {"amplitude": amplitude, "method": how, "parameter": name, "unit": unit, "runs": len(found),
             "mean": fmean(found), "std": std, "marked": marked[how]}
        )  # fmt: skip
    return rows


def table(rows: list[dict[str, float | str | int]]) -> list[str]:
    """Return a summary as lines of columns."""
    cells = [list(rows[0]), *([_cell(k, v) for k, v in row.items()] for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in cells]


def _cell(key: str, value: float | str | int) -> str:
    if key == "amplitude" and not value:
        return "all"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
