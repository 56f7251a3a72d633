"""The star as nodes around the hub: from what services declare, or from what is connected; as Mermaid and as SVG."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from html import escape
from typing import Literal

from bus import topics
from bus.service import Input, Output
from bus.topics import OPERATOR
from services.catalog import PROCESSES, Process

HUBS = ("hub", "hub_standby")

State = Literal["declared", "running", "missing", "foreign"]


@dataclass(frozen=True)
class Node:
    """One client of the hub. `reads` is None for one that reads everything."""

    name: str
    publishes: tuple[str, ...] = ()
    reads: tuple[str, ...] | None = ()
    state: State = "declared"
    """declared: not looked at; running; missing: declared but not connected; foreign: publishes but is not ours."""


def declared_star(processes: Iterable[Process] = PROCESSES) -> list[Node]:
    """Return the operator and every process with its declared ports, hubs apart."""
    everyone = tuple(t.key for t in topics.all_topics() if t.publisher == OPERATOR)
    return [Node(OPERATOR, everyone), *(_declared(p) for p in processes if p.name not in HUBS)]


def _declared(process: Process) -> Node:
    ports = process.service.ports.values()
    sent = (p.topic for p in ports if isinstance(p, Output) and p.topic.publisher != OPERATOR)
    got = (p.topic.key for p in ports if isinstance(p, Input))
    everything = any(not isinstance(p, Input | Output) for p in ports)
    return Node(process.name, _once(t.key for t in sent), None if everything else _once(got))


def _once(keys: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(keys))


def live_star(declared: list[Node], alive: set[str], sources: Mapping[str, set[str]]) -> list[Node]:
    """Return what is connected. `alive`: services whose token stands; `sources`: key -> who published on it.

    What a client publishes is what was seen of it. Zenoh does not tell who reads what: that stays as declared, and
    of a client that is none of our services unknown.
    """
    known = {node.name for node in declared}
    nodes = []
    for node in declared:
        if node.name == OPERATOR:
            continue
        if node.name in alive:
            nodes.append(replace(node, publishes=_published_by(node.name, sources), state="running"))
        else:
            nodes.append(replace(node, state="missing"))
    strangers = {name for names in sources.values() for name in names} | alive
    for name in sorted(strangers - known - set(HUBS) - {""}):
        nodes.append(Node(name, _published_by(name, sources), (), "foreign"))
    return nodes


def _published_by(name: str, sources: Mapping[str, set[str]]) -> tuple[str, ...]:
    return tuple(key for key in sorted(sources) if name in sources[key] and key != f"service/{name}/heartbeat")


def mermaid(nodes: list[Node], *, standby: bool = True) -> str:
    """Return the star as a Mermaid flowchart."""
    lines = ["flowchart LR"]
    lines.append("    hub((hub)) -. everything .- hub_standby((hub_standby))" if standby else "    hub((hub))")
    for node in nodes:
        number = node.name if node.name.isidentifier() else f"client{nodes.index(node)}"
        if node.name == OPERATOR:
            lines.append(f"    {number}([operator: page, command line])")
        elif node.state in ("missing", "foreign") or number != node.name:
            lines.append(f'    {number}["{escape(node.name)}{" (not connected)" if node.state == "missing" else ""}"]')
        dotted = node.state == "missing"
        begin, end = ("-.", ".->") if dotted else ("--", "-->")
        if node.publishes:
            lines.append(f'    {number} {begin} "{"<br>".join(node.publishes)}" {end} hub')
        if node.reads is None or node.reads:
            got = "everything" if node.reads is None else "<br>".join(node.reads)
            lines.append(f'    hub {begin} "{got}" {end} {number}')
    return "\n".join(lines)


# --- SVG ----------------------------------------------------------------------------------------------------------

_WIDTH, _LINE, _HEAD, _PAD, _GAP = 230.0, 17.0, 30.0, 10.0, 34.0
_HUB_RADIUS = 64.0
_MARGIN, _TITLE = 24.0, 44.0
_COLOURS: dict[State, tuple[str, str]] = {
    "declared": ("#f4f8fb", "#3b6ea5"),
    "running": ("#eef8f0", "#2e7d4f"),
    "missing": ("#f6f6f6", "#9a9a9a"),
    "foreign": ("#fff6e8", "#c77700"),
}
_STYLE = """
text { font: 13px system-ui, 'DejaVu Sans', sans-serif; fill: #1c2733; }
.name { font-weight: 600; font-size: 14px; } .title { font-size: 18px; font-weight: 600; }
.sent { fill: #b3421d; } .got { fill: #1d5fb3; } .faint, .faint text { fill: #8a8a8a; } .legend { font-size: 12px; }
.sends { stroke: #b3421d; } .gets { stroke: #1d5fb3; } path { fill: none; stroke-width: 1.6; }
"""


@dataclass(frozen=True)
class Card:
    """Where a node's card stands in the picture, in px from the top left."""

    node: Node
    x: float
    y: float
    height: float

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle."""
        return self.x + _WIDTH / 2, self.y + self.height / 2


def _height(node: Node) -> float:
    lines = len(node.publishes) + (1 if node.reads is None else len(node.reads))
    return _HEAD + max(lines, 1) * _LINE + _PAD


def layout(nodes: list[Node]) -> tuple[list[Card], tuple[float, float], tuple[float, float]]:
    """Return cards clockwise around the hub from the top left, the hub's middle, and the picture's size."""
    top_n = math.ceil(len(nodes) / 4)
    right_n = math.ceil((len(nodes) - 2 * top_n) / 2) if len(nodes) > 2 * top_n else 0
    top, right = nodes[:top_n], nodes[top_n : top_n + right_n]
    bottom = nodes[top_n + right_n : 2 * top_n + right_n][::-1]
    left = nodes[2 * top_n + right_n :][::-1]
    row_width = max(top_n, 2) * (_WIDTH + _GAP) + _GAP
    top_height = max(map(_height, top), default=0.0)
    bottom_height = max(map(_height, bottom), default=0.0)
    side_height = max(_stacked(left), _stacked(right), 4 * _HUB_RADIUS)
    width = 2 * _MARGIN + 2 * _WIDTH + row_width
    upper = _TITLE + _MARGIN + top_height + _GAP
    height = upper + side_height + _GAP + bottom_height + _MARGIN + _TITLE
    cards = [
        Card(n, x, upper - _GAP - _height(n), _height(n)) for n, x in zip(top, _across(len(top), width), strict=True)
    ]
    cards += _column(right, width - _MARGIN - _WIDTH, upper, side_height)
    lower = upper + side_height + _GAP
    cards += [Card(n, x, lower, _height(n)) for n, x in zip(bottom, _across(len(bottom), width), strict=True)]
    cards += _column(left, _MARGIN, upper, side_height)
    return cards, (width / 2, upper + side_height / 2), (width, height)


def _stacked(nodes: list[Node]) -> float:
    return sum(map(_height, nodes)) + _GAP * (len(nodes) + 1)


def _across(count: int, width: float) -> list[float]:
    used = count * _WIDTH + (count - 1) * _GAP
    return [(width - used) / 2 + i * (_WIDTH + _GAP) for i in range(count)]


def _column(nodes: list[Node], x: float, top: float, height: float) -> list[Card]:
    gap = (height - sum(map(_height, nodes))) / (len(nodes) + 1)
    cards, y = [], top
    for node in nodes:
        y += gap
        cards.append(Card(node, x, y, _height(node)))
        y += _height(node)
    return cards


def svg(nodes: list[Node], title: str) -> str:
    """Return the star as a picture: the hub in the middle, a card for each client around it."""
    cards, (hub_x, hub_y), (width, height) = layout(nodes)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        _marker("sends", "#b3421d") + _marker("gets", "#1d5fb3"),
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff"/>',
        f'<text class="title" x="{_MARGIN}" y="{_TITLE - 12}">{escape(title)}</text>',
        *(_spokes(card, hub_x, hub_y) for card in cards),
        f'<circle cx="{hub_x:.0f}" cy="{hub_y:.0f}" r="{_HUB_RADIUS}" fill="#20364d"/>',
        f'<text x="{hub_x:.0f}" y="{hub_y + 5:.0f}" text-anchor="middle" style="fill:#fff;font-size:18px">hub</text>',
        *(_card(card) for card in cards),
        _legend(height, {n.state for n in nodes}),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _marker(name: str, colour: str) -> str:
    return (
        f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" orient="auto">'
        f'<path d="M0 0L10 5L0 10z" style="fill:{colour};stroke:none"/></marker>'
    )


def _spokes(card: Card, hub_x: float, hub_y: float) -> str:
    """Return the lines between a card and the hub: what it sends and, beside that, what it gets."""
    x, y = card.centre
    dx, dy = hub_x - x, hub_y - y
    distance = math.hypot(dx, dy)
    ux, uy = dx / distance, dy / distance
    both = bool(card.node.publishes) and card.node.reads != ()
    aside = 7.0 if both else 0.0
    dash = ' stroke-dasharray="5 5" opacity="0.5"' if card.node.state == "missing" else ""
    lines = []
    for name, wanted, side, towards_hub in (
        ("sends", bool(card.node.publishes), aside, True),
        ("gets", card.node.reads != (), -aside, False),
    ):
        if not wanted:
            continue
        ox, oy = -uy * side, ux * side
        edge = 2 + min(
            (_WIDTH / 2 - math.copysign(ox, ox * ux)) / abs(ux) if ux else math.inf,
            (card.height / 2 - math.copysign(oy, oy * uy)) / abs(uy) if uy else math.inf,
        )
        near = (x + ux * edge + ox, y + uy * edge + oy)
        far = (hub_x - ux * (_HUB_RADIUS + 3) + ox, hub_y - uy * (_HUB_RADIUS + 3) + oy)
        begin, end = (near, far) if towards_hub else (far, near)
        path = f"M{begin[0]:.1f} {begin[1]:.1f}L{end[0]:.1f} {end[1]:.1f}"
        lines.append(f'<path class="{name}" d="{path}" marker-end="url(#{name})"{dash}/>')
    return "".join(lines)


def _card(card: Card) -> str:
    node = card.node
    fill, edge = _COLOURS[node.state]
    dash = ' stroke-dasharray="5 4"' if node.state == "missing" else ""
    lines = [("sent", f"↑ {key}") for key in node.publishes]
    lines += [("got", "↓ everything")] if node.reads is None else [("got", f"↓ {key}") for key in node.reads]
    texts = [
        f'<text class="{kind}" x="{card.x + 12:.0f}" y="{card.y + _HEAD + 12 + i * _LINE:.0f}">{escape(text)}</text>'
        for i, (kind, text) in enumerate(lines)
    ]
    return (
        f"<g{' class=' + chr(34) + 'faint' + chr(34) if node.state == 'missing' else ''}>"
        f'<rect x="{card.x:.0f}" y="{card.y:.0f}" width="{_WIDTH:.0f}" height="{card.height:.0f}" rx="8" '
        f'fill="{fill}" stroke="{edge}" stroke-width="1.5"{dash}/>'
        f'<text class="name" x="{card.x + 12:.0f}" y="{card.y + 21:.0f}">{escape(node.name)}</text>{"".join(texts)}</g>'
    )


def _legend(height: float, states: set[State]) -> str:
    words = "↑ publishes · ↓ reads · every service also sends service/NAME/heartbeat"
    if "running" in states or "missing" in states:
        words += " · green: connected · dashed: not connected · orange: none of our services"
    return f'<text class="legend" x="{_MARGIN}" y="{height - 16:.0f}">{words}</text>'
