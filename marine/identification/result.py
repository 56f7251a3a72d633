"""What every method of identification returns, and the one error it raises."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from marine.vessel import PaperUnits

FloatArray = NDArray[np.float64]

Axis = Literal["linear", "angular"]
"""Surge, sway, heave (m, N) or yaw (rad, Nm)."""

Drag = Literal["constant", "linear", "both"]
"""Form of the drag coefficient, (2.34): `constant` beta, `linear` beta |nu| (quadratic drag force), or their sum."""

_UNITS: dict[Axis, dict[str, str]] = {
    "linear": {"alpha": "kg", "beta": "N s/m", "beta_quadratic": "N s^2/m^2", "delta": "N"},
    "angular": {"alpha": "kg m^2", "beta": "Nm s/rad", "beta_quadratic": "Nm s^2/rad^2", "delta": "Nm"},
}


class IdentificationError(ValueError):
    """The data cannot be identified; the message says why and what to do."""


@dataclass(frozen=True)
class Parameter:
    """One identified value with its standard deviation (nan where one experiment cannot tell)."""

    name: str
    value: float
    unit: str
    std: float = float("nan")


@dataclass(frozen=True)
class DataUsed:
    """What an identification was made from: samples, seconds, and the pieces they were cut in (runs, periods...)."""

    samples: int
    duration_s: float
    pieces: int
    piece: str


@dataclass(frozen=True)
class Identified:
    """A model and how far to trust it."""

    method: str
    model: str
    parameters: tuple[Parameter, ...]
    data: DataUsed
    citation: str
    warnings: tuple[str, ...] = ()
    residuals: FloatArray = field(default_factory=lambda: np.empty(0))
    """What the model leaves unexplained, in `residual_unit`."""
    residual_unit: str = ""

    def parameter(self, name: str) -> Parameter:
        """Return a parameter; raises KeyError for a name that the model has not."""
        for one in self.parameters:
            if one.name == name:
                return one
        raise KeyError(f"{self.method} did not identify {name}: it has {', '.join(p.name for p in self.parameters)}")

    def __getitem__(self, name: str) -> float:
        return self.parameter(name).value

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals, nan if the method has none."""
        return float(np.sqrt(np.mean(self.residuals**2))) if self.residuals.size else float("nan")

    def warned(self, *warnings: str) -> Identified:
        """Return the same result with more warnings."""
        return replace(self, warnings=self.warnings + warnings)


def in_paper_units(found: Identified, units: PaperUnits) -> dict[str, float]:
    """Return the parameters of an uncoupled model in the units of a paper (pixels, normalised force...).

    The way back from SI that compares with a printed table; velocities themselves are metric: m/s = px/s length_m.
    """
    linear = found.parameter("alpha").unit == "kg"
    length, force = (units.length_m, units.force_n) if linear else (units.angle_rad, units.moment_nm)
    powers = {"alpha": 1, "beta": 1, "beta_quadratic": 2, "delta": 0}
    return {p.name: p.value * length ** powers[p.name] / force for p in found.parameters}


def drag_of(drag: Drag) -> tuple[str, ...]:
    """Return the names of the drag parameters of a model."""
    return {"constant": ("beta",), "linear": ("beta_quadratic",), "both": ("beta", "beta_quadratic")}[drag]


def parameters(axis: Axis, values: dict[str, float], stds: dict[str, float] | None = None) -> tuple[Parameter, ...]:
    """Return named values (alpha, beta, beta_quadratic, delta) with the units of an axis."""
    stds = stds or {}
    return tuple(Parameter(n, float(v), _UNITS[axis][n], float(stds.get(n, np.nan))) for n, v in values.items())


def mean_and_std(values: FloatArray) -> tuple[float, float]:
    """Return the mean and the standard deviation of one value (ddof = 1, as the papers' tables), nan for one value."""
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def require_physical(values: dict[str, float], advice: str) -> None:
    """Raise IdentificationError when inertia is not positive: then an axis or the actuation has the wrong sign."""
    alpha = values["alpha"]
    if not np.isfinite(list(values.values())).all():
        raise IdentificationError(f"no finite parameters come out of these data: {advice}")
    if alpha <= 0.0:
        raise IdentificationError(
            f"inertia comes out as {alpha:.3g}: motion answers against the force. Check the sign of tau or of the axis"
        )


def drag_warnings(values: dict[str, float]) -> tuple[str, ...]:
    """Return a warning for every drag coefficient that is negative: the vessel would drive itself."""
    return tuple(
        f"{name} is negative ({value:.3g}): this form of drag does not fit; try the other one, or excite more"
        for name, value in values.items()
        if name.startswith("beta") and value < 0.0
    )
