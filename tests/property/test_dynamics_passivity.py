from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from marine.dynamics.integrate import State
from marine.dynamics.uncoupled import UncoupledModel
from services.vessels import load_vessel

MODEL = UncoupledModel(load_vessel("pladypos").model)
speed = st.floats(-1.0, 1.0)


@given(st.floats(-3.2, 3.2), speed, speed, st.floats(-4.0, 4.0))
def test_without_thrust_energy_only_falls(psi: float, u: float, v: float, r: float) -> None:
    state: State = (2.0, 1.5, psi, u, v, r)
    for _ in range(20):
        before, state = state, MODEL.step(state, 0.02, (0.0, 0.0, 0.0))
        assert MODEL.kinetic_energy(state) <= MODEL.kinetic_energy(before)


@given(st.tuples(speed, speed, st.floats(-4.0, 4.0)), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_energy_never_grows_faster_than_the_thrusters_work(nu: tuple[float, float, float], X: float, N: float) -> None:
    u, v, r = nu
    state: State = (2.0, 1.5, 0.4, u, v, r)
    _, _, _, *acceleration = MODEL.derivative(state, (X, 0.0, N))
    m = MODEL.model
    power = sum(
        dof.alpha * nu * a for dof, nu, a in zip((m.surge, m.sway, m.yaw), (u, v, r), acceleration, strict=True)
    )
    assert power <= X * u + N * r + 1e-12
