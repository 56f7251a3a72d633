"""Which actuator does not give what it is commanded, from commands and measured poses: generalised likelihood ratios.

A Kalman filter (`marine.estimation.ekf`) follows the vessel with the wrench that sound actuators would give, and with
the disturbance as a slow random walk: a current. An actuator that fails pushes the filter's errors in a way that its
thrusts foretell, its signature (Willsky and Jones, A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems, IEEE Trans. Automatic Control 21, 1976). For each actuator and each of some times
at which it may have failed, the innovations are fitted by the signature: how much of the thrust is lost, and how much
likelier that is than that nothing failed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from marine.estimation.ekf import Array, EkfTuning, PoseEkf, Verdict
from marine.frames import to_body
from marine.vessel import HorizontalModel

_MOST = 1.1
"""Largest part of the thrust that a failure may take: 1, and an error of the characteristic."""
_BEFORE = 0.5
"""Weight of the evidence that an actuator had failed before: errors of the model look more like that."""
_AXES = 3
_ALL = slice(None)
_GATE = 1e4
"""Squared Mahalanobis distance beyond which a pose is not used: a failure surprises the filter more than noise does."""


@dataclass(frozen=True)
class FaultTuning:
    """What the filter believes, and when it speaks. `_walk` as in EkfTuning; `_error`: standard deviations, as parts.

    thrust_error: of each actuator's thrust; drag_error, inertia_error: of the model on each axis.
    """

    position_m: float = 0.0015
    heading_rad: float = 0.0025
    velocity_walk_m_s: float = 0.002
    yaw_rate_walk_rad_s: float = 0.003
    force_walk_n: float = 0.02
    moment_walk_nm: float = 0.0003
    thrust_error: float = 0.07
    drag_error: float = 0.2
    inertia_error: float = 0.1
    model_noise: float = 0.07
    """Part of thrust and drag by which the model errs besides, in another way every `model_noise_s`: a filter that
    trusts its model takes hard driving for failures."""
    model_noise_s: float = 1.0
    current_change_m_s: float = 0.02
    """How much the current differs within `model_noise_s`: the drag of a moving vessel does then."""
    window_s: float = 10.0
    """Longest time over which a failure is looked for, in `windows` steps of its beginning."""
    windows: int = 5
    guess_drag_error: float = 1.0
    guess_inertia_error: float = 0.7
    """These two of a model that is a guess, wrong by 2 or 3: of a vessel before its identification."""
    doubt: float = -3.0
    """Before anything is seen: logarithm of how much likelier the model is such a guess than nearly right."""
    most_doubt: float = 10.0
    """Beyond it, either way, nothing is learnt: what seems a bad model may be a strange current, and pass."""
    threshold: float = 12.0
    """Least logarithm of the likelihood ratio against nothing failed."""
    margin: float = 2.5
    """Least logarithm of the likelihood ratio against the next actuator."""
    clear: float = 6.0
    """Least logarithm of the likelihood ratio against a model that is a guess, and none failed."""
    confirm: int = 3
    """So many steps in a row must say the same."""
    least_loss: float = 0.4
    misfit: float = 2.5
    """Largest mean square of what the failure leaves unexplained, relative to the filter's (not so: a wall), or ..."""
    share: float = 0.8
    """... the least part of the innovations' squares that is explained."""
    surprise: float = 10.0
    """Mean square of the innovations, relative to the filter's, beyond which it begins anew: the model does not fit."""

    @classmethod
    def of_vessel(cls, model: HorizontalModel, columns: Sequence[Sequence[float]], most_n: Sequence[float]) -> Self:
        """Return the tuning for a vessel: the walks in proportion to what its actuators can do. Chosen on PlaDyPos.

        columns: see FaultDetector; most_n: largest thrust of each actuator.
        """
        X, Y, N = (sum(abs(c[axis]) * most for c, most in zip(columns, most_n, strict=True)) for axis in range(_AXES))
        force = max(X, Y)
        return cls(
            velocity_walk_m_s=0.02 * force / model.surge.alpha,
            yaw_rate_walk_rad_s=0.0015 * N / model.yaw.alpha,
            force_walk_n=0.008 * force,
            moment_walk_nm=0.0003 * N,
        )


@dataclass(frozen=True)
class Finding:
    """A failed actuator: its number, the part of its thrust that is lost, how sure (log likelihood ratio)."""

    actuator: int
    lost: float
    ratio: float


class FaultDetector:
    """The filter and its hypotheses at one moment.

    Besides the failures each window knows the signatures of what the model may be wrong about: the thrust of each
    actuator, drag and inertia of each axis. They have a Gaussian prior and are integrated out, so that a vessel that
    moves otherwise than its model is none with a failure. A failure must be likelier, too, than that the model is
    wrong by a factor, by what is seen now and was seen before. Columns: n losses of thrust that begin with the window,
    6 errors of the model, n actuators that do not follow since before: what they missed then is a disturbance that the
    filter has learnt, only what changes shows.
    """

    def __init__(
        self, model: HorizontalModel, columns: Sequence[Sequence[float]], tuning: FaultTuning = FaultTuning()
    ) -> None:
        """columns: [X Y N] of 1 N of each actuator, n x 3."""
        self.tuning = tuning
        self._axes = (model.surge, model.sway, model.yaw)
        self._model = model
        self._columns = np.array(columns, dtype=float).T
        self._columns_squared = np.square(self._columns)
        changes = (tuning.current_change_m_s, tuning.current_change_m_s, 0.0)  # a current does not turn
        kept = [2.0 * tuning.model_noise_s / axis.alpha**2 for axis in self._axes]
        self._noises = [
            (k * tuning.model_noise**2, k * change**2, axis.beta, 2.0 * axis.beta_quadratic)
            for axis, change, k in zip(self._axes, changes, kept, strict=True)
        ]
        """Of each axis: variance of acceleration by force and drag in N^2 or (Nm)^2, by their slope; drag's slope."""
        n = self._size = self._columns.shape[1]
        self.lost = np.zeros(n)
        """Part of each actuator's thrust that is known to be lost."""
        self.finding: Finding | None = None
        """The likeliest failure at the last step, sure or not; None without any sign of one."""
        self._ekf: PoseEkf | None = None
        self._ekf_tuning = replace(
            EkfTuning(),
            position_m=tuning.position_m,
            heading_rad=tuning.heading_rad,
            velocity_walk_m_s=tuning.velocity_walk_m_s,
            yaw_rate_walk_rad_s=tuning.yaw_rate_walk_rad_s,
            force_walk_n=tuning.force_walk_n,
            moment_walk_nm=tuning.moment_walk_nm,
            gate=_GATE,
        )
        errors = [tuning.thrust_error] * n + [tuning.drag_error] * _AXES + [tuning.inertia_error] * _AXES
        self._prior = np.diag(np.power(errors, -2.0))
        errors[n:] = [tuning.guess_drag_error] * _AXES + [tuning.guess_inertia_error] * _AXES
        self._priors = np.stack((np.diag(np.power(errors, -2.0)), self._prior))[:, None]
        """Of a model that is a guess, and of one nearly right: information about all columns but the last n."""
        self._prior_sizes = np.linalg.slogdet(self._priors)[1]
        self.doubt = tuning.doubt
        """Logarithm of how much likelier the model is a guess than nearly right, by all that was seen so far."""
        self._width = 2 * n + 2 * _AXES
        windows = tuning.windows
        self._effects = np.zeros((9 + _AXES, windows * self._width))
        self._error = self._effects[:9]
        """What each hypothesis does to the filter's state, those of one window after those of the other, ..."""
        self._pushes = self._effects[9:].reshape(_AXES, windows, self._width)
        """... and to its accelerations now: `_amounts` of the hypotheses, times what each unit of them does."""
        self._amounts = np.zeros((windows, self._width))
        inertia = np.array([[axis.alpha] for axis in self._axes])
        units = np.hstack((self._columns, np.eye(_AXES), np.eye(_AXES), self._columns))
        self._units = (-units / inertia)[:, None]
        self._transition = np.zeros((9, 9 + _AXES))
        """Of state and accelerations to the state."""
        self._information = np.zeros((windows, self._width, self._width))
        self._score = np.zeros((windows, self._width))
        self._energy, self._count = np.zeros(windows), np.zeros(windows)
        self._origin = np.zeros((windows, n))
        self._age_s, self._next, self._agreed, self._surprise = 0.0, 0, 0, 0.0

    def restart(self) -> None:
        """Forget the vessel, keep what is known to be lost: it was moved, or not seen for long."""
        self._ekf, self.finding, self._agreed, self._surprise = None, None, 0, 0.0

    def step(self, dt_s: float, thrusts: Sequence[float], x_m: float, y_m: float, psi_rad: float) -> Finding | None:
        """Take in a pose, and the mean thrusts in N as commanded since the pose before, dt_s (some 0.2 s) ago.

        Return a failure that is certain, once: from then on it counts as known.
        """
        commanded = np.array(thrusts)
        if self._ekf is None:
            self._ekf = PoseEkf(self._model, self._ekf_tuning, x_m, y_m, psi_rad)
            for window in range(self.tuning.windows):
                self._begin(window, commanded)
            return None
        self._predict(self._ekf, dt_s, commanded)
        if self._update(self._ekf, x_m, y_m, psi_rad) is Verdict.JUMPED:
            self.restart()
            return None
        self._age_s += dt_s
        if self._age_s >= self.tuning.window_s / self.tuning.windows:
            self._age_s = 0.0
            self._next = (self._next + 1) % self.tuning.windows
            self._learn(self._next)
            self._begin(self._next, commanded)
        before = self.finding
        self.finding, sure = self._likeliest()
        same = before is not None and self.finding is not None and before.actuator == self.finding.actuator
        self._agreed = (self._agreed + 1 if same else 1) if sure else 0
        if self.finding is None or self._agreed < self.tuning.confirm:
            if self._surprise > self.tuning.surprise and not self._agreed:
                self.restart()
            return None
        found = self.finding
        self.lost[found.actuator] = found.lost
        self.restart()  # what the estimate of the loss misses is no second failure
        return found

    def _begin(self, window: int, thrusts: Array) -> None:
        """Let a window ask for failures that begin now."""
        self._error.reshape(9, -1, self._width)[:, window] = 0.0
        self._information[window] = self._score[window] = 0.0
        self._energy[window] = self._count[window] = 0.0
        self._origin[window] = thrusts

    def _learn(self, window: int) -> None:
        """Remember what a window that ends tells of the model, unless it may come from a failure."""
        t, told = self.tuning, float(self._guessed(slice(window, window + 1))[0])
        if self.finding is None or told > 2.0 * self.finding.ratio:
            self.doubt = min(max(self.doubt + told / t.windows, -t.most_doubt), t.most_doubt)  # windows overlap

    def _guessed(self, windows: slice = _ALL) -> Array:
        """Return, of each window, how much likelier the model is a guess than nearly right, none failed: logarithms."""
        known = slice(0, -self._size)
        precision, score = self._information[windows, known, known] + self._priors, self._score[windows, known]
        explained = np.einsum("wi,mwi->mw", score, np.linalg.solve(precision, score[:, :, None])[..., 0])
        guess, right = 0.5 * (explained - np.linalg.slogdet(precision)[1] + self._prior_sizes)
        return np.asarray(guess - right)

    def _predict(self, ekf: PoseEkf, dt_s: float, thrusts: Array) -> None:
        n, amounts = self._size, self._amounts
        X, Y, N = tau = self._columns.dot(thrusts * (1.0 - self.lost)).tolist()
        _, _, psi, *nu = ekf.state
        drag = [axis.drag(speed) for axis, speed in zip(self._axes, nu, strict=True)]
        d_x, d_y, d_n = ekf.disturbance
        pushed = (*to_body(d_x, d_y, psi), d_n)
        F = ekf.predict(dt_s, (X, Y, N))
        for i, variance in enumerate(self._model_noise(thrusts, drag, nu), _AXES):
            ekf.covariance[i, i] += dt_s * variance
        accelerating = [force - lost + push for force, lost, push in zip(tau, drag, pushed, strict=True)]
        amounts[:, :n] = thrusts
        amounts[:, n:-n] = drag + accelerating
        amounts[:, -n:] = thrusts - self._origin
        np.multiply(self._units, amounts, out=self._pushes)
        step, h = self._transition, 0.5 * dt_s * dt_s
        step[:, :9] = F
        step[0, 9] = step[1, 10] = h * math.cos(psi)
        step[1, 9] = h * math.sin(psi)
        step[0, 10] = -step[1, 9]
        step[2, 11] = h
        step[3, 9] = step[4, 10] = step[5, 11] = dt_s
        self._error[:] = step.dot(self._effects)

    def _model_noise(self, thrusts: Array, drag: Sequence[float], nu: Sequence[float]) -> list[float]:
        """Return the variance that errors of the model add to each velocity per second. nu: speeds, m/s and rad/s."""
        squares = self._columns_squared.dot(np.square(thrusts)).tolist()
        return [
            of_forces * (square + force * force) + of_current * (beta + slope * abs(speed)) ** 2
            for (of_forces, of_current, beta, slope), square, force, speed in zip(
                self._noises, squares, drag, nu, strict=True
            )
        ]

    def _update(self, ekf: PoseEkf, x_m: float, y_m: float, psi_rad: float) -> Verdict:
        verdict = ekf.update(x_m, y_m, psi_rad)
        if verdict is not Verdict.USED:
            return verdict
        signature, shape = self._error[:3], (_AXES, *self._score.shape)
        weighted = ekf.weight.dot(signature)
        self._information += signature.reshape(shape).transpose(1, 2, 0) @ weighted.reshape(shape).transpose(1, 0, 2)
        self._score += np.dot(ekf.innovation, weighted).reshape(self._score.shape)
        self._surprise += 0.2 * (ekf.surprise / _AXES - self._surprise)
        self._energy += ekf.surprise
        self._count += 1.0
        self._error -= ekf.gain.dot(signature)
        return verdict

    def _likeliest(self) -> tuple[Finding | None, bool]:
        """Return the likeliest failure, and whether it is certain."""
        t, n = self.tuning, self._size
        own = np.maximum(self._information.diagonal(0, 1, 2), 1e-12)
        alone = np.square(np.maximum(self._score, 0.0)) / own
        alone[:, n:-n] = 0.0
        if alone.max() < t.threshold:  # 2 ln of the ratio if the model were exact: at most
            return None, False
        mean, precision, explained = self._marginal()
        loss = np.clip(mean, 0.0, _MOST)
        loss[:, 1] = 1.0  # of partial ones from before nothing certain can be said
        ratio = precision * (loss * mean - 0.5 * np.square(loss))
        spread = precision[:, 0] * t.thrust_error**2  # what a thrust within its error explains as well
        ratio[:, 0] -= 0.5 * np.square(mean[:, 0]) * precision[:, 0] * spread / (1.0 + spread)
        ratio[:, 1] *= _BEFORE
        ratio[loss < t.least_loss] = 0.0
        of_actuator = ratio.max(axis=(0, 1))
        best = int(of_actuator.argmax())
        window, kind = divmod(int(ratio[:, :, best].argmax()), 2)
        found = float(ratio[window, kind, best])
        if found <= 1.0:
            return None, False
        lost = min(1.0, float(loss[window, kind, best]))
        left = (self._energy[window] - 2.0 * (explained[window] + found)) / max(1.0, _AXES * self._count[window])
        others = max((float(x) for i, x in enumerate(of_actuator) if i != best), default=0.0)
        share = (explained[window] + found) / max(1e-12, 0.5 * self._energy[window])
        fits = left < t.misfit or share > t.share
        sure = found > t.threshold and found - others > t.margin and fits
        sure = sure and found - max(0.0, self.doubt + float(self._guessed().max())) > t.clear
        return Finding(best, lost, found), bool(sure)

    def _marginal(self) -> tuple[Array, Array, Array]:
        """Return what the data say of each loss, from now and before, in each window: mean and precision, (w, 2, n).

        The third is what errors of the model explain in each window, as a log likelihood ratio. They are integrated
        out; of a loss from now on, the prior of the error of that thrust is taken away again.
        """
        n = self._size
        known, before = slice(0, -n), slice(-n, None)
        covariance = np.linalg.inv(self._information[:, known, known] + self._prior)
        estimate = np.einsum("wij,wj->wi", covariance, self._score[:, known])
        variance = np.diagonal(covariance, axis1=1, axis2=2)[:, :n]
        now = np.maximum(1.0 / variance - self._prior[0, 0], 1e-12)
        now_mean = estimate[:, :n] / variance / now
        cross = self._information[:, before, known]
        told_by_others = np.einsum("wij,wjk,wik->wi", cross, covariance, cross)
        since = np.maximum(np.diagonal(self._information, axis1=1, axis2=2)[:, before] - told_by_others, 1e-12)
        since_mean = (self._score[:, before] - np.einsum("wij,wj->wi", cross, estimate)) / since
        explained = 0.5 * np.einsum("wi,wi->w", estimate, self._score[:, known])
        return np.stack((now_mean, since_mean), axis=1), np.stack((now, since), axis=1), explained
