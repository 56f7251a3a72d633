"""Vessel files (config/vessels/*.toml) into `marine.vessel`, in SI. The only place that knows a paper's units.

The tables of a file are in `services.vessel_file`; here they are put together and refused when they make no vessel.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from bus.config import ConfigError, parse, read_toml
from marine import vessel as v

if TYPE_CHECKING:  # what it takes to read a vessel file is imported when one is read: the hubs start without
    from services.vessel_file import VesselFile

VESSELS_DIR = Path(__file__).parent.parent / "config" / "vessels"

_KIND_IN_KEY = re.compile(r": (model|actuator\.\d+)\.[a-z_]+\.")
"""pydantic puts the kind of a table into the key; the file does not."""
_NO_MODEL = re.compile(r": model(\.\w+)*: Field required$")
_GUESS = ": not known? Guess inertia and drag within a factor of three, and tune on the running system: docs/tuning.md"
_MAP_WIDTH_PX = 800
_MAP_RATE_HZ = 10.0


def known_vessels() -> list[str]:
    """Return the names of all vessels in config/vessels."""
    return sorted(path.stem for path in VESSELS_DIR.glob("*.toml"))


def vessel_path(name: str) -> Path:
    """Return the file of a vessel given by name or path; raise ConfigError that lists the known ones."""
    path = Path(name) if name.endswith(".toml") else VESSELS_DIR / f"{name}.toml"
    if not path.is_file():
        raise ConfigError(f"{path}: no such vessel; known: {', '.join(known_vessels())}")
    return path


def load_vessel(name: str) -> v.Vessel:
    """Return a vessel in SI, given by name or path; raise ConfigError with file, key and reason."""
    from services.vessel_file import VesselFile

    path = vessel_path(name)
    try:
        file = parse(VesselFile, read_toml(path), path)
    except ConfigError as error:
        said = _KIND_IN_KEY.sub(r": \1.", str(error))
        raise ConfigError(said + _GUESS if _NO_MODEL.search(said) else said) from None
    try:
        return _vessel(path.stem, file)
    except _RefusedError as refused:
        raise ConfigError(f"{path}: {refused}") from None


def controllable(actuators: tuple[v.Actuator, ...], axes: tuple[v.Axis, ...] = v.AXES) -> int:
    """Return how many of the axes the actuators can set independently: rank of those rows of the allocation matrix."""
    import numpy as np

    rows = [v.AXES.index(axis) for axis in axes]
    columns = np.array([a.column for a in actuators]).T[rows]
    return int(np.linalg.matrix_rank(columns, tol=1e-6))


class _RefusedError(ValueError):
    """Key and reason, without the file."""


def _vessel(name: str, file: VesselFile) -> v.Vessel:
    from marine.dynamics.design import uncoupled

    units = file.units
    actuators = tuple(a.in_si(units.force_n) for a in file.actuator)
    _check_actuators(actuators)
    dynamics = _dynamics(file, actuators)
    _check_inertia(dynamics)
    controlled = tuple(axis for axis in v.AXES if axis in file.controlled)
    rank = controllable(actuators, controlled)
    if rank < len(controlled):
        raise _RefusedError(
            f"controlled: the allocation is singular: the actuators set {rank} of {', '.join(controlled)} independently"
        )
    pool = v.Pool(**file.pool.model_dump())
    sensors = tuple(s.in_si() for s in file.sensor)
    if len({s.kind for s in sensors}) < len(sensors):
        raise _RefusedError("sensor: two sensors of the same kind")
    if file.camera is None and any(s.kind == "camera" for s in sensors):
        raise _RefusedError("camera: a sensor of kind camera needs the table [camera]")
    return v.Vessel(
        name=name,
        title=file.title,
        model=uncoupled(dynamics),
        dynamics=dynamics,
        actuators=actuators,
        controlled=controlled,
        sensors=sensors,
        radius_m=file.radius_m,
        pool=pool,
        camera=v.Camera(**file.camera.model_dump()) if file.camera else _map_of(pool),
        validity=file.validity.in_si(),
        hold_w0_rad_s=file.hold.w0_rad_s,
        heading_w0_rad_s=file.hold.heading_w0_rad_s,
        units=v.PaperUnits(**units.model_dump()),
        bias=file.bias.in_si(units),
        tether=v.Tether(**file.tether.model_dump()) if file.tether else None,
        command_delay_s=file.command_delay_s,
        sources=tuple(file.sources),
    )


def _map_of(pool: v.Pool) -> v.Camera:
    """Return the picture that a vessel without a camera is shown on: its whole basin from above."""
    scale = _MAP_WIDTH_PX / pool.length_x_m
    return v.Camera(_MAP_WIDTH_PX, max(1, round(pool.length_y_m * scale)), scale, pool.length_x_m, _MAP_RATE_HZ)


def _check_actuators(actuators: tuple[v.Actuator, ...]) -> None:
    names = [a.name for a in actuators]
    thrusters = {a.name for a in actuators if isinstance(a, v.Thruster)}
    if len(set(names)) < len(names):
        raise _RefusedError("actuator: two actuators have the same name")
    for index, actuator in enumerate(actuators):
        if actuator.dead_zone >= actuator.n_max:
            raise _RefusedError(f"actuator.{index}.dead_zone: {actuator.name} does nothing at all: n_max lies within")
        if isinstance(actuator, v.Rudder) and actuator.behind not in thrusters:
            raise _RefusedError(f"actuator.{index}.behind: no thruster is called {actuator.behind!r}")


def _dynamics(file: VesselFile, actuators: tuple[v.Actuator, ...]) -> v.Dynamics:
    from services.vessel_file import SmallVessel

    if not isinstance(file.model, SmallVessel):
        return file.model.in_si(file.units)
    moment_nm = sum(a.column[5] * a.k_r2 for a in actuators if isinstance(a, v.Rudder))
    if moment_nm <= 0.0:
        raise _RefusedError("model: a small_vessel needs rudders astern with k_r2 > 0: the unit of its yaw")
    return file.model.in_si(file.units, moment_nm)


def _check_inertia(dynamics: v.Dynamics) -> None:
    """Refuse a mass matrix that is not positive definite, which single keys do not show."""
    import numpy as np

    if isinstance(dynamics, v.SixDofModel | v.CoupledModel):
        from marine.dynamics.horizontal import coupled_mass_matrix
        from marine.dynamics.six_dof import mass_matrix

        M = mass_matrix(dynamics) if isinstance(dynamics, v.SixDofModel) else coupled_mass_matrix(dynamics)
        if float(np.linalg.eigvalsh(M).min()) <= 0.0:
            raise _RefusedError("model: the inertia matrix is not positive definite")
    elif isinstance(dynamics, v.AsvModel):
        from marine.dynamics.asv import AsvDynamics

        asv = AsvDynamics(dynamics)
        for U in np.linspace(0.0, dynamics.max_speed_m_s, 37):
            for r in np.linspace(-dynamics.max_yaw_rad_s, dynamics.max_yaw_rad_s, 21):
                if min(asv.inertia(float(U), float(r))) <= 0.0:
                    raise _RefusedError(f"model: inertia is not positive at U = {U:.1f} m/s, r = {r:.2f} rad/s")
