"""The self-oscillation experiment of thesis Fig. 6.4 in simulation: a relay around one degree of freedom.

For prediction before an experiment and for the examples of the thesis; the whole vessel is simulated by
`services.simulator`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from marine.identification.result import FloatArray
from marine.vessel import DegreeOfFreedom


@dataclass(frozen=True)
class RelayLoop:
    """alpha nu' + beta(nu) nu = tau + delta, eta' = nu, tau = relay(reference - eta) after a delay.

    C: relay output, x_a: hysteresis (infinite: a step of C), delta: disturbance, one value or one for every run, shape
    (runs,). disturbance: what comes on top of delta, from time in s and eta (runs,), held for a sample. reference: of
    eta; sample_time_s: the relay looks at eta (with quantisation and noise) once in this time and holds tau; delay_s:
    from relay to motion.
    """

    vessel: DegreeOfFreedom
    C: float | FloatArray
    x_a: float | FloatArray
    delta: float | FloatArray = 0.0
    reference: float = 0.0
    delay_s: float = 0.0
    sample_time_s: float = 0.01
    quantisation: float = 0.0
    noise: float = 0.0
    disturbance: Callable[[float, FloatArray], FloatArray] | None = None

    def run(
        self, duration_s: float, *, runs: int = 1, seed: int = 0, steps: int = 10
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (t, eta, tau): times (n,), measured positions and relay outputs (n, runs); deterministic by seed.

        Starts at rest at eta = 0 with tau = +C. steps: Runge-Kutta steps in a sample; the delay is rounded to these.
        """
        rng = np.random.default_rng(seed)
        n, h = round(duration_s / self.sample_time_s), self.sample_time_s / steps
        lag = round(self.delay_s / h)
        pending: list[FloatArray] = [np.zeros(runs)] * lag
        position, nu = np.zeros(runs), np.zeros(runs)
        offset = rng.uniform(-0.5, 0.5, runs) * self.quantisation
        tau = np.full(runs, self.C, dtype=float)
        eta_out, tau_out = np.empty((n, runs)), np.empty((n, runs))
        for i in range(n):
            eta = position + self.noise * rng.standard_normal(runs) if self.noise else position
            if self.quantisation:
                eta = np.round((eta + offset) / self.quantisation) * self.quantisation - offset
            e = self.reference - eta
            tau = np.where(e >= self.x_a, self.C, np.where(e <= -self.x_a, -self.C, tau))
            eta_out[i], tau_out[i] = eta, tau
            other = self.delta + (self.disturbance(i * self.sample_time_s, position) if self.disturbance else 0.0)
            for _ in range(steps):
                pending.append(tau)
                position, nu = self._step(position, nu, pending.pop(0) + other, h)
        return np.arange(n, dtype=float) * self.sample_time_s, eta_out, tau_out

    def _step(self, eta: FloatArray, nu: FloatArray, tau: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
        v = self.vessel
        force = tau / v.alpha

        def rate(nu: FloatArray) -> FloatArray:
            return force - (v.beta + v.beta_quadratic * np.abs(nu)) * nu / v.alpha

        a = rate(nu)
        b = rate(nu + 0.5 * h * a)
        c = rate(nu + 0.5 * h * b)
        d = rate(nu + h * c)
        return eta + h * (nu + h / 6.0 * (a + b + c)), nu + h / 6.0 * (a + 2.0 * (b + c) + d)
