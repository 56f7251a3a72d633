"""What all figures share: charts with a caption, bars, and lines of a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from services.cli.svg import Chart

_BAR = 0.25
"""Width of a bar; numbers of experiments and criteria are 1 apart."""


@dataclass(frozen=True)
class Figure:
    """Charts side by side, a caption that says what is compared with what, and a table for the terminal."""

    charts: tuple[Chart, ...]
    caption: str
    table: tuple[str, ...] = ()


def bars(chart: Chart, at: Sequence[float], heights: Sequence[float], label: str, *, width: float = _BAR) -> None:
    """Draw one group of bars from zero; at: middles."""
    corners: list[tuple[float, float]] = []
    for x, height in zip(at, heights, strict=True):
        left, right = x - 0.5 * width, x + 0.5 * width
        corners += [(left, 0.0), (left, float(height)), (right, float(height)), (right, 0.0)]
    chart.area(corners, label)


def pairs_chart(title: str, decisions: Sequence[tuple[int, int, int]], right: int) -> Chart:
    """Return a chart of decisions by criterion; right: 0 if linear drag is the right choice, 1 if constant drag is."""
    chart = Chart(title, "criterion of (7.1)", "pairs of experiments")
    for offset, (label, column) in enumerate((("correct", right), ("false", 1 - right), ("no decision", 2))):
        at = [k + 1 + _BAR * (offset - 1) for k in range(len(decisions))]
        bars(chart, at, [d[column] for d in decisions], label)
    return chart


def level(chart: Chart, n: float, value: float, label: str) -> None:
    """Draw a horizontal line from 0 to n + 1 (what the thesis states, mostly)."""
    chart.line([0.0, n + 1.0], [value, value], label)


def numbers(values: Sequence[float]) -> list[float]:
    """Return 1, 2, 3... as many as there are values."""
    return [float(k + 1) for k in range(len(values))]
