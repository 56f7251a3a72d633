"""How good an identified model is: thesis 7.2. tau in N or Nm, alpha and beta in SI."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from marine.identification.checks import sampled
from marine.identification.result import Axis, FloatArray, Identified
from marine.identification.step import steady_state, time_constant
from marine.vessel import DegreeOfFreedom

Speed = TypeVar("Speed", float, FloatArray)


def advance(speed: Speed, force: Speed, h_s: float, model: tuple[Speed, Speed, Speed]) -> Speed:
    """Return the velocity h_s later under a constant force; model: alpha, beta, beta_quadratic; floats or arrays.

    Exact for constant drag to third order; linear drag is taken at the middle of the step, which is stable at any h_s.
    """
    alpha, beta, quadratic = model
    half = 0.5 * h_s / alpha
    middle = (speed + half * force) / (1.0 + half * (beta + quadratic * abs(speed)))
    g = half * (beta + quadratic * abs(middle))
    return ((1.0 - g) * speed + 2.0 * half * force) / (1.0 + g)


def simulate(
    dof: DegreeOfFreedom, t_s: FloatArray, tau: FloatArray, *, nu_0: float = 0.0, delta: float = 0.0
) -> FloatArray:
    """Return the velocity that a model answers tau with, shape (n,); tau[k] is held from t[k] to t[k+1]."""
    nu = np.empty(len(t_s))
    nu[0] = speed = float(nu_0)
    steps, forces = np.diff(t_s).tolist(), (np.asarray(tau, dtype=float) + delta).tolist()
    model = (dof.alpha, dof.beta, dof.beta_quadratic)
    for k, h in enumerate(steps):
        speed = advance(speed, forces[k], h, model)
        nu[k + 1] = speed
    return nu


def mean_absolute_error(predicted: FloatArray, measured: FloatArray) -> float:
    """Return J of (7.3)."""
    return float(np.mean(np.abs(np.asarray(predicted) - np.asarray(measured))))


def on_other_data(
    dof: DegreeOfFreedom,
    t_s: FloatArray,
    nu: FloatArray,
    tau: FloatArray,
    *,
    delta: float = 0.0,
    axis: Axis = "angular",
) -> float:
    """Return J (7.3) in m/s or rad/s of a model on data it was not identified from; starts at the measured velocity."""
    sampled(t_s, axis, nu=nu, tau=tau)
    return mean_absolute_error(simulate(dof, t_s, tau, nu_0=float(nu[0]), delta=delta), nu)


def relative(J: float, J_reference: float) -> float:
    """Return how much worse (positive) a model is than the reference model, (7.13), (7.14), (7.16)."""
    return (J - J_reference) / J_reference


def steady_state_difference_linear(beta: float, beta_reference: float, tau: float) -> float:
    """Return the difference of final velocities for constant drag, (7.5); take the largest tau used."""
    return abs(steady_state(tau, beta, "constant") - steady_state(tau, beta_reference, "constant"))


def steady_state_difference(beta: float, beta_reference: float, tau: float) -> float:
    """Return the difference of final velocities for linear drag, (7.7); take the largest tau used."""
    return abs(steady_state(tau, beta, "linear") - steady_state(tau, beta_reference, "linear"))


def time_constant_difference_linear(one: tuple[float, float], reference: tuple[float, float]) -> float:
    """Return the difference of T_L in s of two (alpha, beta), constant drag, (7.9)."""
    return abs(one[0] / one[1] - reference[0] / reference[1])


def time_constant_difference(one: tuple[float, float], reference: tuple[float, float], tau: float) -> float:
    """Return the difference of T_N in s of two (alpha, beta), linear drag, (7.11, corrected: see docs/errata.md).

    Take the smallest tau used.
    """
    return abs(time_constant(tau, *one, "linear") - time_constant(tau, *reference, "linear"))


def drag_difference_percent(beta: float, beta_reference: float) -> float:
    """Return (7.15), with the factor 100 that its unit asks for."""
    return 100.0 * abs((beta - beta_reference) / beta_reference)


def model_of(found: Identified) -> DegreeOfFreedom:
    """Return an identified model as the model of one degree of freedom."""
    values = {p.name: p.value for p in found.parameters}
    return DegreeOfFreedom(values["alpha"], values.get("beta", 0.0), values.get("beta_quadratic", 0.0))
