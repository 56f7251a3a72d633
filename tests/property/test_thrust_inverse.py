"""Each characteristic and its inverse are exact, alone and with limits, dead zone and whole commands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marine.actuators import Drive, Side, ThrustCurve
from marine.actuators.rudder import angle, force
from marine.allocation.steering import Steering
from marine.vessel import (
    AffineThrust,
    AsymmetricThrust,
    Characteristic,
    QuadraticLinearThrust,
    QuadraticThrust,
    Thruster,
)

coefficients = st.floats(1e-4, 50.0)
commands = st.floats(-200.0, 200.0).filter(lambda n: n == 0.0 or abs(n) > 1e-6)
characteristics = st.one_of(
    st.builds(QuadraticThrust, coefficients),
    st.builds(AffineThrust, coefficients, coefficients),
    st.builds(AsymmetricThrust, coefficients, coefficients, coefficients, coefficients),
    st.builds(QuadraticLinearThrust, coefficients, st.floats(0.1, 50.0), coefficients),
)
curves = st.one_of(
    st.builds(lambda a, b, c, d: ThrustCurve(Side(a, b), Side(c, d)), *[coefficients] * 4),
    st.builds(lambda a, b, k, s: ThrustCurve(Side(a, b, k, s), Side(a, 0.0, k, s)), *[coefficients] * 4),
    st.builds(lambda b: ThrustCurve.affine(0.0, b), coefficients),
    st.builds(ThrustCurve.quadratic, coefficients),
)


@given(curves, commands)
def test_inverse_of_the_thrust_is_the_command(curve: ThrustCurve, n: float) -> None:
    flat = abs(curve.thrust(n)) / curve.forward.slope if curve.forward.slope else 0.0  # rounding of a flat line
    assert curve.command(curve.thrust(n)) == pytest.approx(n, rel=1e-12, abs=1e-15 * flat)


@given(coefficients, coefficients, st.floats(-3.0, 3.0), st.floats(-500.0, 500.0).filter(lambda t: abs(t) > 1e-6))
def test_inverse_in_moving_water_gives_the_thrust_that_was_asked_for(
    t_nn: float, t_nu: float, u_a: float, thrust_n: float
) -> None:
    curve = ThrustCurve.bilinear(t_nn, t_nu, u_a)
    n = curve.command(thrust_n)
    assert curve.thrust(n) == pytest.approx(thrust_n, rel=1e-9, abs=1e-9 * t_nu**2 * u_a**2 / t_nn)
    assert n * thrust_n > 0.0  # the branch that drives


@given(
    characteristic=characteristics,
    part=st.floats(-1.5, 1.5),
    n_max=st.integers(1, 30),
    backward=st.floats(0.0, 1.0),
    dead_zone=st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.7]),
    integer=st.booleans(),
)
def test_no_other_command_is_nearer_in_thrust(
    *, characteristic: Characteristic, part: float, n_max: int, backward: float, dead_zone: float, integer: bool
) -> None:
    n_min = -float(round(n_max * backward))
    limits = {"n_max": float(n_max), "n_min": n_min, "integer": integer, "dead_zone": dead_zone}
    drive = Drive(Thruster("t", 0.0, 0.0, 0.0, characteristic, **limits))  # type: ignore[arg-type]
    most = max(drive.upper, -drive.lower)
    n = drive.command(part * most)
    assert n_min <= n <= n_max
    assert not integer or n == int(n)
    assert n == 0.0 or abs(n) > dead_zone
    error = abs(drive.thrust(n) - part * most)
    rivals = range(int(n_min), n_max + 1) if integer else np.linspace(n_min, n_max, 61)
    assert error <= min(abs(drive.thrust(float(rival)) - part * most) for rival in rivals) + 1e-9 * most


@given(st.floats(-1.0, 1.0), st.floats(0.01, 9.0), coefficients, st.floats(0.05, 1.5))
def test_rudder_angle_is_the_inverse_up_to_the_stall(part: float, flow: float, c_f: float, stall: float) -> None:
    delta = 0.999 * part * stall
    assert angle(force(delta, flow, c_f, stall), flow, c_f, stall) == pytest.approx(delta, abs=1e-6)


steerings = st.builds(
    Steering,
    st.floats(-20.0, 0.0),
    st.floats(1.0, 50.0),
    st.floats(0.0, 20.0),
    st.floats(0.05, 1.2),
    st.floats(0.3, 4.0),
    st.floats(0.1, 0.7),
)


@given(steerings, st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 2.0))
def test_propeller_and_rudder_attain_what_some_command_gives(
    steering: Steering, part: float, turn: float, U: float
) -> None:
    X, _, N = steering.forces(part * steering.upper, turn * steering.delta_max, U)
    thrust, delta = steering.solve(X, N, U)
    got_X, _, got_N = steering.forces(thrust, delta, U)
    reach = steering.forces(steering.upper, steering.delta_max, U)[2]
    assert got_X == pytest.approx(X, abs=1e-5 * steering.upper)
    assert got_N == pytest.approx(N, abs=1e-6 * reach + 1e-12)


@given(steerings, st.floats(-90.0, 90.0), st.floats(-90.0, 90.0), st.floats(0.0, 2.0))
def test_no_command_of_propeller_and_rudder_is_nearer(steering: Steering, X: float, N: float, U: float) -> None:
    thrust, delta = steering.solve(X, N, U)
    if N == 0.0:  # nobody wants to turn: the rudder stays straight and is not used as a brake
        assert delta == 0.0
        return
    assert steering.lower <= thrust <= steering.upper
    assert abs(delta) <= steering.delta_max
    most = steering.forces(steering.upper, steering.delta_max, U)[2]
    span = max(steering.upper, -steering.lower)

    def cost(t: float, d: float) -> float:
        x, _, n = steering.forces(t, d, U)
        return ((x - X) / span) ** 2 + (10.0 * (n - N) / most) ** 2

    found = cost(thrust, delta)
    for t in np.linspace(steering.lower, steering.upper, 15):
        for d in np.linspace(-steering.delta_max, steering.delta_max, 15):
            assert found <= cost(float(t), float(d)) * (1.0 + 1e-9) + 1e-9
