"""The one list of processes, and how a configuration file becomes a service."""

from __future__ import annotations

import importlib
import inspect
import os
import typing
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from bus.clock import Warp
from bus.config import ConfigError, Deployment, Section, parse, read_toml
from bus.hub import HubConfig
from bus.service import Service
from marine.vessel import INSTRUMENTS, Vessel
from services.vessels import load_vessel, vessel_path

ROOT = Path(__file__).parent.parent

PICTURES_UP_TO = 2.0
"""In faster time poses come from a stand-in for camera and tracker, not from rendered pictures."""


@dataclass(frozen=True)
class Process:
    """One entry of the catalogue. Groups with a lower priority start first and stop last."""

    name: str
    target: str
    priority: int = 30
    simulation_only: bool = False
    needs: Literal["camera", "laser", "instruments", ""] = ""
    """Started only for a vessel with a camera above it, a laser module, or with sensors besides that."""
    late: bool = False
    """Started when the others run: what holding does not need leaves the processor to what it does."""

    def fits(self, vessel: Vessel) -> bool:
        """Return whether the vessel has what the process is for."""
        kinds = {sensor.kind for sensor in vessel.sensors}
        return not self.needs or bool(kinds & (INSTRUMENTS if self.needs == "instruments" else {self.needs}))

    @cached_property
    def service(self) -> type[Service]:
        """The class, imported when it is asked for; raises ConfigError when there is none."""
        module, _, name = self.target.partition(":")
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            where = "looked in Starboard's folder and PYTHONPATH"
            raise ConfigError(f"service {self.name}: cannot import {self.target}: {error} ({where})") from None
        if not (isinstance(found, type) and issubclass(found, Service)):
            raise ConfigError(f"service {self.name}: {self.target} is no bus.Service")
        return found

    @property
    def config(self) -> type[Section] | None:
        """The model of this process' section in a configuration file."""
        return typing.get_type_hints(self.service.__init__).get("config")

    @property
    def doc(self) -> str:
        """First line of the class' docstring."""
        return (inspect.getdoc(self.service) or "").splitlines()[0]


PROCESSES = (
    Process("hub", "bus.hub:Hub", priority=10),
    Process("hub_standby", "bus.hub:StandbyHub", priority=10, late=True),
    Process("recorder", "logs.recorder:Recorder", priority=20),
    Process("platform_link", "platform_link.service:PlatformLink"),
    Process("allocator", "services.allocator:Allocator"),
    Process("helm", "services.helm:Helm"),
    Process("controller", "services.controller:Controller"),
    Process("experiment", "services.experiment:Experiments", late=True),
    Process("estimator", "services.estimator:Estimator"),
    Process("camera_tracker", "camera_tracker.service:CameraTracker", needs="camera"),
    Process("camera_calibration", "camera_tracker.calibration_service:CameraCalibration", needs="camera", late=True),
    Process("laser_tracker", "camera_tracker.laser.service:LaserTracker", needs="laser"),
    Process("sensors", "services.simulator.sensors:Sensors", simulation_only=True, needs="instruments"),
    Process("ui", "ui.server:Page", late=True),
    Process("simulator", "services.simulator.service:Simulator", simulation_only=True),
)


class SystemConfig(Section):
    """Section [system]: what all processes share."""

    vessel: str = Field("pladypos", description="a name in config/vessels, or the path of a vessel file")
    simulation: bool = Field(False, description="start the simulator, as the world behind camera and serial port")
    recordings: Path = Field(Path("recordings"), description="folder of the MCAP recordings")
    services: dict[str, str] = Field(
        default_factory=dict, description='add or replace processes: name = "module:Class"'
    )


@dataclass(frozen=True)
class Settings:
    """A configuration file, read and checked section by section."""

    path: Path | None
    tables: dict[str, Any]
    system: SystemConfig
    warp: Warp = field(default_factory=Warp)

    @property
    def hub(self) -> HubConfig:
        """Where the hubs listen."""
        return parse(HubConfig, self.tables.get("hub", {}), self.path or Path("defaults"), "hub")

    @property
    def vessel_name(self) -> str:
        """The vessel's name: the prefix of all keys."""
        return vessel_path(self.system.vessel).stem

    @property
    def known(self) -> dict[str, Process]:
        """Every process by its name: the catalogue's, and those that [system] replaces or adds."""
        known = {p.name: p for p in PROCESSES}
        for name, target in self.system.services.items():
            known[name] = replace(known[name], target=target) if name in known else Process(name, target)
        return known

    @property
    def processes(self) -> tuple[Process, ...]:
        """The processes that this configuration starts."""
        vessel, system = load_vessel(self.system.vessel), self.system
        absent = set() if self.hub.standby else {"hub_standby"}
        absent |= {p.name for p in PROCESSES if (p.simulation_only and not system.simulation) or not p.fits(vessel)}
        return tuple(p for name, p in self.known.items() if name in system.services or name not in absent)

    def process(self, name: str) -> Process:
        """Return one of the processes; raise ConfigError that lists the names."""
        known = self.known
        if name not in known:
            raise ConfigError(f"no service is called {name!r}; known: {', '.join(known)}")
        return known[name]

    def section(self, entry: Process) -> Section | None:
        """Return the validated section of a process; raise ConfigError with file and key."""
        if entry.config is None:
            return None
        return parse(entry.config, self.tables.get(entry.name, {}), self.path or Path("defaults"), entry.name)

    def check(self) -> None:
        """Check every section that is given and the vessel file; raise ConfigError at the first mistake."""
        vessel = load_vessel(self.system.vessel)
        for entry in self.processes:
            if entry.name in self.tables or entry.name in self.system.services:  # defaults need no import of the rest
                section = self.section(entry)
                try:
                    if section:
                        section.check_for(vessel)
                except ConfigError as error:
                    raise ConfigError(f"{self.path or 'defaults'}: {error}") from None

    def at(self, warp: Warp) -> Settings:
        """Return the settings for time that runs faster; above `PICTURES_UP_TO` without pictures."""
        if warp.factor <= PICTURES_UP_TO:
            return replace(self, warp=warp)
        tables = {name: table for name, table in self.tables.items() if name != "camera_tracker"}
        tables["simulator"] = {**tables.get("simulator", {}), "pictures": False}
        stand_in = {"camera_tracker": "services.simulator.stand_in:PoseStandIn"}
        system = self.system.model_copy(update={"services": {**self.system.services, **stand_in}})
        return replace(self, warp=warp, tables=tables, system=system)

    def deployment(self) -> Deployment:
        """Return where this system lives."""
        hub = self.hub
        return Deployment(
            config_path=self.path,
            vessel_path=vessel_path(self.system.vessel),
            run_dir=run_dir(),
            recordings_dir=self.system.recordings.absolute(),
            hub_endpoints=tuple(_reachable(address) for address in hub.addresses),
            hub_standby=hub.standby,
            warp=self.warp,
            security=hub.security and hub.security.absolute(),
        )


def _reachable(address: str) -> str:
    """Return where this machine's clients find a hub that listens on all interfaces."""
    return address.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def load_settings(path: Path | None) -> Settings:
    """Return the settings of a file (None: defaults); raise ConfigError with file, key and reason."""
    tables = read_toml(path) if path else {}
    where = path or Path("defaults")
    system = parse(SystemConfig, tables.get("system", {}), where, "system")
    known = ["system", *(p.name for p in PROCESSES), *system.services]
    for name in tables:
        if name not in known:
            raise ConfigError(f"{where}: [{name}]: no such section; known: {', '.join(known)}")
    return Settings(path.absolute() if path else None, tables, system)


def build(entry: Process, settings: Settings) -> Service:
    """Return a service with what its constructor asks for by name: config, vessel, deployment."""
    wanted = inspect.signature(entry.service.__init__).parameters
    given: dict[str, Any] = {}
    if "config" in wanted:
        given["config"] = settings.section(entry)
    if "vessel" in wanted:
        given["vessel"] = load_vessel(settings.system.vessel)
    if "deployment" in wanted:
        given["deployment"] = settings.deployment()
    service: Service = entry.service(**given)
    return service


def run_dir() -> Path:
    """Return the folder of this user's running system: short (sockets), in memory where the machine has that."""
    if given := os.environ.get("STARBOARD_RUN_DIR"):
        return Path(given)
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "starboard"
    base = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else Path("/tmp")
    return base / f"starboard-{os.getuid()}"
