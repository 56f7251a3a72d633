"""Small plots as SVG: lines, points and areas over axes with numbers and units. No dependency, sharp at any size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from textwrap import wrap

from services.cli.errors import CliError

COLOURS = ("#1f6fb2", "#c4471f", "#2d8a4e", "#7a4fa3", "#8a6d1f")
_WIDTH, _HEIGHT = 460, 360
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 16, 34, 48
_TICKS = 6
_LETTER, _LINE = 7, 17
"""Width of a letter (on the safe side) and height of a line of the caption, px."""

Series = Sequence[float]


@dataclass
class Chart:
    """One pair of axes; labels carry their units. Draw with `line`, `points` and `area`."""

    title: str
    x_label: str
    y_label: str
    _layers: list[tuple[str, list[float], list[float], str]] = field(default_factory=list)

    def line(self, x: Series, y: Series, label: str = "") -> None:
        """Draw a line through points."""
        self._layers.append(("line", list(x), list(y), label))

    def points(self, x: Series, y: Series, label: str = "") -> None:
        """Draw single measurements."""
        self._layers.append(("points", list(x), list(y), label))

    def area(self, corners: Sequence[tuple[float, float]], label: str = "") -> None:
        """Fill a polygon."""
        self._layers.append(("area", [x for x, _ in corners], [y for _, y in corners], label))

    def svg(self, left: float = 0.0) -> str:
        """Return the chart as an SVG group, moved to the right by `left` px."""
        x_ticks = _ticks([x for _, xs, _, _ in self._layers for x in xs])
        y_ticks = _ticks([y for _, _, ys, _ in self._layers for y in ys])
        right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

        def place_x(x: float) -> float:
            return round(_LEFT + (x - x_ticks[0]) / (x_ticks[-1] - x_ticks[0]) * (right - _LEFT), 2)

        def place_y(y: float) -> float:
            return round(bottom - (y - y_ticks[0]) / (y_ticks[-1] - y_ticks[0]) * (bottom - _TOP), 2)

        parts = [f'<g transform="translate({left:g} 0)">']
        parts.append(_text(_WIDTH / 2, 20, self.title, "middle", bold=True))
        for x in x_ticks:
            at = place_x(x)
            parts.append(f'<path d="M{at} {_TOP}V{bottom}" stroke="{_grid(x)}"/>')
            parts.append(_text(at, bottom + 16, f"{x:g}", "middle"))
        for y in y_ticks:
            at = place_y(y)
            parts.append(f'<path d="M{_LEFT} {at}H{right}" stroke="{_grid(y)}"/>')
            parts.append(_text(_LEFT - 6, at + 4, f"{y:g}", "end"))
        parts.append(_text((_LEFT + right) / 2, _HEIGHT - 10, self.x_label, "middle"))
        middle = (_TOP + bottom) / 2
        parts.append(f'<g transform="rotate(-90 14 {middle})">{_text(14, middle, self.y_label, "middle")}</g>')
        legend: list[str] = []
        for number, (kind, xs, ys, label) in enumerate(self._layers):
            colour = COLOURS[number % len(COLOURS)]
            pairs = [(place_x(x), place_y(y)) for x, y in zip(xs, ys, strict=True)]
            parts.append(_shape(kind, pairs, colour))
            if label:
                at = _TOP + 16 + 16 * number
                around = f'width="{24 + _LETTER * len(label)}" height="16" fill="white" fill-opacity="0.75"'
                legend.append(f'<rect x="{_LEFT + 4}" y="{at - 12}" {around}/>')
                legend.append(f'<rect x="{_LEFT + 8}" y="{at - 9}" width="10" height="10" fill="{colour}"/>')
                legend.append(_text(_LEFT + 24, at, label, "start"))
        return "\n".join([*parts, *legend, "</g>"])


def write(path: Path, charts: Sequence[Chart], caption: str = "") -> None:
    """Write charts side by side over a caption; raise CliError when the file is no .svg or cannot be written."""
    if path.suffix != ".svg":
        raise CliError(f"{path}: plots are written as SVG; give a name ending in .svg")
    width = _WIDTH * len(charts)
    lines = wrap(caption, width // _LETTER)
    height = _HEIGHT + _LINE * len(lines)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="12">\n<rect width="100%" height="100%" fill="white"/>'
    )
    body = [chart.svg(_WIDTH * number) for number, chart in enumerate(charts)]
    body += [_text(12, _HEIGHT + 6 + _LINE * number, line, "start") for number, line in enumerate(lines)]
    try:
        path.write_text("\n".join([head, *body, "</svg>\n"]), encoding="utf-8")
    except OSError as error:
        raise CliError(f"{path}: cannot be written: {error.strerror}") from None


def _shape(kind: str, pairs: Sequence[tuple[float, float]], colour: str) -> str:
    if kind == "points":
        return "".join(f'<circle cx="{x}" cy="{y}" r="3" fill="{colour}"/>' for x, y in pairs)
    path = "M" + "L".join(f"{x} {y}" for x, y in pairs)
    if kind == "area":
        return f'<path d="{path}Z" fill="{colour}" fill-opacity="0.25" stroke="{colour}"/>'
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>'


def _text(x: float, y: float, text: str, anchor: str, *, bold: bool = False) -> str:
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}"{weight}>{escape(text)}</text>'


def _grid(value: float) -> str:
    return "#888" if value == 0.0 else "#ddd"


def _ticks(values: Sequence[float]) -> list[float]:
    """Return round numbers that enclose the values, 1, 2 or 5 times a power of ten apart."""
    finite = [v for v in values if math.isfinite(v)] or [0.0]
    low, high = min(finite), max(finite)
    span = (high - low) or abs(high) or 1.0
    rough = span / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough)
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [round(k * step, 12) for k in range(first, max(last, first + 1) + 1)]
