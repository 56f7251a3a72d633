"""A vessel file with identified numbers of some axes in place of those before, all else and every comment kept."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from bus.config import ConfigError
from marine.identification.result import Identified
from services.vessels import load_vessel


class IdentifiedVesselError(ValueError):
    """The vessel file cannot take this model; the message says why."""


Values = Mapping[str, tuple[float, float]]
"""alpha, beta, beta_quadratic that are known -> value in SI and its standard deviation, which may not be known."""


def write_vessel(source: Path, target: Path, axis: str, found: Identified, origin: str) -> None:
    """Write the vessel file `source` with a new model of one axis (surge, sway, heave, yaw); see `write_models`."""
    values = {p.name: (p.value, p.std) for p in found.parameters}
    write_models(source, target, {axis: values}, f"{origin}: {found.method}")


def write_models(source: Path, target: Path, models: Mapping[str, Values], origin: str) -> None:
    """Write the vessel file `source` with new models of some axes (surge, sway, heave, yaw) to `target`.

    origin: where the numbers come from, for the comments. Raises IdentifiedVesselError for a model that is not
    uncoupled and for parameters that no vessel has, OSError when the file cannot be written.
    """
    text, units = source.read_text(encoding="utf-8"), load_vessel(str(source)).units
    tables: dict[str, str] = {}
    for axis, values in models.items():
        if values["alpha"][0] <= 0.0 or any(value < 0.0 for name, (value, _) in values.items() if "beta" in name):
            raise IdentifiedVesselError("inertia must be positive and drag not negative")
        length, force = (units.angle_rad, units.moment_nm) if axis == "yaw" else (units.length_m, units.force_n)
        lines = [f"[model.{axis}]  # {origin}"]
        for name, power in (("alpha", 1), ("beta", 1), ("beta_quadratic", 2)):
            scale = length**power / force
            value, std = values.get(name, (0.0, 0.0))
            known = f"+- {std * scale:.2g}" if std > 0.0 else ""
            lines.append(f"{name} = {value * scale:.8g}  # identified {known}".rstrip())
        tables[axis] = "\n".join(lines) + "\n\n"
    _write(text, tables, source, target)


def merge_models(source: Path, parts: Sequence[Path], target: Path) -> dict[str, Path]:
    """Write the vessel file `source` with the axes that other vessel files have identified; the last of an axis counts.

    What a file has identified is its tables [model.AXIS] that differ from those of `source`. Returns which file each
    axis is from. Raises IdentifiedVesselError when there is nothing to take or units differ, ConfigError for what is
    no vessel file, OSError.
    """
    text, base = source.read_text(encoding="utf-8"), load_vessel(str(source))
    tables, origin = dict[str, str](), dict[str, Path]()
    for part in parts:
        other, vessel = part.read_text(encoding="utf-8"), load_vessel(str(part))
        if vessel.units != base.units:
            raise IdentifiedVesselError(f"{part.name} has other units than {source.name}")
        for axis in ("surge", "sway", "heave", "yaw"):
            if getattr(vessel.model, axis) != getattr(base.model, axis):
                tables[axis], origin[axis] = _table(other, axis, part).group(), part
    if not tables:
        raise IdentifiedVesselError(f"none of these files has another model of an axis than {source.name}")
    _write(text, tables, source, target)
    return origin


def _table(text: str, axis: str, path: Path) -> re.Match[str]:
    """Return where the table of an axis is."""
    if (found := re.search(rf"(?ms)^\[model\.{axis}\][^\n]*\n.*?(?=^\s*\[|\Z)", text)) is None:
        raise IdentifiedVesselError(f"{path.name} has no table [model.{axis}]: only uncoupled models can be replaced")
    return found


def _write(text: str, tables: Mapping[str, str], source: Path, target: Path) -> None:
    """Write a vessel file's text with other tables of some axes; nothing when that is no vessel file."""
    for axis, table in tables.items():
        place = _table(text, axis, source)
        text = text[: place.start()] + table + text[place.end() :]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")
    try:
        load_vessel(str(target))
    except ConfigError as error:
        target.unlink()
        raise IdentifiedVesselError(str(error)) from None
