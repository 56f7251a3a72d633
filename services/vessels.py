"""Vessel files (config/vessels/*.toml) into `marine.vessel`, in SI. The only place that knows a paper's units."""

from __future__ import annotations

import math
from pathlib import Path

from pydantic import Field

from bus.config import ConfigError, Section, parse, read_toml
from marine import vessel as v

VESSELS_DIR = Path(__file__).parent.parent / "config" / "vessels"


class _Units(Section):
    length_m: float = Field(1.0, gt=0)
    force_n: float = Field(1.0, gt=0)
    moment_nm: float = Field(1.0, gt=0)


class _DegreeOfFreedom(Section):
    alpha: float = Field(gt=0)
    beta: float = Field(0.0, ge=0)
    beta_quadratic: float = Field(0.0, ge=0)

    def in_si(self, length_or_angle: float, force_or_moment: float) -> v.DegreeOfFreedom:
        scale = force_or_moment / length_or_angle
        return v.DegreeOfFreedom(self.alpha * scale, self.beta * scale, self.beta_quadratic * scale / length_or_angle)


class _Model(Section):
    surge: _DegreeOfFreedom
    sway: _DegreeOfFreedom
    yaw: _DegreeOfFreedom


class _Thruster(Section):
    name: str
    x_m: float
    y_m: float
    angle_deg: float
    k_t: float = Field(gt=0)
    n_max: float = Field(gt=0)
    integer: bool = False
    dead_zone: float = Field(0.0, ge=0)

    def in_si(self, force_n: float) -> v.Thruster:
        angle_rad = math.radians(self.angle_deg)
        k_t = self.k_t * force_n
        return v.Thruster(self.name, self.x_m, self.y_m, angle_rad, k_t, self.n_max, self.integer, self.dead_zone)


class _Pool(Section):
    length_x_m: float = Field(gt=0)
    length_y_m: float = Field(gt=0)


class _Camera(Section):
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    scale_px_per_m: float = Field(gt=0)
    height_m: float = Field(gt=0)
    rate_hz: float = Field(gt=0)


class _Validity(Section):
    hold_s: float = Field(0.25, gt=0)


class _Hold(Section):
    w0_rad_s: float = Field(gt=0)


class _File(Section):
    title: str
    radius_m: float = Field(gt=0)
    units: _Units = _Units()
    model: _Model
    thruster: list[_Thruster] = Field(min_length=1)
    pool: _Pool
    camera: _Camera
    validity: _Validity = _Validity()
    hold: _Hold


def vessel_path(name: str) -> Path:
    """Return the file of a vessel given by name or path; raise ConfigError that lists the known ones."""
    path = Path(name) if name.endswith(".toml") else VESSELS_DIR / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in VESSELS_DIR.glob("*.toml")))
        raise ConfigError(f"{path}: no such vessel; known: {known}")
    return path


def load_vessel(name: str) -> v.Vessel:
    """Return a vessel in SI, given by name or path; raise ConfigError with file, key and reason."""
    path = vessel_path(name)
    file = parse(_File, read_toml(path), path)
    units = file.units
    names = [t.name for t in file.thruster]
    if len(set(names)) < len(names):
        raise ConfigError(f"{path}: thruster: two actuators have the same name")
    return v.Vessel(
        name=path.stem,
        title=file.title,
        model=v.HorizontalModel(
            surge=file.model.surge.in_si(units.length_m, units.force_n),
            sway=file.model.sway.in_si(units.length_m, units.force_n),
            yaw=file.model.yaw.in_si(1.0, units.moment_nm),
        ),
        thrusters=tuple(t.in_si(units.force_n) for t in file.thruster),
        radius_m=file.radius_m,
        pool=v.Pool(**file.pool.model_dump()),
        camera=v.Camera(**file.camera.model_dump()),
        validity=v.Validity(**file.validity.model_dump()),
        hold_w0_rad_s=file.hold.w0_rad_s,
        units=v.PaperUnits(**units.model_dump()),
    )
