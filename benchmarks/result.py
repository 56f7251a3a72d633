"""What a benchmark measures, as `starboard bench NAME --json` prints it."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass, field
from pathlib import Path


class NotMeasured(Exception):  # noqa: N818 - not a mistake of the program
    """The benchmark could not measure: no value is printed, exit code 1."""


@dataclass(frozen=True)
class Result:
    """One figure: snake_case name with its unit last, the value, and peers measured in the same run."""

    metric: str
    value: float
    peers: dict[str, float] = field(default_factory=dict)
    goal: float | None = None
    """What the issue asks for; printed beside the value."""


def machine() -> dict[str, object]:
    """Return what a reader needs to judge the figures."""
    model = next(
        (
            line.split(":", 1)[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if "model name" in line
        ),
        platform.processor(),
    )
    with Path("/proc/loadavg").open() as load:
        busy = float(load.read().split()[0])
    return {"cpu": model, "cores": os.cpu_count(), "python": platform.python_version(), "load_before": busy}


def percentile(values: list[float], percent: float) -> float:
    """Return a percentile by the nearest rank; raise NotMeasured without values."""
    if not values:
        raise NotMeasured("no sample was measured")
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100.0))]


def table(results: list[Result]) -> str:
    """Return the figures as a Markdown table with a column for each peer."""
    peers = list(dict.fromkeys(peer for result in results for peer in result.peers))
    lines = [["", "goal", "ours", *peers], ["---"] * (3 + len(peers))]
    for r in results:
        figures = (r.goal, r.value, *map(r.peers.get, peers))
        lines.append([f"`{r.metric}`", *("" if v is None else f"{v:.3g}" for v in figures)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
