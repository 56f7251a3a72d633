"""The predicted steps of `starboard tune` as SVG, alone or in an HTML page."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import TYPE_CHECKING

from services.cli.errors import CliError

if TYPE_CHECKING:
    from services.cli.tune import Candidate

WIDTH, PANEL, LEFT, TOP, GAP = 760, 220, 70, 40, 50
COLOURS = ("#0b6bcb", "#c2410c")
POINTS = 400


def write_plot(  # noqa: PLR0917
    path: Path, title: str, candidates: list[Candidate], eta_unit: str, tau_unit: str, step: float
) -> None:
    """Write eta and tau over time of every design that is allowed; raise CliError for another kind of file."""
    if path.suffix not in (".svg", ".html"):
        raise CliError(f"{path}: --plot writes FILE.svg or FILE.html")
    scale = 180.0 / math.pi if eta_unit == "deg" else 1.0
    shown = [(c.name, c.response) for c in candidates if c.response]
    end_s = max((r.t_s[-1] for _, r in shown), default=1.0)
    eta = [(name, r.t_s, [scale * e for e in r.eta]) for name, r in shown]
    tau = [(name, r.t_s, r.tau) for name, r in shown]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{TOP + 2 * (PANEL + GAP)}" '
        'font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{LEFT}" y="20" font-size="15">{html.escape(title)}</text>',
        *_panel(TOP, f"eta [{eta_unit}]", eta, end_s, (step,)),
        *_panel(TOP + PANEL + GAP, f"tau [{tau_unit}]", tau, end_s, ()),
        "</svg>",
    ]
    svg = "\n".join(parts)
    if path.suffix == ".html":
        svg = f"<!doctype html><meta charset='utf-8'><title>{html.escape(title)}</title>\n{svg}"
    try:
        path.write_text(svg + "\n", encoding="utf-8")
    except OSError as error:
        raise CliError(f"{path}: cannot be written: {error.strerror}") from None


def _panel(
    top: float, label: str, curves: list[tuple[str, list[float], list[float]]], end_s: float, lines: tuple[float, ...]
) -> list[str]:
    values = [v for _, _, ys in curves for v in ys] + [0.0, *lines]
    low, high = min(values), max(values)
    high += 1e-9 if high == low else 0.05 * (high - low)
    right = WIDTH - 20

    def x(t: float) -> float:
        return LEFT + (right - LEFT) * t / end_s

    def y(value: float) -> float:
        return top + PANEL * (high - value) / (high - low)

    out = [f'<rect x="{LEFT}" y="{top}" width="{right - LEFT}" height="{PANEL}" fill="none" stroke="#888"/>']
    out.append(f'<text x="{LEFT}" y="{top - 6}">{html.escape(label)}</text>')
    for i in range(6):
        t, value = end_s * i / 5.0, low + (high - low) * i / 5.0
        out.append(f'<text x="{x(t):.1f}" y="{top + PANEL + 16}" text-anchor="middle">{t:.3g} s</text>')
        out.append(f'<text x="{LEFT - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.3g}</text>')
    for value in lines:
        out.append(f'<path d="M{LEFT} {y(value):.1f}H{right}" stroke="#888" stroke-dasharray="4 4"/>')
    for index, (name, ts, ys) in enumerate(curves):
        every = max(1, len(ts) // POINTS)
        points = " ".join(f"{x(t):.1f},{y(v):.1f}" for t, v in zip(ts[::every], ys[::every], strict=True))
        colour = COLOURS[index % len(COLOURS)]
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        out.append(f'<text x="{right - 90}" y="{top + 18 + 16 * index}" fill="{colour}">{html.escape(name)}</text>')
    return out
