"""Identification by fitting the simulated response to the recorded force: (4.46) for a force that is not constant.

Holding heading and sway takes a changing part of the thrusters, so a step on the running system is none of the books'.
A long record is fitted in pieces that each begin anew: over an hour the smallest disturbance adds up to a way that no
model has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marine.identification.checks import require_sign, sampled
from marine.identification.oscillation import reversals
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
from marine.identification.validation import advance

_LONG = 10_000
"""Samples of a record that is fitted in pieces of two periods each."""
_POINTS = 400
"""Points of a piece at least; of a long record without reversals ten times as many."""
_ITERATIONS = 60
_UNEXPLAINED = 0.5
"""Residuals of this part of the motion: that is no response to this force."""
_STEP = 1e-6
"""Change of a parameter for a slope; so small a step of the search is its end."""


@dataclass(frozen=True)
class _Pieces:
    """eta (m, rad) and force (N, Nm) of pieces of the record, shape (pieces, points) each, h_s apart."""

    eta: FloatArray
    force: FloatArray
    h_s: float


@dataclass
class _Fit:
    """Model [log alpha, log drag, Delta/C] and the velocity and position that each piece begins with."""

    theta: FloatArray
    nu_0: FloatArray
    eta_0: FloatArray


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
    dt_s = sampled(t_s, axis, eta=eta)
    if drag == "both":
        raise IdentificationError("fit one form of drag at a time")
    C, T = float(np.max(np.abs(tau))), float(t_s[-1] - t_s[0])
    if np.min(tau) >= 0.0 or np.max(tau) <= 0.0:
        require_sign(float(np.mean(tau)), float(eta[-1] - eta[0]))
    pieces = _pieces(np.asarray(eta, dtype=float), np.interp(t_s - delay_s, t_s, tau), dt_s)
    ahead = max(1, round(0.5 / pieces.h_s))
    nu = float(np.max(np.abs(pieces.eta[:, ahead:] - pieces.eta[:, :-ahead]))) / (ahead * pieces.h_s)
    guess = _Fit(
        np.array(
            [np.log(C * T / 3.0 / nu), np.log(C / nu if drag == "constant" else C / nu**2), 0.0][: 2 + disturbance]
        ),
        (pieces.eta[:, ahead] - pieces.eta[:, 0]) / (ahead * pieces.h_s),
        pieces.eta[:, 0].copy(),
    )
    if len(turns := reversals(tau)) > 2 and disturbance:
        guess.theta[0] = np.log(C / nu * float(np.median(np.diff(turns))) * dt_s / 3.0)
    best, residuals, deviations = _levenberg_marquardt(pieces, guess, drag, C)
    spread = np.sqrt(np.mean((pieces.eta - np.mean(pieces.eta, axis=1, keepdims=True)) ** 2))
    if np.sqrt(np.mean(residuals**2)) > _UNEXPLAINED * spread:
        raise IdentificationError("no response fits: is this the force that moved the vessel, with its right sign?")
    scales = np.array([*np.exp(best.theta[:2]), C][: len(best.theta)])
    names = ["alpha", *drag_of(drag), "delta"][: len(scales)]
    values = [*scales[:2].tolist(), *(best.theta[2:] * C).tolist()]
    return Identified(
        method="response fit",
        model=f"{drag} drag",
        parameters=parameters(
            axis, dict(zip(names, values, strict=True)), dict(zip(names, (deviations * scales).tolist(), strict=True))
        ),
        data=DataUsed(len(t_s), T, len(pieces.eta), "runs"),
        citation="pladypos (8), thesis (4.46)",
        residuals=residuals.ravel(),
        residual_unit="m" if axis == "linear" else "rad",
    )


def _pieces(eta: FloatArray, force: FloatArray, dt_s: float) -> _Pieces:
    """Return a short record as it is; a long one cut to two periods a piece, and thinned: means of the force."""
    n = len(eta)
    if n <= _LONG:
        return _Pieces(eta[None, :], force[None, :], dt_s)
    turns = reversals(force)
    length = min(n, 4 * int(np.median(np.diff(turns)))) if len(turns) > 8 else n
    thin = max(1, length // (_POINTS if length < n else 10 * _POINTS))
    points = length // thin
    count = n // (points * thin)
    used = slice(count * points * thin)
    means = force[used].reshape(count, points, thin).mean(axis=2)
    return _Pieces(eta[used].reshape(count, -1)[:, ::thin], means, thin * dt_s)


def _responses(pieces: _Pieces, fitted: _Fit, drag: Drag, C: float) -> tuple[FloatArray, FloatArray]:
    """Return the response, shape (pieces, points), and its slopes, (pieces, points, parameters + 1).

    Slopes are differences: of each parameter of the model, and of the velocity that a piece begins with.
    """
    p = len(fitted.theta)
    scale = max(float(np.max(np.abs(fitted.nu_0))), 1e-9)
    theta = np.tile(np.append(fitted.theta, np.zeros(3 - p)), (p + 2, 1))  # variants: as it is, each changed
    theta[np.arange(1, p + 1), np.arange(p)] += _STEP
    nu_0 = np.tile(fitted.nu_0, (p + 2, 1))
    nu_0[-1] += _STEP * scale
    alpha, beta = np.exp(np.clip(theta[:, :2, None], -30.0, 30.0)).transpose(1, 0, 2)
    zero = np.zeros_like(beta)
    constant, quadratic = (beta, zero) if drag == "constant" else (zero, beta)
    speed = nu_0
    speeds = np.empty((pieces.eta.shape[1], *nu_0.shape))
    for k, force in enumerate(pieces.force.T):
        speeds[k] = speed
        speed = advance(speed, force + C * theta[:, 2:], pieces.h_s, (alpha, constant, quadratic))
    way = np.zeros_like(speeds)
    np.cumsum(0.5 * pieces.h_s * (speeds[1:] + speeds[:-1]), axis=0, out=way[1:])
    response = way[:, 0].T
    slopes = ((way[:, 1:] - way[:, :1]) / _STEP).transpose(2, 0, 1)
    slopes[:, :, -1] /= scale
    return response + fitted.eta_0[:, None], slopes


def _levenberg_marquardt(pieces: _Pieces, fitted: _Fit, drag: Drag, C: float) -> tuple[_Fit, FloatArray, FloatArray]:
    """Return the best fit, its residuals and the standard deviations of theta.

    The two values that a piece begins with are its own: they are projected out (QR), so that the equations for the
    model stay few. Raises IdentificationError when nothing fits.
    """
    p, damping = len(fitted.theta), 1e-3
    response, slopes = _responses(pieces, fitted, drag, C)
    residuals = pieces.eta - response
    for _ in range(_ITERATIONS):
        own = np.stack([slopes[:, :, -1], np.ones_like(residuals)], axis=2)
        q, r = np.linalg.qr(own)
        model = slopes[:, :, :p] - q @ (q.transpose(0, 2, 1) @ slopes[:, :, :p])
        normal = np.einsum("snp,snq->pq", model, model)
        step = np.linalg.solve(
            normal + damping * np.diag(np.diag(normal) + 1e-300), np.einsum("snp,sn->p", model, residuals)
        )
        step = np.clip(step, -1.0, 1.0)
        left = (residuals - slopes[:, :, :p] @ step)[:, :, None]
        beginning = np.linalg.solve(r, q.transpose(0, 2, 1) @ left)[:, :, 0]
        tried = _Fit(fitted.theta + step, fitted.nu_0 + beginning[:, 0], fitted.eta_0 + beginning[:, 1])
        response, new_slopes = _responses(pieces, tried, drag, C)
        cost, new_cost = float(np.sum(residuals**2)), float(np.sum((pieces.eta - response) ** 2))
        if new_cost <= cost:
            fitted, residuals, slopes, damping = tried, pieces.eta - response, new_slopes, 0.1 * damping
        else:
            damping *= 10.0
        if np.max(np.abs(step)) < _STEP or abs(cost - new_cost) <= 1e-6 * cost:
            freedom = max(residuals.size - p - 2 * len(residuals), 1)
            covariance = np.linalg.pinv(normal) * min(cost, new_cost) / freedom
            return fitted, residuals, np.sqrt(np.diag(covariance))
    raise IdentificationError("no response fits: is this the force that moved the vessel, with its right sign?")
