"""Yaw of a real ship from rudder manoeuvres: every method on every run, and how each predicts the other runs.

The moment is n^2 delta, as thesis (2.38), (3.5, corrected: see docs/errata.md) have it for a rudder in a propeller's
wake: n in parts of `N_REFERENCE`, delta in rad. alpha and drag are then in rad of rudder at that number of revolutions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from marine.identification import harmonic, least_squares, zigzag
from marine.identification.manoeuvres import executes
from marine.identification.oscillation import Oscillation
from marine.identification.result import Drag, FloatArray, IdentificationError, Identified
from marine.identification.self_oscillation import marine_parameters
from marine.identification.validation import mean_absolute_error, simulate
from marine.vessel import DegreeOfFreedom

N_REFERENCE = 10.0
"""rps: 10 revolutions a second make 1 rad of rudder a moment of 1."""


@dataclass(frozen=True)
class ShipRun:
    """One manoeuvre while the propeller turns steadily; psi unwrapped, r measured, rudder as it really stood."""

    name: str
    t_s: FloatArray
    psi_rad: FloatArray
    r_rad_s: FloatArray
    rudder_rad: FloatArray
    n_rps: float

    @property
    def moment(self) -> FloatArray:
        """n^2 delta, in rad of rudder at `N_REFERENCE`."""
        return self.rudder_rad * (self.n_rps / N_REFERENCE) ** 2

    @property
    def manoeuvre(self) -> ShipRun:
        """The part from the first execute on: before it the ship gathers way under a hand-steered rudder."""
        part = slice(executes(self.rudder_rad)[0], None)
        t_s = self.t_s[part] - self.t_s[part][0]
        return ShipRun(self.name, t_s, self.psi_rad[part], self.r_rad_s[part], self.rudder_rad[part], self.n_rps)


@dataclass(frozen=True)
class Line:
    """What one method made of one run: parameters, and J (7.3) in parts of the rms of r: own data, mean of the others.

    refused: why there are no parameters.
    """

    run: str
    method: str
    drag: Drag
    alpha: float = float("nan")
    beta: float = float("nan")
    delta: float = float("nan")
    own: float = float("nan")
    others: float = float("nan")
    refused: str = ""


def steady_propeller(
    name: str, *, t_s: FloatArray, psi_rad: FloatArray, r_rad_s: FloatArray, rudder_rad: FloatArray, n_rps: FloatArray
) -> ShipRun:
    """Return the longest part of a record in which the propeller is within 5 % of its largest speed, ahead."""
    on = np.concatenate([[False], n_rps >= 0.95 * np.max(n_rps), [False]])
    edges = np.flatnonzero(np.diff(on.astype(int)))
    begin, end = max(edges.reshape(-1, 2).tolist(), key=lambda pair: pair[1] - pair[0])
    part = slice(begin, end)
    t = t_s[part] - t_s[begin]
    return ShipRun(name, t, np.unwrap(psi_rad)[part], r_rad_s[part], rudder_rad[part], float(np.median(n_rps[part])))


def zigzag_oscillation(run: ShipRun) -> tuple[Oscillation, float]:
    """Return a zig-zag as the self-oscillation that it is, and the rudder's delay in s (half its travel).

    Whole half periods after the first counter rudder are averaged; raises IdentificationError for fewer than two.
    """
    orders = executes(run.rudder_rad)[1:]
    if len(orders) < 3:
        raise IdentificationError(f"{max(len(orders) - 1, 0)} half periods after the first swing are too few")
    heading, sides = run.psi_rad[orders], np.sign(run.rudder_rad[orders])
    swings = zip(orders[:-1], orders[1:], sides[:-1].tolist(), strict=True)
    extrema = np.array([side * np.max(side * run.psi_rad[begin:end]) for begin, end, side in swings])
    travel = [int(np.argmax(side * run.rudder_rad[k:] <= 0.0)) for k, side in zip(orders, sides.tolist(), strict=True)]
    dt_s = float(run.t_s[1] - run.t_s[0])
    found = Oscillation(
        C=float(np.median(np.abs(run.moment[orders[0] : orders[-1]]))),
        x_a=0.5 * float(np.mean(np.abs(np.diff(heading)))),
        X_m=0.5 * float(np.mean(np.abs(np.diff(extrema)))),
        omega=float(np.pi / np.mean(np.diff(run.t_s[orders]))),
        x_0=0.5 * float(np.mean(heading[:-1] + heading[1:]) - np.mean(extrema[:-1] + extrema[1:])),
        periods=(len(orders) - 1) // 2,
    )
    return found, float(np.mean(travel)) * dt_s


Estimate = Callable[[ShipRun, Drag], dict[str, float]]


def _values(found: Identified) -> dict[str, float]:
    return {p.name: p.value for p in found.parameters}


def _self_oscillation(run: ShipRun, drag: Drag) -> dict[str, float]:
    found, delay_s = zigzag_oscillation(run)
    every = marine_parameters(found, delay_s)
    name = "beta" if drag == "constant" else "beta_quadratic"
    whole = executes(run.rudder_rad)[1:][: 2 * found.periods + 1]
    part = slice(whole[0], whole[-1])
    nu = run.r_rad_s[part]
    resisting = nu if drag == "constant" else np.abs(nu) * nu
    delta = every[name] * float(np.mean(resisting)) - float(np.mean(run.moment[part]))
    return {"alpha": every["alpha"], name: every[name], "delta": delta}


METHODS: dict[str, tuple[tuple[Drag, ...], Estimate]] = {
    "least squares": (
        ("constant", "linear"),
        lambda run, drag: _values(least_squares.uncoupled(run.t_s, run.moment, nu=run.r_rad_s, drag=drag)),
    ),
    "zig-zag integrals": (
        ("constant",),
        lambda run, _: _values(zigzag.integrals(run.t_s, run.psi_rad, run.moment, nu=run.r_rad_s)),
    ),
    "zig-zag integrals, Delta": (
        ("constant",),
        lambda run, _: _values(zigzag.integrals(run.t_s, run.psi_rad, run.moment, nu=run.r_rad_s, disturbance=True)),
    ),
    "self-oscillation": (("constant", "linear"), _self_oscillation),
    "projection": (
        ("constant", "linear"),
        lambda run, drag: _values(harmonic.project(run.t_s, run.psi_rad, run.moment, drag=drag)),
    ),
}
"""Name -> forms of drag that it can find, and how."""


def cross_validation(runs: Sequence[ShipRun]) -> list[Line]:
    """Return one line a run, method and drag; a method that refuses a run says why.

    All take the manoeuvre, but the projection, which needs two whole periods, takes the approach with it.
    """
    parts = [run.manoeuvre for run in runs]
    return [
        _line(run if method == "projection" else part, part, [p for p in parts if p is not part], method, drag)
        for run, part in zip(runs, parts, strict=True)
        for method, (drags, _) in METHODS.items()
        for drag in drags
    ]


def prediction(run: ShipRun, dof: DegreeOfFreedom, delta: float) -> FloatArray:
    """Return the rate of turn in rad/s that a model answers the rudder of a run with, from its measured start."""
    return simulate(dof, run.t_s, run.moment, nu_0=float(run.r_rad_s[0]), delta=delta)


def misfit(run: ShipRun, dof: DegreeOfFreedom, delta: float) -> float:
    """Return J (7.3) of a model on a run, in parts of the rms of r."""
    J = mean_absolute_error(prediction(run, dof, delta), run.r_rad_s)
    return J / float(np.sqrt(np.mean(run.r_rad_s**2)))


def _line(data: ShipRun, run: ShipRun, others: Sequence[ShipRun], method: str, drag: Drag) -> Line:
    try:
        found = METHODS[method][1](data, drag)
    except IdentificationError as reason:
        return Line(run.name, method, drag, refused=str(reason))
    beta, delta = found["beta" if drag == "constant" else "beta_quadratic"], found.get("delta", 0.0)
    dof = DegreeOfFreedom(found["alpha"], found.get("beta", 0.0), found.get("beta_quadratic", 0.0))
    if dof.alpha <= 0.0 or beta <= 0.0:
        return Line(run.name, method, drag, found["alpha"], beta, delta, refused="no physical parameters")
    J = [misfit(other, dof, delta) for other in others]
    return Line(run.name, method, drag, dof.alpha, beta, delta, misfit(run, dof, delta), float(np.mean(J)))
