"""What `starboard watch` shows: the variables heard, as rows, as one message with its history, as lines of text."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Any, NamedTuple

from bus.clock import NS
from bus.messages import Message
from bus.units import unit_of
from services.cli.variables import readable

if TYPE_CHECKING:
    from rich.table import Table

    from bus.service import RawSample

HISTORY = 200
RATE_WINDOW = 40
SORTS = ("key", "age", "rate", "source")
_HEADER = frozenset(Message.model_fields)


class Moment(NamedTuple):
    """One message of the history."""

    payload: bytes
    received_ns: int


class Row(NamedTuple):
    """One field of one variable; what belongs to the whole variable stands in its first row."""

    key: str
    field: str
    value: str
    unit: str
    source: str = ""
    age: str = ""
    rate: str = ""
    first: bool = False


@dataclass
class Variable:
    """What was heard of one key."""

    key: str
    history: deque[Moment] = field(default_factory=lambda: deque(maxlen=HISTORY))
    rate_hz: float = 0.0
    """As the hub says, until enough was heard to work it out."""
    heard: int = 0

    def add(self, payload: bytes, received_ns: int) -> None:
        """Take in one message."""
        self.history.append(Moment(payload, received_ns))
        self.heard += 1
        recent = list(self.history)[-min(RATE_WINDOW, self.heard) :]
        if len(recent) > 2 and recent[-1].received_ns > recent[0].received_ns:
            self.rate_hz = (len(recent) - 1) * NS / (recent[-1].received_ns - recent[0].received_ns)

    @property
    def values(self) -> dict[str, Any]:
        """The fields of the newest message."""
        return fields_of(self.history[-1].payload)

    def age_s(self, now_ns: int) -> float:
        """Return the time since the newest message came."""
        return (now_ns - self.history[-1].received_ns) / NS

    def live_rate_hz(self, now_ns: int) -> float:
        """Return the rate, lower once the next message is overdue."""
        age_s = self.age_s(now_ns)
        return 1.0 / age_s if age_s * self.rate_hz > 3.0 else self.rate_hz


class Board:
    """All variables heard, and how the user wants to see them."""

    def __init__(self, scope: str = "") -> None:
        self.variables: dict[str, Variable] = {}
        self.scope = scope
        self.filter = ""
        self.typing = False
        self.sort = SORTS[0]
        self.frozen_ns = 0
        self.chosen = ""
        self.ended = False
        self._waiting: deque[RawSample] = deque(maxlen=5000)

    def take(self, samples: Iterable[RawSample]) -> None:
        """Take in what was heard; while frozen it is kept back, and shown afterwards."""
        self._waiting.extend(samples)
        if self.frozen_ns:
            return
        while self._waiting:
            sample = self._waiting.popleft()
            self.variables.setdefault(sample.key, Variable(sample.key)).add(sample.payload, sample.received_ns)

    def know(self, key: str, payload: bytes, received_ns: int, rate_hz: float) -> None:
        """Take in a last value that the hub kept."""
        if key not in self.variables:
            variable = self.variables[key] = Variable(key, rate_hz=rate_hz)
            variable.history.append(Moment(payload, received_ns))

    def shown(self, now_ns: int) -> list[Variable]:
        """Return the variables that pass the filter, sorted."""
        wanted = self.filter.lower()
        found = [v for v in self.variables.values() if v.history and (wanted in v.key or self._fits(v, wanted))]
        order = {
            "key": lambda v: v.key,
            "age": lambda v: v.age_s(now_ns),
            "rate": lambda v: -v.live_rate_hz(now_ns),
            "source": lambda v: (str(v.values.get("source", "")), v.key),
        }
        return sorted(found, key=order[self.sort])

    def _fits(self, variable: Variable, wanted: str) -> bool:
        values = variable.values
        return any(wanted in name for name in values) or wanted in str(values.get("source", "")).lower()

    def rows(self, now_ns: int) -> list[Row]:
        """Return one row a field. A field filter shows only the fields it fits, unless the key fits."""
        now_ns = self.frozen_ns or now_ns
        rows: list[Row] = []
        for variable in self.shown(now_ns):
            values = variable.values
            content = list(_flat(values))
            if self.filter.lower() not in variable.key:
                content = [(n, v) for n, v in content if self.filter.lower() in n] or content
            head = (
                str(values.get("source", "")),
                f"{variable.age_s(now_ns):.2f}",
                f"{variable.live_rate_hz(now_ns):.1f}",
            )
            for at, (name, value) in enumerate(content or [("", "")]):
                row = Row(variable.key, name, shown_value(value), unit_of(name))
                rows.append(row._replace(source=head[0], age=head[1], rate=head[2], first=True) if at == 0 else row)
        return rows

    def press(self, key: str, now_ns: int) -> None:
        """Do what a key asks for."""
        if self.typing:
            self._type(key)
        elif key == "q":
            self.ended = True
        elif key in ("f", " "):
            self.frozen_ns = 0 if self.frozen_ns else now_ns
        elif key in ("esc", "backspace"):
            self.scope, self.filter = "", self.filter if self.scope else ""
        elif self.scope:
            return
        elif key == "/":
            self.typing = True
        elif key == "s":
            self.sort = SORTS[(SORTS.index(self.sort) + 1) % len(SORTS)]
        elif key == "enter":
            self.scope = self.chosen
        elif key in _MOVES:
            self._move(_MOVES[key], now_ns)

    def _type(self, key: str) -> None:
        if key in ("enter", "esc"):
            self.typing = False
            self.filter = "" if key == "esc" else self.filter
        elif key == "backspace":
            self.filter = self.filter[:-1]
        elif len(key) == 1:
            self.filter += key

    def _move(self, by: int, now_ns: int) -> None:
        keys = [v.key for v in self.shown(self.frozen_ns or now_ns)]
        if keys:
            at = keys.index(self.chosen) + by if self.chosen in keys else 0
            self.chosen = keys[max(0, min(at, len(keys) - 1))]


_MOVES = {"up": -1, "k": -1, "down": 1, "j": 1, "pgup": -10, "pgdn": 10}


def _flat(values: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the fields besides the header; of a table of plain values each entry as a field: commands.front_port."""
    for name, value in values.items():
        if isinstance(value, dict) and not any(isinstance(part, dict | list) for part in value.values()):
            yield from ((f"{name}.{part}", content) for part, content in value.items())
        elif name not in _HEADER:
            yield name, value


def fields_of(payload: bytes) -> dict[str, Any]:
    """Return the fields of a message; anything else as one field `value`."""
    values = readable(payload)
    return values if isinstance(values, dict) else {"value": values}


def shown_value(value: Any) -> str:
    """Return a value as short as can be read: numbers with five digits."""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, dict):
        return " ".join(f"{name}={shown_value(part)}" for name, part in value.items())
    return value if isinstance(value, str) and value.isprintable() else json.dumps(value)


def clock_time(ns: int) -> str:
    """Return the local time of day to the millisecond."""
    return f"{datetime.fromtimestamp(ns / NS):%H:%M:%S.%f}"[:-3]


def text_line(sample: RawSample) -> str:
    """Return a message as one line of text: time, key, source, fields that are not null, with units."""
    values = fields_of(sample.payload)
    parts = [
        f"{name}={shown_value(value)}{' ' if unit_of(name) else ''}{unit_of(name)}"
        for name, value in values.items()
        if name not in _HEADER and value is not None
    ]
    return f"{clock_time(sample.received_ns)} {sample.key} [{values.get('source', '')}] {', '.join(parts)}"


def board_table(board: Board, now_ns: int, height: int) -> Table:
    """Return the table of all variables, as many rows as fit, the chosen one among them."""
    from rich.table import Table
    from rich.text import Text

    rows = board.rows(now_ns)
    chosen = next((i for i, row in enumerate(rows) if row.key == board.chosen), 0)
    begin = max(0, min(chosen - height // 3, len(rows) - height))
    state = "  FROZEN" if board.frozen_ns else ""
    filtered = f"  filter: {board.filter}{'_' if board.typing else ''}" if board.filter or board.typing else ""
    table = Table(
        title=f"{len(board.variables)} variables, by {board.sort}{filtered}{state}",
        caption="/ filter  s sort  f freeze  arrows Enter: one message  Esc back  q quit",
        expand=True,
        box=None,
        header_style="bold",
    )
    for name, right in (
        ("key", 0),
        ("field", 0),
        ("value", 1),
        ("unit", 0),
        ("source", 0),
        ("age s", 1),
        ("rate Hz", 1),
    ):
        table.add_column(name, justify="right" if right else "left", no_wrap=True, ratio=2 if name == "value" else None)
    for at, row in enumerate(rows[begin : begin + height]):
        key = row.key if row.first or at == 0 else ""
        style = "reverse" if row.key == board.chosen and row.first else ""
        cells = (key, row.field, row.value, row.unit, row.source, row.age, row.rate)
        table.add_row(*map(Text, cells), style=style)  # Text: a value with brackets is no markup
    return table


def scope_table(board: Board, width: int) -> Table:
    """Return one variable with its history: a column a message, the newest first, changes in bold."""
    from rich.table import Table
    from rich.text import Text

    variable = board.variables.get(board.scope)
    state = "  FROZEN" if board.frozen_ns else ""
    table = Table(title=f"{board.scope}{state}", caption="f freeze  Esc back  q quit", box=None, header_style="bold")
    if variable is None or not variable.history:
        table.add_column("nothing heard yet", no_wrap=True)
        return table
    moments = list(variable.history)[::-1][: max(1, (width - _SCOPE_NAMES) // _SCOPE_COLUMN)]
    messages = [fields_of(m.payload) for m in moments]
    table.add_column("field", no_wrap=True, width=22)
    table.add_column("unit", no_wrap=True, width=4)
    for moment in moments:
        name = clock_time(moment.received_ns)
        table.add_column(name, justify="right", no_wrap=True, width=_SCOPE_COLUMN - 2)
    for name in messages[0]:
        cells = [_scope_cell(name, m[name]) if name in m else "" for m in messages]
        marked = [
            Text(cell, style="bold" if at + 1 < len(cells) and cell != cells[at + 1] else "")
            for at, cell in enumerate(cells)
        ]
        table.add_row(Text(name), "" if name.endswith("_ns") else unit_of(name), *marked)
    return table


_SCOPE_NAMES, _SCOPE_COLUMN = 30, 16


def _scope_cell(name: str, value: Any) -> str:
    """Return a value; a stamp as the time of day."""
    return clock_time(value) if name.endswith("_ns") and isinstance(value, int) and value else shown_value(value)
