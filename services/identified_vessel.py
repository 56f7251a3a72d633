"""A vessel file with identified numbers of some axes in place of those before, all else and every comment kept."""

from __future__ import annotations

import re
from collections.abc import Mapping
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
    for axis, values in models.items():
        if values["alpha"][0] <= 0.0 or any(value < 0.0 for name, (value, _) in values.items() if "beta" in name):
            raise IdentifiedVesselError("inertia must be positive and drag not negative")
        table = re.search(rf"(?ms)^\[model\.{axis}\][^\n]*\n.*?(?=^\s*\[|\Z)", text)
        if table is None:
            raise IdentifiedVesselError(
                f"{source.name} has no table [model.{axis}]: only uncoupled models can be replaced"
            )
        length, force = (units.angle_rad, units.moment_nm) if axis == "yaw" else (units.length_m, units.force_n)
        lines = [f"[model.{axis}]  # {origin}"]
        for name, power in (("alpha", 1), ("beta", 1), ("beta_quadratic", 2)):
            scale = length**power / force
            value, std = values.get(name, (0.0, 0.0))
            known = f"+- {std * scale:.2g}" if std > 0.0 else ""
            lines.append(f"{name} = {value * scale:.8g}  # identified {known}".rstrip())
        text = text[: table.start()] + "\n".join(lines) + "\n\n" + text[table.end() :]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")
    try:
        load_vessel(str(target))
    except ConfigError as error:
        target.unlink()
        raise IdentifiedVesselError(str(error)) from None
