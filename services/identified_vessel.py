"""A vessel file with the identified numbers of one axis in place of those before, all else and every comment kept."""

from __future__ import annotations

import re
from pathlib import Path

from bus.config import ConfigError
from marine.identification.result import Identified
from services.vessels import load_vessel


class IdentifiedVesselError(ValueError):
    """The vessel file cannot take this model; the message says why."""


def write_vessel(source: Path, target: Path, axis: str, found: Identified, origin: str) -> None:
    """Write the vessel file `source` with a new model of one axis (surge, sway, heave, yaw) to `target`.

    origin: where the numbers come from, for the comments. Raises IdentifiedVesselError for a model that is not
    uncoupled and for parameters that no vessel has, OSError when the file cannot be written.
    """
    text = source.read_text(encoding="utf-8")
    vessel = load_vessel(str(source))
    values = {p.name: p for p in found.parameters}
    if values["alpha"].value <= 0.0 or any(values[n].value < 0.0 for n in values if n.startswith("beta")):
        raise IdentifiedVesselError("inertia must be positive and drag not negative")
    table = re.search(rf"(?ms)^\[model\.{axis}\][^\n]*\n.*?(?=^\s*\[|\Z)", text)
    if table is None:
        raise IdentifiedVesselError(f"{source.name} has no table [model.{axis}]: only uncoupled models can be replaced")
    units = vessel.units
    length, force = (units.angle_rad, units.moment_nm) if axis == "yaw" else (units.length_m, units.force_n)
    scales = {"alpha": length / force, "beta": length / force, "beta_quadratic": length**2 / force}
    lines = [f"[model.{axis}]  # {origin}: {found.method}"]
    for name, scale in scales.items():
        value = values[name].value * scale if name in values else 0.0
        std = f"+- {values[name].std * scale:.2g}" if name in values and values[name].std > 0.0 else ""
        lines.append(f"{name} = {value:.8g}  # identified {std}".rstrip())
    replaced = text[: table.start()] + "\n".join(lines) + "\n\n" + text[table.end() :]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(replaced, encoding="utf-8")
    try:
        load_vessel(str(target))
    except ConfigError as error:
        target.unlink()
        raise IdentifiedVesselError(str(error)) from None
