"""A script of timed pokes: the TOML file, checked as a whole, and its run, which has no clock of its own."""

from __future__ import annotations

import itertools
import json
import operator
import random
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field

from bus.config import ConfigError, Section, parse, read_toml
from services.cli.errors import CliError
from services.cli.variables import checked_message

Seconds = float | tuple[float, float]
"""A time in s, or the range that it is drawn from in every round."""

_CONDITION = re.compile(r"\s*(?P<key>[^\s.]+)\.(?P<field>[\w.]+)\s*(?P<sign>==|!=|<=|>=|<|>)\s*(?P<value>.+?)\s*")
_NAME = re.compile(r"\$(\w+)")
_SIGNS = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_GIVEN = {"round": 1, "count": 1, "id": "script-1"}
"""Names that every poke can use: round and number of the poke from 1, and a string unlike any before."""
_MOST_COMBINATIONS = 256


class Draw(Section):
    """A name whose value is drawn anew in every round: between low and high, or one of the choices."""

    low: float | None = None
    high: float | None = None
    choices: list[Any] = []
    decimals: int | None = Field(None, ge=0)

    def extremes(self) -> list[Any]:
        """Return the values between which, or of which, it draws."""
        return self.choices or [self.low, self.high]

    def value(self, chance: random.Random) -> Any:
        """Return a value."""
        if self.choices:
            return chance.choice(self.choices)
        drawn = chance.uniform(self.low or 0.0, self.high or 0.0)
        return drawn if self.decimals is None else round(drawn, self.decimals)


class PokeEntry(Section):
    """One `[[poke]]`: sent at a time of the round, when its conditions hold, one or several times."""

    at_s: Seconds = 0.0
    key: str
    fields: dict[str, Any] = {}
    when: list[str] = []
    within_s: float | None = Field(None, gt=0)
    times: int = Field(1, ge=1, le=100_000)
    every_s: Seconds = 1.0


class ScriptSection(Section):
    """The table `[script]`."""

    title: str = ""
    seed: int | None = None
    rounds: int = Field(1, ge=0)
    delay_s: Seconds = 0.0
    between_s: Seconds = 0.0
    start_when: list[str] = []
    pause_unless: list[str] = []


class _File(Section):
    script: ScriptSection = ScriptSection()
    draw: dict[str, Draw] = {}
    poke: list[PokeEntry] = Field(min_length=1)


@dataclass(frozen=True)
class Condition:
    """A field of a variable compared with a constant; false as long as nothing was heard."""

    key: str
    field: str
    sign: str
    value: Any

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Whether it holds for the newest message of each key."""
        found: Any = values.get(self.key)
        for part in self.field.split("."):
            found = found.get(part) if isinstance(found, dict) else None
        if found is None and self.value is not None:
            return self.sign == "!=" and self.key in values
        try:
            return bool(_SIGNS[self.sign](found, self.value))
        except TypeError:
            return False


@dataclass(frozen=True)
class Script:
    """A file that was checked: every poke fits its message, whatever is drawn; every condition names a field."""

    path: Path
    settings: ScriptSection
    draws: dict[str, Draw]
    pokes: list[PokeEntry]
    start_when: list[Condition]
    pause_unless: list[Condition]
    when: list[list[Condition]]

    @property
    def watched(self) -> set[str]:
        """The keys that conditions look at."""
        return {c.key for c in itertools.chain(self.start_when, self.pause_unless, *self.when)}


def read_script(path: Path, *, force: bool = False) -> Script:
    """Return a script; raise ConfigError that names file, entry and field. `force`: it may write services' keys."""
    file = parse(_File, read_toml(path), path)
    for name, draw in file.draw.items():
        if name in _GIVEN:
            raise ConfigError(f"{path}: draw.{name}: this name is given: {', '.join(_GIVEN)}")
        if not draw.choices and (draw.low is None or draw.high is None or draw.low > draw.high):
            raise ConfigError(f"{path}: draw.{name}: needs choices, or low and high with low <= high")
    for number, entry in enumerate(file.poke):
        _check_poke(entry, file.draw, f"{path}: poke.{number}", force)
    for name, seconds in _times(file):
        low, high = seconds if isinstance(seconds, tuple) else (seconds, seconds)
        if not 0 <= low <= high:
            raise ConfigError(f"{path}: {name}: a time in s from 0 up, or [low, high]")
    if file.script.rounds == 0 and not any(_least(seconds) for name, seconds in _times(file) if "every" not in name):
        raise ConfigError(f"{path}: script.between_s: rounds without end need some time each")
    return Script(
        path,
        file.script,
        file.draw,
        file.poke,
        [_condition(c, f"{path}: script.start_when") for c in file.script.start_when],
        [_condition(c, f"{path}: script.pause_unless") for c in file.script.pause_unless],
        [[_condition(c, f"{path}: poke.{n}.when") for c in e.when] for n, e in enumerate(file.poke)],
    )


def _least(seconds: Seconds) -> float:
    return seconds[0] if isinstance(seconds, tuple) else seconds


def _times(file: _File) -> Iterator[tuple[str, Seconds]]:
    yield "script.delay_s", file.script.delay_s
    yield "script.between_s", file.script.between_s
    for number, entry in enumerate(file.poke):
        yield f"poke.{number}.at_s", entry.at_s
        yield f"poke.{number}.every_s", entry.every_s


def _check_poke(entry: PokeEntry, draws: dict[str, Draw], where: str, force: bool) -> None:
    """Check a poke with the extremes of everything it draws."""
    used = sorted(set(_NAME.findall(json.dumps(entry.fields))))
    if unknown := [name for name in used if name not in draws and name not in _GIVEN]:
        raise ConfigError(f"{where}.fields: ${unknown[0]} is not drawn; there are {', '.join([*_GIVEN, *draws])}")
    own = [name for name in used if name in draws]
    for combination in itertools.islice(itertools.product(*(draws[n].extremes() for n in own)), _MOST_COMBINATIONS):
        fields = filled(entry.fields, _GIVEN | dict(zip(own, combination, strict=True)))
        try:
            checked_message(entry.key, fields, force=force)
        except CliError as error:
            raise ConfigError(f"{where}: {error}") from None


def filled(value: Any, names: Mapping[str, Any]) -> Any:
    """Return fields with every $name replaced: alone by the value itself, within a text by its text."""
    if isinstance(value, dict):
        return {key: filled(part, names) for key, part in value.items()}
    if isinstance(value, list):
        return [filled(part, names) for part in value]
    if not isinstance(value, str):
        return value
    whole = _NAME.fullmatch(value)
    return names[whole[1]] if whole else _NAME.sub(lambda found: str(names[found[1]]), value)


def _condition(text: str, where: str) -> Condition:
    from bus.topics import find

    found = _CONDITION.fullmatch(text)
    if found is None:
        raise ConfigError(f"{where}: {text!r}: write KEY.FIELD == VALUE (or !=, <, <=, >, >=)")
    topic = find(found["key"])
    if topic is None or "*" in found["key"]:
        raise ConfigError(f"{where}: {found['key']}: no such variable; `starboard topics` lists them")
    first = found["field"].split(".")[0]
    if first not in topic.message.model_fields:
        raise ConfigError(
            f"{where}: {found['key']} has no field {first}; it has {', '.join(topic.message.model_fields)}"
        )
    try:
        value = json.loads(found["value"])
    except ValueError:
        value = found["value"].strip("'\"")
    return Condition(found["key"], found["field"], found["sign"], value)


@dataclass(frozen=True)
class Poke:
    """One message to send: when, on the script's clock, and what."""

    at_s: float
    round: int
    key: str
    fields: dict[str, Any]


@dataclass
class _Due:
    at_s: float
    entry: int
    when: list[Condition] = field(default_factory=list)


class ScriptRun:
    """A script being run. Time passes by `advance`; while a condition is waited for, the script's clock stands."""

    def __init__(self, script: Script, seed: int | None = None, *, dry: bool = False) -> None:
        """`dry`: every condition counts as true."""
        self.script = script
        self.round = 0
        self.clock_s = 0.0
        self.paused = False
        self.failure = ""
        self.state = "waiting to start"
        seed = script.settings.seed if seed is None else seed
        self.seed = random.SystemRandom().randrange(2**32) if seed is None else seed
        self._chance = random.Random(self.seed)
        self._dry = dry
        self._names: dict[str, Any] = {}
        self._queue: list[_Due] = []
        self._count = 0
        self._waited_s = 0.0
        self._started = False

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""
        return self.state in ("done", "failed")

    @property
    def next_in_s(self) -> float:
        """Time to the next poke if nothing holds it up."""
        return max(self._queue[0].at_s - self.clock_s, 0.0) if self._queue else 0.0

    def advance(self, seconds: float, values: Mapping[str, Any]) -> list[Poke]:
        """Let time pass; return what is to be sent now, in order. `values`: newest message of each watched key."""
        if self.ended or self._held_up(values):
            return []
        if not self._started:
            self._started, seconds = True, 0.0
            self.clock_s = 0.0
            self._begin_round(self._time(self.script.settings.delay_s))
        self.state = "running"
        sent: list[Poke] = []
        while not self.ended:
            due = self._queue[0]
            if due.at_s > self.clock_s + seconds + 1e-9:
                self.clock_s += seconds
                break
            seconds = max(seconds - max(due.at_s - self.clock_s, 0.0), 0.0)
            self.clock_s = max(self.clock_s, due.at_s)
            if not self._dry and not all(c.holds(values) for c in due.when):
                self._wait(due, seconds)
                break
            self._waited_s = 0.0
            sent.append(self._poke(due))
            del self._queue[0]
            if not self._queue:
                self._end_round()
        return sent

    def _held_up(self, values: Mapping[str, Any]) -> bool:
        if self.paused or (not self._dry and not all(c.holds(values) for c in self.script.pause_unless)):
            self.state = "paused"
            return True
        return not (self._started or self._dry or all(c.holds(values) for c in self.script.start_when))

    def _wait(self, due: _Due, seconds: float) -> None:
        entry = self.script.pokes[due.entry]
        self.state = "waiting"
        self._waited_s += seconds
        if entry.within_s is not None and self._waited_s > entry.within_s:
            self.state = "failed"
            self.failure = (
                f"poke.{due.entry} ({entry.key}): {' and '.join(entry.when)}: not within {entry.within_s:g} s"
            )

    def _begin_round(self, delay_s: float) -> None:
        self.round += 1
        begin_s = self.clock_s + delay_s
        self._names = {name: draw.value(self._chance) for name, draw in self.script.draws.items()}
        self._queue = []
        for number, entry in enumerate(self.script.pokes):
            at_s = begin_s + self._time(entry.at_s)
            for _ in range(entry.times):
                self._queue.append(_Due(at_s, number, self.script.when[number]))
                at_s += self._time(entry.every_s)
        self._queue.sort(key=lambda due: due.at_s)

    def _end_round(self) -> None:
        rounds = self.script.settings.rounds
        if (rounds and self.round >= rounds) or (self._dry and not rounds):
            self.state = "done"
        else:
            self._begin_round(self._time(self.script.settings.between_s))

    def _poke(self, due: _Due) -> Poke:
        entry = self.script.pokes[due.entry]
        self._count += 1
        names = self._names | {"round": self.round, "count": self._count, "id": f"script-{self.seed}-{self._count}"}
        return Poke(round(self.clock_s, 6), self.round, entry.key, filled(entry.fields, names))

    def _time(self, seconds: Seconds) -> float:
        return self._chance.uniform(*seconds) if isinstance(seconds, tuple) else seconds
