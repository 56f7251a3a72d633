import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from marine.frames import rotation, to_body, to_tank, wrap_angle

angles = st.floats(-50.0, 50.0)
components = st.floats(-100.0, 100.0)


@given(angles)
def test_a_wrapped_angle_is_the_same_direction_within_the_half_open_circle(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-12)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-12)


def test_both_ends_of_the_circle_are_plus_pi() -> None:
    assert [wrap_angle(k * math.pi) for k in (-3, -1, 1, 3)] == [math.pi] * 4
    assert wrap_angle(math.nextafter(-math.pi, 0.0)) < 0.0


@given(angles)
def test_rotation_is_orthogonal_and_proper(psi: float) -> None:
    R = rotation(psi)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert math.isclose(float(np.linalg.det(R)), 1.0, rel_tol=1e-12)


@given(components, components, angles)
def test_scalar_and_matrix_rotation_agree_and_undo_each_other(x: float, y: float, psi: float) -> None:
    x_e, y_e = to_tank(x, y, psi)
    assert np.allclose([x_e, y_e, 0.0], rotation(psi) @ [x, y, 0.0], atol=1e-10)
    assert np.allclose(to_body(x_e, y_e, psi), [x, y], atol=1e-10)


def test_a_quarter_turn_clockwise_points_the_bow_down_the_picture() -> None:
    assert np.allclose(to_tank(1.0, 0.0, math.pi / 2), [0.0, 1.0])
    assert np.allclose(to_tank(0.0, 1.0, math.pi / 2), [-1.0, 0.0])
