"""From what was measured of one axis to a record that methods take, and what each method makes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from marine.identification import harmonic, least_squares, response_fit, self_oscillation, step, zigzag
from marine.identification.experiments import Kind
from marine.identification.oscillation import reversals
from marine.identification.result import Axis, Drag, FloatArray, IdentificationError, Identified
from marine.identification.validation import model_of, simulate

LONGEST_GAP_S = 0.5
"""A longer silence of a sensor is not bridged."""


@dataclass(frozen=True)
class Record:
    """One axis on a uniform grid: eta in m or rad (unwrapped), tau[k] the mean force from t[k] to t[k+1], N or Nm."""

    t_s: FloatArray
    eta: FloatArray
    tau: FloatArray
    axis: Axis
    delay_s: float = 0.0
    """Known delay from tau to eta."""

    @property
    def dt_s(self) -> float:
        """Sample time in s."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)


def along(x_m: FloatArray, y_m: FloatArray, psi_rad: float, *, sway: bool = False) -> FloatArray:
    """Return the way from the first place along the heading psi, or to starboard of it (sway), in m."""
    x, y = x_m - x_m[0], y_m - y_m[0]
    c, s = np.cos(psi_rad), np.sin(psi_rad)
    out: FloatArray = y * c - x * s if sway else x * c + y * s
    return out


def on_grid(
    eta_s: FloatArray,
    eta: FloatArray,
    tau_s: FloatArray,
    tau: FloatArray,
    *,
    axis: Axis,
    begin_s: float,
    end_s: float,
    sample_s: float | None = None,
    delay_s: float = 0.0,
    longest_gap_s: float = LONGEST_GAP_S,
) -> Record:
    """Return a record on one grid: eta by straight lines, tau (held from each of its times on) as means of cells.

    eta_s, tau_s: times in s, rising; sample_s: of the grid, None: median of eta_s; longest_gap_s: between two
    times. Raises IdentificationError for gaps, and where nothing was recorded.
    """
    inside = (eta_s >= begin_s) & (eta_s <= end_s)
    if inside.sum() < 8 or len(tau_s) < 2:
        raise IdentificationError(f"{int(inside.sum())} positions and {len(tau_s)} forces in this time are too few")
    t = eta_s[inside]
    for name, times in (("position", t), ("force", tau_s[(tau_s >= begin_s) & (tau_s <= end_s)])):
        steps = np.diff(times)
        if len(steps) and steps.min() < 0.0:
            raise IdentificationError(f"time of the {name} goes backward at {times[int(np.argmin(steps))]:.3f} s")
        if len(steps) and steps.max() > longest_gap_s:
            raise IdentificationError(
                f"{name}: gap of {steps.max():.2f} s at {times[int(np.argmax(steps))] - t[0]:.2f} s"
            )
    sample_s = sample_s or float(np.median(np.diff(t)))
    grid = t[0] + sample_s * np.arange(int((t[-1] - t[0]) / sample_s + 1e-9))  # the last cell ends within, too
    impulse = np.concatenate([[0.0], np.cumsum(tau[:-1] * np.diff(tau_s))])
    ends_s = np.append(tau_s, max(tau_s[-1], grid[-1]) + 2.0 * sample_s)
    impulses = np.append(impulse, impulse[-1] + tau[-1] * (ends_s[-1] - tau_s[-1]))
    edges = np.append(grid, grid[-1] + sample_s)
    means = np.diff(np.interp(edges, ends_s, impulses)) / sample_s
    position = np.unwrap(eta[inside]) if axis == "angular" else eta[inside]
    return Record(grid - grid[0], np.interp(grid, t, position), means, axis, delay_s)


def methods_for(kind: Kind) -> tuple[str, ...]:
    """Return the names of the methods that suit an experiment, the best first."""
    return {
        "step": ("response fit", "step fit", "step formulas", "velocity formulas"),
        "self-oscillation": ("projection", "describing function", "least squares"),
        "zigzag": ("projection", "least squares", "zig-zag integrals"),
        "pull-out": ("response fit", "least squares"),
        "prbs": ("least squares", "response fit"),
    }[kind]


def identify(record: Record, method: str, drag: Drag = "linear", tau_limit: float | None = None) -> Identified:
    """Return what one method (see METHODS) makes of a record; raise IdentificationError with the reason."""
    found = METHODS[method](record, drag)
    if tau_limit is not None and float(np.quantile(np.abs(record.tau), 0.9)) > 0.999 * tau_limit:
        return found.warned("the actuators were at their limit: repeat with a smaller amplitude")
    return found


def compare(record: Record, kind: Kind, drag: Drag = "linear") -> list[tuple[str, Identified | IdentificationError]]:
    """Return each suitable method with its result, or with why it cannot be used."""
    found: list[tuple[str, Identified | IdentificationError]] = []
    for method in methods_for(kind):
        try:
            found.append((method, identify(record, method, drag)))
        except IdentificationError as error:
            found.append((method, error))
    return found


def response(record: Record, found: Identified) -> tuple[FloatArray, FloatArray]:
    """Return (eta, nu) of an identified model under the recorded force, from the measured start; shape (n,) each."""
    delta = next((p.value for p in found.parameters if p.name == "delta"), 0.0)
    nu = simulate(model_of(found), record.t_s, record.tau, nu_0=float(velocity(record)[0]), delta=delta)
    way = np.concatenate([[0.0], np.cumsum(0.5 * record.dt_s * (nu[1:] + nu[:-1]))])
    return record.eta[0] + way, nu


def velocity(record: Record) -> FloatArray:
    """Return the measured velocity: slope of a parabola over 0.5 s, shape (n,)."""
    half = max(2, round(0.25 / record.dt_s))
    half = min(half, (len(record.eta) - 1) // 2)
    out: FloatArray = savgol_filter(record.eta, 2 * half + 1, 2, deriv=1, delta=record.dt_s)
    return out


def _step_force(record: Record) -> float:
    force = float(np.median(record.tau))
    if np.mean(np.abs(record.tau - force) > 0.2 * abs(force)) > 0.05:
        raise IdentificationError("the force is not constant: this is no step")
    return float(np.mean(record.tau[:-1]))


def _acting_s(record: Record) -> FloatArray:
    """Return times counted from when the force begins to act."""
    return record.t_s - record.delay_s


def _window_s(record: Record) -> float:
    """Return half the median time between reversals of tau, or an eighth of the record."""
    turns = reversals(record.tau)
    whole_s = float(record.t_s[-1])
    return 0.5 * float(np.median(np.diff(turns))) * record.dt_s if len(turns) > 3 else whole_s / 8.0


def _least_squares(r: Record, drag: Drag) -> Identified:
    window_s = max(_window_s(r), 10.0 * r.dt_s)
    return least_squares.uncoupled(
        r.t_s, r.tau, eta=r.eta, drag=drag, axis=r.axis, window_s=window_s, delay_s=r.delay_s
    )


METHODS: dict[str, Callable[[Record, Drag], Identified]] = {
    "projection": lambda r, drag: harmonic.project(r.t_s, r.eta, r.tau, drag=drag, axis=r.axis, delay_s=r.delay_s),
    "describing function": lambda r, drag: self_oscillation.from_record(
        r.t_s, r.eta, r.tau, reference=_middle(r), drag=drag, axis=r.axis, delay_s=r.delay_s
    ),
    "least squares": _least_squares,
    "zig-zag integrals": lambda r, _: zigzag.integrals(r.t_s, r.eta, r.tau, disturbance=True, axis=r.axis),
    "response fit": lambda r, drag: response_fit.fit(
        r.t_s,
        r.eta,
        r.tau,
        drag=drag,
        axis=r.axis,
        disturbance=bool(np.any(r.tau[1:] * r.tau[:-1] < 0.0)),
        delay_s=r.delay_s,
    ),
    "step fit": lambda r, drag: step.fit_response(_acting_s(r), _step_force(r), eta=r.eta, drag=drag, axis=r.axis),
    "step formulas": lambda r, drag: step.type_1(_acting_s(r), r.eta, _step_force(r), drag=drag, axis=r.axis),
    "velocity formulas": lambda r, drag: step.type_0(_acting_s(r), velocity(r), _step_force(r), drag=drag, axis=r.axis),
}
"""Name -> what makes of a record and a form of drag a result."""


def _middle(record: Record) -> float:
    """Return the place about which the relay switched: the middle of eta at its switches."""
    tau = record.tau - 0.5 * (record.tau.max() + record.tau.min())
    up = record.eta[1:][(tau[1:] > 0) & (tau[:-1] <= 0)]
    down = record.eta[1:][(tau[1:] <= 0) & (tau[:-1] > 0)]
    return 0.5 * float(np.mean(up) + np.mean(down)) if len(up) and len(down) else 0.0
