"""One step of any model of `marine.dynamics`, behind one interface: what `Vessel.dynamics` says is what runs."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from marine.allocation import Wrench
from marine.dynamics.asv import AsvDynamics
from marine.dynamics.horizontal import CoupledDynamics
from marine.dynamics.integrate import State
from marine.dynamics.six_dof import SixDofDynamics
from marine.dynamics.small_vessel import SmallVesselDynamics
from marine.dynamics.uncoupled import UncoupledModel
from marine.vessel import AsvModel, CoupledModel, Dynamics, HorizontalModel, SixDofModel, SmallVesselModel

Pair = tuple[float, float]

AT_THE_SURFACE: State = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""[z phi theta] (m, rad; {E}) and [w p q] (m/s, rad/s; {B}): what the horizontal state leaves out."""


class Plant(Protocol):
    """A model as the world runs it."""

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        """Return [x y psi u v r] and [z phi theta w p q] dt_s later, by one Runge-Kutta step; angles not wrapped.

        What acts meanwhile: tau [X Y Z K M N] in {B} in N and Nm; the water's velocity in {E}; n_squared, the mean
        squared command of the thrusters, for thesis (2.38).
        """
        ...


class _Uncoupled:
    def __init__(self, model: HorizontalModel) -> None:
        self._model = UncoupledModel(model)
        self._dives = model.heave is not None

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        X, Y, Z, _, _, N = tau
        level = self._model.step(level, dt_s, (X, Y, N), water_m_s)
        return level, self._heave(upright, dt_s, Z) if self._dives else upright

    def _heave(self, upright: State, dt_s: float, Z: float) -> State:
        """z' = w and (2.31) by one Runge-Kutta step; w feels nothing of z."""
        z, phi, theta, w, p, q = upright
        slope, h = self._model.heave_acceleration, 0.5 * dt_s
        a = slope(w, Z)
        b = slope(w + h * a, Z)
        c = slope(w + h * b, Z)
        d = slope(w + dt_s * c, Z)
        z += dt_s * (w + dt_s / 6.0 * (a + b + c))
        return z, phi, theta, w + dt_s / 6.0 * (a + 2.0 * (b + c) + d), p, q


class _Coupled:
    def __init__(self, model: CoupledModel) -> None:
        self._model = CoupledDynamics(model)

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        X, Y, _, _, _, N = tau
        return self._model.step(level, dt_s, (X, Y, N), water_m_s), upright


class _SixDof:
    def __init__(self, model: SixDofModel) -> None:
        self._model = SixDofDynamics(model)

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        x, y, psi, u, v, r = level
        z, phi, theta, w, p, q = upright
        state = np.array([x, y, z, phi, theta, psi, u, v, w, p, q, r])
        current = np.array([*water_m_s, 0.0])
        after = self._model.step(state, dt_s, np.array(tau), current)
        x, y, z, phi, theta, psi, u, v, w, p, q, r = after.tolist()
        return (x, y, psi, u, v, r), (z, phi, theta, w, p, q)


class _Small:
    def __init__(self, model: SmallVesselModel) -> None:
        self._model = SmallVesselDynamics(model)

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        X, Y, _, _, _, N = tau
        return self._model.step(level, dt_s, (X, Y, N), n_squared, water_m_s), upright


class _Asv:
    """asv (3), (4) knows neither sway nor forces in N: moving water carries the vessel along."""

    def __init__(self, model: AsvModel) -> None:
        self._model = AsvDynamics(model)

    def step(
        self, level: State, upright: State, dt_s: float, tau: Wrench, water_m_s: Pair, *, n_squared: float
    ) -> tuple[State, State]:
        x, y, psi, u, _, r = level
        c_x, c_y = water_m_s
        ahead = max(0.0, u - math.cos(psi) * c_x - math.sin(psi) * c_y)
        x, y, psi, U, r = self._model.step((x, y, psi, ahead, r), dt_s, tau[0], tau[5])
        x, y = x + dt_s * c_x, y + dt_s * c_y
        c, s = math.cos(psi), math.sin(psi)
        return (x, y, psi, U + c * c_x + s * c_y, c * c_y - s * c_x, r), upright


def plant_of(dynamics: Dynamics) -> Plant:
    """Return the model that a vessel file names, ready to run."""
    match dynamics:
        case HorizontalModel():
            return _Uncoupled(dynamics)
        case CoupledModel():
            return _Coupled(dynamics)
        case SixDofModel():
            return _SixDof(dynamics)
        case SmallVesselModel():
            return _Small(dynamics)
        case AsvModel():
            return _Asv(dynamics)
