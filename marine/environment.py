"""What the surroundings do to a vessel: thesis 2.4, tau_E. Tether, wind with gusts, first-order waves."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from marine.dynamics.asv import GRAVITY_M_S2
from marine.frames import to_body
from marine.vessel import Tether

Pair = tuple[float, float]


def tether_wrench(tether: Tether, x_m: float, y_m: float, psi_rad: float) -> tuple[float, float, float]:
    """Return [X Y N] in {B}, N and Nm, of a cable that pulls towards its anchor as far as it is taut."""
    tied_x = x_m + tether.x_m * math.cos(psi_rad)
    tied_y = y_m + tether.x_m * math.sin(psi_rad)
    to_x, to_y = tether.anchor_x_m - tied_x, tether.anchor_y_m - tied_y
    distance = math.hypot(to_x, to_y)
    if distance <= tether.slack_m:
        return 0.0, 0.0, 0.0
    pull = tether.stiffness_n_m * (distance - tether.slack_m) / distance
    X, Y = to_body(pull * to_x, pull * to_y, psi_rad)
    return X, Y, tether.x_m * Y


AIR_KG_M3 = 1.225


@dataclass(frozen=True)
class Wind:
    """Wind in {E}: a mean, and gusts as a first-order Gauss-Markov process on each axis.

    drag_area_m2: C_D A of what stands above the water; lever_m: how far ahead of the origin of {B} the wind takes hold.
    """

    x_m_s: float = 0.0
    y_m_s: float = 0.0
    gust_std_m_s: float = 0.0
    gust_correlation_s: float = 5.0
    drag_area_m2: float = 0.0
    lever_m: float = 0.0


def wind_wrench(wind: Wind, velocity_m_s: Pair, psi_rad: float, u: float, v: float) -> tuple[float, float, float]:
    """Return [X Y N] in {B}, N and Nm: 1/2 rho C_D A |V| V of the air's velocity V relative to the vessel.

    velocity_m_s: of the air in {E}; u, v: of the vessel in {B}.
    """
    x, y = to_body(*velocity_m_s, psi_rad)
    x, y = x - u, y - v
    pressure = 0.5 * AIR_KG_M3 * wind.drag_area_m2 * math.hypot(x, y)
    return pressure * x, pressure * y, wind.lever_m * pressure * y


class GaussMarkov:
    """A first-order Gauss-Markov process on two axes, thesis 2.4: slowly varying current, gusts."""

    def __init__(self, std: float, correlation_s: float, dt_s: float, seed: int) -> None:
        self.value: Pair = (0.0, 0.0)
        self._std = std
        self._fading = math.exp(-dt_s / correlation_s)
        self._push = std * math.sqrt(1.0 - self._fading**2)
        self._random = random.Random(seed)

    def step(self) -> None:
        """Go on by dt_s."""
        if self._std:
            x, y = self.value
            gust = self._random.gauss
            self.value = (self._fading * x + gust(0.0, self._push), self._fading * y + gust(0.0, self._push))


@dataclass(frozen=True)
class Waves:
    """Long-crested waves: significant height, period of the spectrum's peak, where they run to in {E}.

    gamma: peak enhancement of the JONSWAP spectrum; 1 is Pierson-Moskowitz.
    """

    height_m: float
    period_s: float
    towards_rad: float = 0.0
    gamma: float = 3.3


class WaveField:
    """First-order waves on deep water as a sum of sines with the JONSWAP spectrum; a seed, the same waves again.

    Surface: zeta = sum a cos(k s - w t + e), w^2 = g k, s along the waves' direction. A hull of radius R feels the mean
    over its disc: each amplitude times 2 J1(k R) / (k R). Amplitudes are scaled so that 4 std(zeta) is the height.
    """

    _COMPONENTS = 24
    _BAND = (0.6, 3.0)
    """Frequencies in units of the peak's: 99 % of the energy, more where the tail is long."""

    def __init__(self, waves: Waves, radius_m: float, seed: int) -> None:
        chance = random.Random(seed)
        peak = math.tau / waves.period_s
        low, high = self._BAND
        width = (high - low) / self._COMPONENTS * peak
        omegas = [low * peak + (i + chance.random()) * width for i in range(self._COMPONENTS)]
        energies = [jonswap(w, peak, waves.gamma) for w in omegas]
        scale = waves.height_m / 4.0 * math.sqrt(2.0 / sum(energies))
        self.direction: Pair = (math.cos(waves.towards_rad), math.sin(waves.towards_rad))
        self.components = [
            (scale * math.sqrt(e), w, w * w / GRAVITY_M_S2, chance.uniform(0.0, math.tau))
            for w, e in zip(omegas, energies, strict=True)
        ]
        """(amplitude in m, frequency in rad/s, wave number in rad/m, phase in rad)"""
        self._felt = [(a * _mean_over_disc(k * radius_m), w, k, e) for a, w, k, e in self.components]

    def elevation(self, x_m: float, y_m: float, t_s: float) -> float:
        """Return how high the surface stands at a place in {E}, in m."""
        s = x_m * self.direction[0] + y_m * self.direction[1]
        return sum(a * math.cos(k * s - w * t_s + e) for a, w, k, e in self.components)

    def water(self, x_m: float, y_m: float, t_s: float, depth_m: float = 0.0) -> tuple[Pair, Pair]:
        """Return velocity in m/s and acceleration in m/s^2, in {E}, of the water that a hull takes the place of.

        Horizontal part of the orbits, w a cos(...) and w^2 a sin(...), both fading with depth as exp(-k z).
        """
        c, s = self.direction
        along = x_m * c + y_m * s
        speed = acceleration = 0.0
        for a, w, k, e in self._felt:
            phase = k * along - w * t_s + e
            part = w * a * math.exp(-k * depth_m)
            speed += part * math.cos(phase)
            acceleration += w * part * math.sin(phase)
        return (c * speed, s * speed), (c * acceleration, s * acceleration)


def jonswap(omega: float, peak: float, gamma: float) -> float:
    """Return the shape of the JONSWAP spectrum, without its scale (Hasselmann et al. 1973); rad/s."""
    sigma = 0.07 if omega <= peak else 0.09
    bump = math.exp(-((omega / peak - 1.0) ** 2) / (2.0 * sigma**2))
    return float(omega**-5 * math.exp(-1.25 * (peak / omega) ** 4) * gamma**bump)


def _mean_over_disc(kR: float) -> float:
    """Return 2 J1(kR) / (kR), by the power series: for hulls up to a wave's length."""
    if kR > 3.8317:  # the first zero of J1: shorter waves than that cancel over the hull
        return 0.0
    term = total = 1.0
    for m in range(1, 20):
        term *= -((kR / 2.0) ** 2) / (m * (m + 1))
        total += term
    return total
