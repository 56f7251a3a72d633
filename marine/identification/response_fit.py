"""Identification by fitting the simulated response to the recorded force: (4.46) for a force that is not constant.

Holding heading and sway takes a changing part of the thrusters, so a step on the running system is none of the books'.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from marine.identification.checks import sampled
from marine.identification.result import (
    Axis,
    DataUsed,
    Drag,
    FloatArray,
    IdentificationError,
    Identified,
    drag_of,
    parameters,
)
from marine.identification.validation import simulate
from marine.vessel import DegreeOfFreedom


def fit(
    t_s: FloatArray,
    eta: FloatArray,
    tau: FloatArray,
    *,
    drag: Drag = "linear",
    axis: Axis = "linear",
    disturbance: bool = False,
    delay_s: float = 0.0,
) -> Identified:
    """Return alpha and drag (and Delta) whose response to tau fits eta best, starting values of motion included.

    t_s, eta (unwrapped), tau: shape (n,); tau[k] acts from t[k] + delay_s on. One step cannot tell a constant
    disturbance from drag: leave it out, and make pairs of opposite runs. Deviations are those of white residuals.
    """
    dt_s = sampled(t_s, axis, eta=eta, tau=tau)
    if drag == "both":
        raise IdentificationError("fit one form of drag at a time")
    names = ["alpha", *drag_of(drag), *(["delta"] if disturbance else [])]
    force = np.interp(t_s - delay_s, t_s, tau)
    scale = float(np.ptp(eta))
    C, T = float(np.max(np.abs(tau))), float(t_s[-1] - t_s[0])
    nu = float(np.max(np.abs(np.diff(eta[:: max(1, round(0.5 / dt_s))])))) / max(0.5, dt_s)
    start = np.log([C * T / 3.0 / nu, C / nu if drag == "constant" else C / nu**2])

    def response(theta: FloatArray) -> FloatArray:
        alpha, beta = np.exp(np.clip(theta[:2], -30.0, 30.0))
        dof = DegreeOfFreedom(alpha, beta, 0.0) if drag == "constant" else DegreeOfFreedom(alpha, 0.0, beta)
        delta = theta[4] * C if disturbance else 0.0
        speed = simulate(dof, t_s, force, nu_0=theta[3] * nu, delta=delta)
        way = np.concatenate([[0.0], np.cumsum(0.5 * dt_s * (speed[1:] + speed[:-1]))])
        out: FloatArray = eta[0] + theta[2] * scale + way
        return out

    def residuals(theta: FloatArray) -> FloatArray:
        return (response(theta) - eta) / scale

    guess = np.concatenate([start, np.zeros(3 if disturbance else 2)])
    best = least_squares(residuals, guess, x_scale=0.1, max_nfev=60)
    if not best.success:
        raise IdentificationError("no response fits: is the force in this record the one that moved the vessel?")
    freedom = max(len(t_s) - len(guess), 1)
    jacobian = np.asarray(best.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * 2.0 * best.cost / freedom
    deviations = np.sqrt(np.diag(covariance))
    found = [float(np.exp(best.x[0])), float(np.exp(best.x[1]))]
    stds = [found[0] * float(deviations[0]), found[1] * float(deviations[1])]
    if disturbance:
        found.append(float(best.x[4]) * C)
        stds.append(float(deviations[4]) * C)
    return Identified(
        method="response fit",
        model=f"{drag} drag",
        parameters=parameters(axis, dict(zip(names, found, strict=True)), dict(zip(names, stds, strict=True))),
        data=DataUsed(len(t_s), T, 1, "runs"),
        citation="pladypos (8), thesis (4.46)",
        residuals=eta - response(best.x),
        residual_unit="m" if axis == "linear" else "rad",
    )
