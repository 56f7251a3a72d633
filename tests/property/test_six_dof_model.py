"""The full model: what physics demands of any vessel, and the plane as its special case."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from marine.dynamics.horizontal import CoupledDynamics, coupled_mass_matrix
from marine.dynamics.integrate import State
from marine.dynamics.six_dof import (
    SixDofDynamics,
    added_mass_coriolis,
    damping,
    inertia_tensor,
    mass_matrix,
    restoring,
    rigid_body_coriolis,
    rigid_body_matrix,
)
from marine.frames import body_velocities, euler_rates, jacobian, rotation, rotation_zyx
from marine.vessel import CoupledModel, SixDofModel

Array = NDArray[np.float64]
small = st.floats(-0.3, 0.3)
place = st.tuples(small, small, small)
velocity = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(np.array)
eta_values = st.tuples(small, small, small, st.floats(-3.0, 3.0), st.floats(-1.3, 1.3), st.floats(-3.0, 3.0)).map(
    np.array
)


@st.composite
def models(draw: st.DrawFn) -> SixDofModel:
    """A body of four masses anywhere: its inertia is physical by construction."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    masses, places = rng.uniform(1.0, 5.0, 4), rng.uniform(-0.5, 0.5, (4, 3))
    squares = places.T @ (masses[:, None] * places)
    inertia = np.trace(squares) * np.eye(3) - squares
    m = float(masses.sum())
    six = rng.uniform(0.0, 5.0, (3, 6))
    return SixDofModel(
        mass_kg=m,
        inertia_kg_m2=(*np.diag(inertia), -inertia[0, 1], -inertia[0, 2], -inertia[1, 2]),
        added=tuple(six[0]),
        drag=tuple(six[1]),
        drag_quadratic=tuple(six[2]),
        weight_n=9.81 * m,
        buoyancy_n=9.81 * m * rng.uniform(0.9, 1.1),
        r_g_m=tuple(masses @ places / m),
        r_b_m=draw(place),
    )


@given(models())
def test_the_mass_matrix_is_symmetric_and_positive_definite(model: SixDofModel) -> None:
    M = mass_matrix(model)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0.0
    assert np.linalg.eigvalsh(rigid_body_matrix(model)).min() > 0.0


@given(models(), velocity)
def test_coriolis_matrices_are_skew_and_do_no_work(model: SixDofModel, nu: Array) -> None:
    for C in (rigid_body_coriolis(model, nu), added_mass_coriolis(model, nu)):
        np.testing.assert_allclose(C, -C.T, atol=1e-12)
        assert nu @ C @ nu == pytest.approx(0.0, abs=1e-9)


@given(models(), velocity)
def test_coriolis_forces_are_the_printed_ones_with_the_errata(model: SixDofModel, nu: Array) -> None:
    m, (x, y, z), (u, v, w, p, q, r) = model.mass_kg, model.r_g_m, nu
    I_x, I_y, I_z, I_xy, I_xz, I_yz = model.inertia_kg_m2
    upper = [  # (2.20), the six columns of the right half; its block form is another matrix with the same product
        [m * (y * q + z * r), -m * (x * q - w), -m * (x * r + v)],
        [-m * (y * p + w), m * (z * r + x * p), -m * (y * r - u)],
        [-m * (z * p - v), -m * (z * q + u), m * (x * p + y * q)],
    ]
    a, b, c = I_z * r - I_yz * q - I_xz * p, I_yz * r + I_xy * p - I_y * q, I_x * p - I_xz * r - I_xy * q
    lower = [[0.0, a, b], [-a, 0.0, c], [-b, -c, 0.0]]
    printed = np.block([[np.zeros((3, 3)), np.array(upper)], [-np.array(upper).T, np.array(lower)]])
    np.testing.assert_allclose(rigid_body_coriolis(model, nu) @ nu, printed @ nu, atol=1e-9)
    A = added_mass_coriolis(model, nu)
    assert (A[4, 5], A[5, 4]) == pytest.approx((model.added[3] * p, -model.added[3] * p))  # K_pdot = -added
    assert (A[0, 5], A[0, 4]) == pytest.approx((-model.added[1] * v, model.added[2] * w))


@given(models(), velocity)
def test_damping_takes_energy(model: SixDofModel, nu: Array) -> None:
    assert nu @ damping(model, nu) >= 0.0


@given(models(), eta_values)
def test_restoring_forces_are_the_gradient_of_potential_energy(model: SixDofModel, eta: Array) -> None:
    dynamics, h = SixDofDynamics(model), 1e-5
    gradient = np.array(
        [
            (dynamics.energy(np.r_[eta + e, np.zeros(6)]) - dynamics.energy(np.r_[eta - e, np.zeros(6)])) / (2 * h)
            for e in h * np.eye(6)
        ]
    )
    np.testing.assert_allclose(restoring(model, eta), jacobian(eta).T @ gradient, atol=1e-6)


@given(models(), eta_values, velocity, velocity)
def test_power_is_that_of_the_actuators_less_the_drag(model: SixDofModel, eta: Array, nu: Array, tau: Array) -> None:
    dynamics = SixDofDynamics(model)
    power = nu @ (dynamics.M @ dynamics.acceleration(eta, nu, tau) + restoring(model, eta))
    assert power == pytest.approx(nu @ tau - nu @ damping(model, nu), abs=1e-8)


@settings(max_examples=10)
@given(models(), velocity)
def test_energy_is_kept_without_drag_and_never_created_with_it(model: SixDofModel, nu: Array) -> None:
    none = (0.0,) * 6
    free = SixDofDynamics(SixDofModel(**{**model.__dict__, "drag": none, "drag_quadratic": none}))
    braked = SixDofDynamics(model)
    start = np.r_[np.zeros(6), 0.3 * nu]
    kept = lost = start
    for _ in range(50):
        before = braked.energy(lost)
        kept, lost = free.step(kept, 0.005, np.zeros(6)), braked.step(lost, 0.005, np.zeros(6))
        assert braked.energy(lost) <= before + 1e-9
    scale = max(1.0, abs(free.energy(start)))
    assert free.energy(kept) == pytest.approx(free.energy(start), abs=1e-6 * scale)


@given(eta_values, velocity)
def test_kinematics_agree_with_rotation_matrices(eta: Array, nu: Array) -> None:
    phi, theta, psi = eta[3:]
    R = Rotation.from_euler("ZYX", [psi, theta, phi])
    np.testing.assert_allclose(rotation_zyx(phi, theta, psi), R.as_matrix(), atol=1e-12)
    h = 1e-6  # a small turn by nu_2 in {B}: the rates of the angles are those of J_2
    turned = (R * Rotation.from_rotvec(nu[3:] * h)).as_euler("ZYX")[::-1]
    turned_back = (R * Rotation.from_rotvec(-nu[3:] * h)).as_euler("ZYX")[::-1]
    rates = np.remainder(turned - turned_back + math.pi, 2 * math.pi) - math.pi
    np.testing.assert_allclose(euler_rates(phi, theta) @ nu[3:], rates / (2 * h), atol=1e-4)
    np.testing.assert_allclose(body_velocities(jacobian(eta) @ nu, eta), nu, atol=1e-9)


def test_level_kinematics_are_those_of_the_plane_and_vertical_ones_are_refused() -> None:
    J = jacobian(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.7]))
    np.testing.assert_allclose(J[np.ix_([0, 1, 5], [0, 1, 5])], rotation(0.7), atol=1e-15)
    with pytest.raises(ValueError, match="90 degrees"):
        euler_rates(0.0, math.pi / 2)


speed = st.floats(-1.0, 1.0)


@given(models(), st.tuples(speed, speed, speed, speed), st.tuples(speed, speed, speed), st.tuples(small, small))
def test_the_plane_is_the_full_model_without_heave_roll_and_pitch(
    model: SixDofModel, motion: tuple[float, ...], tau: tuple[float, float, float], current: tuple[float, float]
) -> None:
    psi, u, v, r = motion
    a, d, q = model.added, model.drag, model.drag_quadratic
    x_g, y_g, _ = model.r_g_m
    flat = SixDofModel(
        mass_kg=model.mass_kg,
        inertia_kg_m2=(*model.inertia_kg_m2[:4], 0.0, 0.0),  # symmetric about the plane
        added=a,
        drag=d,
        drag_quadratic=q,
        weight_n=0.0,
        buoyancy_n=0.0,
        r_g_m=(x_g, y_g, 0.0),
    )
    coupled = CoupledModel(
        mass_kg=model.mass_kg,
        inertia_kg_m2=float(inertia_tensor(model)[2, 2]),
        added_surge_kg=a[0],
        added_sway_kg=a[1],
        added_yaw_kg_m2=a[5],
        drag=(d[0], d[1], d[5]),
        drag_quadratic=(q[0], q[1], q[5]),
        x_g_m=x_g,
        y_g_m=y_g,
    )
    eta, nu = np.array([0, 0, 0, 0, 0, psi]), np.array([u, v, 0, 0, 0, r])
    full = SixDofDynamics(flat).derivative(
        np.r_[eta, nu], np.array([tau[0], tau[1], 0, 0, 0, tau[2]]), np.array([*current, 0.0])
    )
    plane = CoupledDynamics(coupled).derivative((0.0, 0.0, psi, u, v, r), tau, current)
    np.testing.assert_allclose(plane, full[[0, 1, 5, 6, 7, 11]], atol=1e-9)
    np.testing.assert_allclose(full[[8, 9, 10]], 0.0, atol=1e-9)


@given(st.tuples(speed, speed, speed), st.floats(-2.0, 2.0))
def test_the_coupled_model_creates_no_energy_even_with_cross_mass(nu: tuple[float, float, float], cross: float) -> None:
    model = CoupledModel(10.0, 2.0, 3.0, 6.0, 0.5, (1.0, 2.0, 0.3), (4.0, 5.0, 0.6), cross, 0.1, -0.05)
    state: State = (0.0, 0.0, 0.4, *nu)
    acceleration = np.array(CoupledDynamics(model).derivative(state, (0.7, -0.4, 0.2))[3:])
    power = np.array(nu) @ coupled_mass_matrix(model) @ acceleration
    work = np.dot(nu, (0.7, -0.4, 0.2))
    drag = sum((b + q * abs(n)) * n * n for b, q, n in zip(model.drag, model.drag_quadratic, nu, strict=True))
    assert power == pytest.approx(work - drag, abs=1e-9)
