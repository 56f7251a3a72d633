"""Thruster mapping on the running system, thesis 4.1: the vessel pulls at a dynamometer, a person reads it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from bus.config import ConfigError
from marine.identification.result import IdentificationError, Identified
from marine.identification.thruster_map import ThrusterMap, dead_zone_of, fit_thruster
from marine.vessel import Vessel
from services.identified_vessel import IdentifiedVesselError
from services.vessels import load_vessel

COMPONENTS = {"surge": 0, "sway": 1, "heave": 2}
"""Axes along which a vessel can pull at a rope, and their rows of a wrench."""
_CHARACTERISTIC = ("kind", "k_t", "a", "b", "a_f", "b_f", "a_b", "b_b", "knee", "slope", "dead_zone")


@dataclass(frozen=True)
class Pull:
    """One reading: command and thrust (N) of one thruster of those that pull together."""

    command: float
    thrust_n: float


class Hands(Protocol):
    """What a pull test needs of the running system and of the person at the balance."""

    def push(self, share: float) -> Mapping[str, float]:
        """Push with a part (-1 to 1) of the largest force until it is steady; return the commands of the actuators."""

    def reading(self, share: float, commands: Mapping[str, float]) -> float | None:
        """Return the pull that the balance shows in N, never negative; None to leave this one out."""


def shares(levels: int) -> Iterator[float]:
    """Yield parts of the largest force, each ahead and astern, whose commands are evenly spaced."""
    for k in range(1, levels + 1):
        yield from ((k / levels) ** 2, -((k / levels) ** 2))


def pulling(vessel: Vessel, axis: str) -> dict[str, float]:
    """Return the thrusters that pull along an axis, and which part of its thrust each gives on it.

    Raises IdentificationError when none does, or when they are not alike: one balance cannot tell them apart.
    """
    parts = {a.name: float(a.column[COMPONENTS[axis]]) for a in vessel.thrusters}
    parts = {name: part for name, part in parts.items() if abs(part) > 1e-3}
    if not parts:
        raise IdentificationError(f"{vessel.name} has no thruster that pulls along {axis}")
    alike = {(a.characteristic, a.n_max) for a in vessel.thrusters if a.name in parts}
    if len({round(abs(part), 6) for part in parts.values()}) > 1 or len(alike) > 1:
        raise IdentificationError(f"the thrusters along {axis} are not alike: map each on a bench (identify thruster)")
    return parts


def drive(vessel: Vessel, axis: str, levels: int, hands: Hands) -> list[Pull]:
    """Push each level both ways and return the readings, per thruster: the balance shows the sum of all that pull."""
    parts = pulling(vessel, axis)
    whole = sum(abs(part) for part in parts.values())
    pulls = []
    for share in shares(levels):
        commands = hands.push(share)
        read_n = hands.reading(share, commands)
        if read_n is not None:
            command = sum(float(np.sign(part)) * commands[name] for name, part in parts.items()) / len(parts)
            pulls.append(Pull(command, float(np.copysign(read_n, share)) / whole))
    return pulls


def fitted(pulls: list[Pull], model: str | None = None) -> tuple[ThrusterMap, float]:
    """Return the thrust curve of the readings and its dead zone; raise IdentificationError with reason and remedy."""
    commands, thrusts_n = (np.array([getattr(p, name) for p in pulls]) for name in ("command", "thrust_n"))
    dead_zone = dead_zone_of(commands, thrusts_n)
    found = fit_thruster(commands, thrusts_n, model, dead_zone)
    return found, max(dead_zone, found.begins)


def write_thrusters(source: Path, target: Path, names: set[str], found: Identified, dead_zone: float) -> None:
    """Write the vessel file `source` with a new thrust curve of some thrusters to `target`, all else kept.

    Raises IdentifiedVesselError when the file cannot take it, OSError when it cannot be written.
    """
    unit_n = load_vessel(str(source)).units.force_n
    lines = [f'kind = "{found.model}"  # pull test, thesis 4.1']
    for p in found.parameters:
        scale = 1.0 if p.name == "knee" else 1.0 / unit_n
        lines.append(f"{p.name} = {p.value * scale:.8g}  # identified +- {p.std * scale:.2g}")
    if dead_zone:
        lines.append(f"dead_zone = {dead_zone:g}  # identified")
    keys = "|".join(_CHARACTERISTIC)
    head, *blocks = re.split(r"(?m)^(?=\[\[actuator\]\])", source.read_text(encoding="utf-8"))
    for k, block in enumerate(blocks):
        table, rest = (*re.split(r"(?m)^(?=\[(?!\[actuator))", block, maxsplit=1), "")[:2]
        name = re.search(r'(?m)^name\s*=\s*"([^"]*)"', table)
        if name is not None and name[1] in names:
            first, _, body = re.sub(rf"(?m)^({keys})\s*=.*\n", "", table).partition("\n")
            blocks[k] = "\n".join([first, *lines, body]) + rest
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(head + "".join(blocks), encoding="utf-8")
    try:
        load_vessel(str(target))
    except ConfigError as error:
        target.unlink()
        raise IdentifiedVesselError(str(error)) from None
