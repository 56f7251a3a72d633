"""Practical model of small surface vessels with thrusters and rudders astern, thesis 2.5.3 (Charlie)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import STILL_WATER, UNDISTURBED, Tau, UncoupledModel
from marine.vessel import DegreeOfFreedom, HorizontalModel, SmallVesselModel


@dataclass(frozen=True)
class Stern:
    """Thrusters and rudders astern, thesis Fig. 2.6: lever d of a thruster, distance L of the rudders behind, m.

    offset_m: of the centre of mass from the middle line (Delta_d).
    """

    d_m: float
    L_m: float
    offset_m: float = 0.0

    def wrench(self, thrusts: tuple[float, float], rudder_forces: tuple[float, float], delta: float) -> Tau:
        """Return [X Y N] of port (1) and starboard (2), each a thruster with a rudder behind, thesis (2.35).

        thrusts, rudder_forces: N; delta: angle of both rudders, rad.
        """
        (p1, p2), (r1, r2) = thrusts, rudder_forces
        d, L, offset = self.d_m, self.L_m, self.offset_m
        s, c = math.sin(delta), math.cos(delta)
        return (
            p1 + p2 - (r1 + r2) * s,
            -(r1 + r2) * c,
            d * (p1 - p2) + offset * (p1 + p2) + (r1 + r2) * L * c + ((d - offset) * r2 - (d + offset) * r1) * s,
        )

    def equal_wrench(self, thrust: float, flow: float, delta: float) -> Tau:
        """Return [X Y N] when both thrusters and both small rudder angles are equal, thesis (2.37).

        thrust: a |n| n of one thruster, N; flow: k_r1 U^2 + k_r2 |n| n of one rudder (2.12), N/rad.
        """
        moment = self.offset_m * thrust + self.L_m * flow * delta
        return 2.0 * (thrust - flow * delta * delta), -2.0 * flow * delta, 2.0 * moment


class SmallVesselDynamics:
    """thesis (2.38) in SI with beta > 0 (it prints beta < 0), yaw parameters by n^2 as in (3.6).

    The wrench tau comes from the actuators ((2.35) or (2.37)): the rudder's part in surge is in it.
    """

    def __init__(self, model: SmallVesselModel) -> None:
        self.model = model
        self._settings = [point.n_squared for point in model.yaw]

    def yaw_at(self, n_squared: float) -> DegreeOfFreedom:
        """Return the yaw parameters at a thrust setting n^2 >= 0, interpolated; those of the nearest end outside."""
        points = self.model.yaw
        if n_squared <= points[0].n_squared:
            return points[0].yaw
        for low, high in pairwise(points):
            if n_squared <= high.n_squared:
                part = (n_squared - low.n_squared) / (high.n_squared - low.n_squared)
                return _between(low.yaw, high.yaw, part)
        return points[-1].yaw

    def at(self, n_squared: float) -> UncoupledModel:
        """Return the model at a constant thrust setting: thesis (3.6)."""
        m = self.model
        return UncoupledModel(HorizontalModel(m.surge, m.sway, self.yaw_at(n_squared)))

    def step(  # noqa: PLR0917 - as UncoupledModel.step, and the setting
        self,
        state: State,
        dt_s: float,
        tau: Tau,
        n_squared: float,
        current_m_s: tuple[float, float] = STILL_WATER,
        disturbance: Tau = UNDISTURBED,
    ) -> State:
        """Return the state dt_s later; tau in {B}, n_squared: mean squared command of the thrusters, both constant."""
        biased = (tau[0], tau[1], tau[2] + self.model.yaw_bias_nm * n_squared)
        return self.at(n_squared).step(state, dt_s, biased, current_m_s, disturbance)


def mean_square(commands: Sequence[float]) -> float:
    """Return the thrust setting n^2 of several thrusters: the mean of their squared commands."""
    return sum(n * n for n in commands) / len(commands)


def _between(low: DegreeOfFreedom, high: DegreeOfFreedom, part: float) -> DegreeOfFreedom:
    def mix(a: float, b: float) -> float:
        return a + part * (b - a)

    return DegreeOfFreedom(
        mix(low.alpha, high.alpha), mix(low.beta, high.beta), mix(low.beta_quadratic, high.beta_quadratic)
    )
