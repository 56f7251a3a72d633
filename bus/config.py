"""Configuration: TOML into pydantic models; an error names the file, the key and what to do."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from bus.clock import Warp


class ConfigError(ValueError):
    """A mistake in a configuration file, told in one line."""


class Section(BaseModel):
    """Base of every section of a configuration file: unknown keys are refused, values do not change."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def check_for(self, vessel: Any) -> None:
        """Raise ConfigError when it does not suit the vessel (a marine.vessel.Vessel): asked before anything starts."""


S = TypeVar("S", bound=BaseModel)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; raise ConfigError when it is missing or malformed."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None


def parse(model: type[S], values: Any, path: Path, section: str = "") -> S:
    """Return a validated section; raise ConfigError that names file, key and reason."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in ([section] if section else []) + list(first["loc"]))
        reason = "no such key" if first["type"] == "extra_forbidden" else first["msg"].removeprefix("Value error, ")
        known = ""
        if first["type"] == "extra_forbidden" and len(first["loc"]) == 1:
            known = f"; known: {', '.join(model.model_fields)}"
        raise ConfigError(f"{path}: {key}: {reason}{known}") from None


@dataclass(frozen=True)
class Deployment:
    """Where a running system lives: files and addresses that several services share."""

    config_path: Path | None = None
    vessel_path: Path | None = None
    run_dir: Path = field(default_factory=lambda: Path("/tmp/starboard"))
    """Short-lived files: sockets, links, state files of this run."""
    recordings_dir: Path = field(default_factory=lambda: Path("recordings"))
    hub_endpoints: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Where clients find a hub: the hub's addresses, then the standby's."""
    hub_standby: str = ""
    """Where the standby hub listens; empty when there is none."""
    warp: Warp = field(default_factory=Warp)
    security: Path | None = None
    """Folder of keys, passwords and access rules; None: anybody who reaches the hub is let in."""
