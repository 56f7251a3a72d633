"""The runs of the campaigns: each in a star of its own, then identified from nothing but its MCAP file."""

from __future__ import annotations

import itertools
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from benchmarks.campaigns.star import InstrumentStar, MemoryPilot, RenderedStar
from bus import topics
from bus.messages import ExperimentAxis, ExperimentPlan
from logs.reader import Recording
from marine.allocation import axis_limits
from marine.identification.record import Record, compare, response
from marine.identification.result import IdentificationError, Identified
from marine.vessel import Vessel
from services.campaign import CampaignFile, Place, Results, drive
from services.cli.identify_data import Source, load
from services.vessels import load_vessel, vessel_path

STEP_AXES: tuple[ExperimentAxis, ...] = ("surge", "sway", "yaw")
LEVELS = (0.10, 0.28, 0.46, 0.64, 0.82, 1.00)
"""Forces as parts of the largest."""
STEP_RUNS = 6
"""Of each level: three there and three back; pladypos and the issue say five."""
MOMENT = 0.10
"""Constant disturbance in yaw, as a part of the relay's moment C."""
SHARES = (0.95, 0.98, 0.99)
_SHOWN = 100
"""Points of a response that are kept for the report."""
_BEFORE_WALL_M = 0.40
"""Where runs along the pool start: the hull is 0.10 m from the wall."""


class SelfOscillation(NamedTuple):
    """One kind of self-oscillation run; amplitude: C as a part of the largest."""

    vessel: str
    axis: ExperimentAxis
    amplitude: float
    hysteresis_rad: float | None = None
    oscillations: int = 5


SELF_OSCILLATIONS = (
    SelfOscillation("pladypos", "surge", 0.7),
    SelfOscillation("pladypos", "yaw", 0.5),
    SelfOscillation("videoray", "yaw", 0.3, 0.7, 3),  # large swings: the compass looks ten times a second only
)


class Found(BaseModel):
    """What one method made of a run: parameters in SI, or why there are none."""

    model_config = ConfigDict(frozen=True)

    parameters: dict[str, float] = {}
    warnings: tuple[str, ...] = ()
    failure: str = ""


class Run(BaseModel):
    """One experiment as it was identified from its log. Angles in rad, moments in Nm where the axis is yaw."""

    model_config = ConfigDict(frozen=True)

    kind: Literal["step", "self-oscillation"]
    vessel: str
    axis: ExperimentAxis
    amplitude: float
    direction: int
    seed: int
    duration_s: float
    methods: dict[str, Found]
    force: float
    """Mean size of the force that was delivered, N or Nm."""
    t_s: tuple[float, ...]
    measured: tuple[float, ...]
    simulated: tuple[float, ...]
    ways: tuple[float | None, ...] = ()
    """Of a step: the measured way at which the fitted response is at SHARES of its steady state; None: not reached."""
    wall_m: float | None = None
    """Of a step: the smallest distance of the hull from a wall in the whole log, by the simulator's truth."""


class Job(NamedTuple):
    """One piece of work for a process. vessel_s: about how long it lasts for the vessel."""

    name: str
    vessel_s: float
    make: Callable[..., list[Run]]
    arguments: tuple[Any, ...]


def jobs(seeds: int) -> list[Job]:
    """Return all work, the longest pieces first so that all processes end together."""
    table = [
        Job(f"step {axis} {level:g}", STEP_RUNS * (18.0 + 16.0 / level**0.5), steps, (axis, level, number))
        for number, (level, axis) in enumerate(itertools.product(LEVELS, STEP_AXES), 1)
    ]
    return table + [
        Job(f"self-oscillation {kind.vessel} {kind.axis} seed {seed}", 60.0, self_oscillation, (kind, seed))
        for kind in SELF_OSCILLATIONS
        for seed in range(1, seeds + 1)
    ]


def steps(axis: ExperimentAxis, amplitude: float, seed: int, folder: Path, *, pairs: int = STEP_RUNS // 2) -> list[Run]:
    """Step responses of PlaDyPos at one force: there and back, from rest, the other axes held by the controller."""
    vessel = load_vessel("pladypos")
    campaign = step_campaign(vessel, axis, amplitude, pairs)
    with tempfile.TemporaryDirectory(dir=folder, prefix="run-") as run_dir:
        start = {"x_m": campaign.start.x_m, "y_m": campaign.start.y_m, "psi_rad": campaign.start.psi_rad}
        star = RenderedStar(Path(run_dir), seed=seed, simulator=start)
        told: list[str] = []
        if drive(campaign, Results(Path(run_dir) / "results.jsonl"), MemoryPilot(star), told.append):
            raise RuntimeError("; ".join(line for line in told if "failed" in line))
        return identified(star.finish(), vessel, seed, star.poll_s)


def step_campaign(vessel: Vessel, axis: ExperimentAxis, amplitude: float, pairs: int) -> CampaignFile:
    """Return the campaign of one axis and force: along the pool's length, for sway with the side ahead."""
    pool, psi_deg = vessel.pool, -90.0 if axis == "sway" else 0.0
    y_m = 0.5 * pool.length_y_m
    there, back = Place(x_m=_BEFORE_WALL_M, y_m=y_m, psi_deg=psi_deg), None
    if axis == "yaw":
        there = Place(x_m=0.5 * pool.length_x_m, y_m=y_m)
    else:
        back = Place(x_m=pool.length_x_m - _BEFORE_WALL_M, y_m=y_m, psi_deg=psi_deg)
    return CampaignFile(
        name="step", axis=axis, amplitudes=(amplitude,), repeats=pairs, start=there, start_back=back,
        calm_m_s=0.003, calm_s=2.0,
    )  # fmt: skip


def self_oscillation(kind: SelfOscillation, seed: int, folder: Path) -> list[Run]:
    """One self-oscillation from a random heading; in yaw against a constant moment that nobody knows."""
    vessel, chance = load_vessel(kind.vessel), random.Random(seed)
    moment_nm = chance.choice((-1.0, 1.0)) * MOMENT * kind.amplitude * axis_limits(vessel)[5]
    moment_nm = moment_nm if kind.axis == "yaw" else 0.0
    with tempfile.TemporaryDirectory(dir=folder, prefix="run-") as run_dir:
        by_compass = kind.vessel == "videoray"
        star = (InstrumentStar if by_compass else RenderedStar)(
            Path(run_dir),
            seed=seed,
            vessel=str(_without_camera(Path(run_dir))) if by_compass else kind.vessel,
            unknown={"bias": (0.0, 0.0, 0.0, 0.0, 0.0, moment_nm), "tether": None},
            simulator={"psi_rad": chance.uniform(-3.1, 3.1) if kind.axis == "yaw" else chance.uniform(-0.2, 0.2)},
        )
        plan = ExperimentPlan(
            name="self-oscillation",
            axis=kind.axis,
            amplitude=kind.amplitude,
            hysteresis_rad=kind.hysteresis_rad,
            oscillations=kind.oscillations,
        )
        status, result = MemoryPilot(star).run(plan)
        if result is None:
            raise RuntimeError(status.reason)
        (run,) = identified(star.finish(), vessel, seed, star.poll_s)
        return [run.model_copy(update={"duration_s": status.elapsed_s})]  # the first swings count, too


def _without_camera(folder: Path) -> Path:
    """Write VideoRay as in the thesis: heading from its compass alone, place from a receiver instead of the camera."""
    text = vessel_path("videoray").read_text(encoding="utf-8")
    seen = 'kind = "camera"'
    if text.count(seen) != 1:
        raise ValueError("the vessel file of VideoRay has changed: one sensor must be the camera")
    path = folder / "videoray.toml"
    path.write_text(text.replace(seen, 'kind = "position"\nnoise = 0.005'), encoding="utf-8")
    return path


def identified(log: Path, vessel: Vessel, seed: int, poll_s: float) -> list[Run]:
    """Return every experiment in a log, identified from the log alone; poll_s: known delay besides the vessel's."""
    recording = Recording(log)
    plans: list[ExperimentPlan] = [entry.message.plan for entry in recording.messages(topics.EXPERIMENT_RESULT)]
    runs = []
    for number, plan in enumerate(plans, 1):
        source = Source(None, number, None, None, None, poll_s + vessel.actuation_delay_s, "", False, "")
        record, _ = load(log, source)
        runs.append(_identified(recording, record, vessel, seed, plan))
    return runs


def _identified(recording: Recording, record: Record, vessel: Vessel, seed: int, plan: ExperimentPlan) -> Run:
    methods = compare(record, plan.name)
    first = methods[0][1]
    if isinstance(first, IdentificationError):
        raise RuntimeError(f"{plan.name} in {plan.axis}: {first}")
    shown = slice(None, None, max(1, len(record.t_s) // _SHOWN))
    step = plan.name == "step"
    return Run(
        kind="step" if step else "self-oscillation",
        vessel=vessel.name,
        axis=plan.axis,
        amplitude=plan.amplitude,
        direction=plan.direction,
        seed=seed,
        duration_s=float(record.t_s[-1]),
        methods={name: _found(one) for name, one in methods},
        force=float(np.mean(np.abs(record.tau[:-1]))),
        t_s=tuple(record.t_s[shown].tolist()),
        measured=tuple((record.eta - record.eta[0])[shown].tolist()),
        simulated=tuple((response(record, first)[0] - record.eta[0])[shown].tolist()),
        ways=_ways(record, first) if step else (),
        wall_m=_wall_m(recording, vessel) if step else None,
    )


def _found(one: Identified | IdentificationError) -> Found:
    if isinstance(one, IdentificationError):
        return Found(failure=str(one))
    return Found(parameters={p.name: p.value for p in one.parameters}, warnings=one.warnings)


def _ways(record: Record, found: Identified) -> tuple[float | None, ...]:
    """Return how far the vessel had come (m, rad) when the fitted response was at SHARES of its steady state."""
    force = abs(float(np.mean(record.tau[:-1])))
    time_constant_s = found["alpha"] / float(np.sqrt(found["beta_quadratic"] * force))
    times_s = record.delay_s + time_constant_s * np.arctanh(SHARES)
    way = np.abs(record.eta - record.eta[0])
    return tuple(float(np.interp(time_s, record.t_s, way)) if time_s <= record.t_s[-1] else None for time_s in times_s)


def _wall_m(recording: Recording, vessel: Vessel) -> float:
    truth = recording.series(topics.SIMULATION_TRUTH, "x_m", "y_m")
    x, y, pool = truth["x_m"], truth["y_m"], vessel.pool
    return float(min(x.min(), pool.length_x_m - x.max(), y.min(), pool.length_y_m - y.max())) - vessel.radius_m
