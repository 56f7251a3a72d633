"""Distance keeping: the filter of thesis Table 8.2, laws (8.41)-(8.44), Algorithm 8.5 from end to end."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.distance_keeping import VIDEORAY, Wall, blind_errors, identified_surge, identified_yaw, keep
from marine.control.distance import DistanceKeeping
from marine.control.model_function import bessel
from marine.estimation.distance_ekf import DistanceEkf, DistanceTuning
from marine.vessel import DegreeOfFreedom

SURGE, YAW = VIDEORAY.model.surge, VIDEORAY.model.yaw


def test_the_printed_matrices_are_in_degrees_and_centimetres() -> None:
    ekf = DistanceEkf(SURGE, YAW, DistanceTuning())
    cm, degree = 0.01, math.radians(1.0)
    units = np.array([cm, degree, degree, degree, cm, degree, cm])
    assert np.sqrt(np.diag(ekf.covariance)) == pytest.approx(math.sqrt(1000.0) * units)
    before = ekf.covariance
    ekf.predict(0.1, 0.0, 0.0)
    added = ekf.covariance - before
    assert added[0, 0] == pytest.approx(0.1 * cm**2)  # at rest drag has no derivative
    assert added[6, 6] == pytest.approx(0.1 * cm**2)


def test_one_step_of_table_8_2() -> None:
    """Its equations line by line (corrected: abs(u) u, v_phi of k-1, v_phi in both angles), with H1 of (8.39)."""
    ekf, T, X, N = DistanceEkf(SURGE, YAW, DistanceTuning()), 0.1, 1.2, 0.05
    u, r, phi, psi, d, v_phi, v_d = start = np.array([-0.2, 0.3, 0.4, 1.0, 0.6, 0.01, -0.02])
    ekf.state = start.copy()
    ekf.predict(T, X, N)
    predicted = np.array(
        [
            u - T * SURGE.beta_quadratic / SURGE.alpha * abs(u) * u + T / SURGE.alpha * X,
            r - T * YAW.beta_quadratic / YAW.alpha * abs(r) * r + T / YAW.alpha * N,
            phi + T * r + T * v_phi,
            psi + T * r + T * v_phi,
            d - T * u * math.cos(phi) + T * v_d,
            v_phi,
            v_d,
        ]
    )
    assert ekf.state == pytest.approx(predicted, abs=1e-12)
    P, y = ekf.covariance.copy(), np.array([0.35, 1.1, 0.62])
    H = np.eye(7)[[2, 3, 4]]
    R = np.diag([0.5 * math.radians(1.0) ** 2, 10.0 * math.radians(1.0) ** 2, 0.1 * 0.01**2])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    ekf.update(phi_rad=y[0], psi_rad=y[1], distance_m=y[2])
    assert ekf.state == pytest.approx(predicted + K @ (y - H @ predicted), abs=1e-9)
    assert ekf.covariance == pytest.approx((np.eye(7) - K @ H) @ P, abs=1e-9)


def test_the_jacobian_8_38_corrected_is_the_derivative_of_the_prediction() -> None:
    """The covariance's own propagation shows A: with P0 = I and Q = 0, P = A A^T."""
    nothing = DistanceTuning((0.0,) * 7, (1.0,) * 7)
    start = np.array([0.2, -0.3, 0.4, 1.0, 0.6, 0.01, -0.02])

    def predicted(state: np.ndarray) -> np.ndarray:
        ekf = DistanceEkf(SURGE, YAW, nothing)
        ekf.state = state.copy()
        ekf.predict(0.1, 1.0, 0.05)
        return ekf.state

    h = 1e-6
    A = np.column_stack([(predicted(start + h * e) - predicted(start - h * e)) / (2 * h) for e in np.eye(7)])
    ekf = DistanceEkf(SURGE, YAW, nothing)
    ekf.state, ekf.covariance = start.copy(), np.eye(7)
    ekf.predict(0.1, 1.0, 0.05)
    assert ekf.covariance == pytest.approx(A @ A.T, abs=1e-8)
    assert A[4, 2] == pytest.approx(0.1 * 0.2 * math.sin(0.4))  # u sin(phi) in the column of phi


def test_missing_measurements_have_no_row() -> None:
    """One with an enormous variance says the same as none; what is no number counts as missing."""
    one, other, blind = (DistanceEkf(SURGE, YAW) for _ in range(3))
    other._noise[[0, 2]] = 1e12
    one.update(psi_rad=1.0)
    other.update(psi_rad=1.0, phi_rad=0.3, distance_m=4.0)
    assert one.state == pytest.approx(other.state, abs=1e-9)
    state, covariance = blind.state.copy(), blind.covariance.copy()
    blind.update(phi_rad=math.nan, distance_m=math.inf)
    assert (blind.state == state).all()
    assert (blind.covariance == covariance).all()


def test_compass_and_angle_may_pass_half_a_turn() -> None:
    ekf = DistanceEkf(SURGE, YAW)
    for k in range(40):
        ekf.predict(0.1, 0.0, 0.0)
        ekf.update(psi_rad=math.remainder(3.0 + 0.02 * k, 2.0 * math.pi))
    assert abs(math.remainder(float(ekf.state[3]) - 3.78, 2.0 * math.pi)) < 0.05


def test_the_gains_are_8_43_and_8_44() -> None:
    """d falls by a push forward, so (8.42) needs the minus of the errata: too far means forward."""
    a1, a2, a3 = a = bessel(3, 0.4)
    keeping = DistanceKeeping(SURGE, YAW, a, a, 1e3, 1e3)
    u, phi, r = 0.05, 0.2, 0.1
    keeping.drive(0.1, 0.5, 0.5, phi, u)
    keeping.steer(0.1, phi, r)
    # one step of time later, everything else alike: only the integral has moved
    first, second = keeping.drive(0.0, 0.5, 0.7, phi, u), keeping.drive(0.1, 0.5, 0.7, phi, u)
    assert second - first == pytest.approx(SURGE.alpha / a3 * 0.2 * 0.1)
    assert first == pytest.approx(a1 / a3 * SURGE.alpha * 0.2)
    closing, drag = u * math.cos(phi), SURGE.beta_quadratic * u * math.cos(phi)
    faster = keeping.drive(0.0, 0.5, 0.7, phi, 0.0)
    assert second - faster == pytest.approx(-(a2 / a3 * SURGE.alpha - drag) * closing, rel=1e-6)
    turned = [keeping.steer(dt, phi, r) for dt in (0.0, 0.1)]
    assert turned[1] - turned[0] == pytest.approx(-YAW.alpha / a3 * phi * 0.1)


def test_the_loop_of_the_distance_follows_its_model_function() -> None:
    """A step on the true model without sensors: (8.42), (8.44) give G = 1/(a3 s^3 + a2 s^2 + a1 s + 1)."""
    from scipy.signal import step

    a1, a2, a3 = a = bessel(3, 0.4)
    keeping = DistanceKeeping(SURGE, YAW, a, a, 1e3, 1e3)
    d, u, dt, got = 0.6, 0.0, 0.005, []
    keeping.drive(dt, d, d, 0.0, u)
    for _ in range(6000):
        X = keeping.drive(dt, 0.5, d, 0.0, u)
        u += dt * (X - SURGE.drag(u)) / SURGE.alpha
        d -= dt * u
        got.append((0.6 - d) / 0.1)
    _, expected = step(([1.0], [a3, a2, a1, 1.0]), T=np.arange(1, 6001) * dt)
    assert np.abs(np.array(got) - expected).max() < 0.02


@pytest.fixture(scope="module")
def identified() -> tuple[DegreeOfFreedom, DegreeOfFreedom]:
    """(surge, yaw) from steps I to III of Algorithm 8.5."""
    yaw = identified_yaw()
    return identified_surge(yaw), yaw


def test_algorithm_8_5_identifies_both_degrees_of_freedom(identified: tuple[DegreeOfFreedom, DegreeOfFreedom]) -> None:
    surge, yaw = identified
    assert yaw.alpha == pytest.approx(YAW.alpha, rel=0.05)
    assert yaw.beta_quadratic == pytest.approx(YAW.beta_quadratic, rel=0.05)
    assert surge.alpha == pytest.approx(SURGE.alpha, rel=0.15)
    assert surge.beta_quadratic == pytest.approx(SURGE.beta_quadratic, rel=0.35)  # laser at 2 Hz, every tenth lost


def test_algorithm_8_5_keeps_distance_and_angle(identified: tuple[DegreeOfFreedom, DegreeOfFreedom]) -> None:
    """Behaviour of Fig. 8.16: ramp and step, the tether pulling."""
    log = keep(Wall(3), *identified, 90.0, lambda t: 0.7 - 0.01 * min(max(t - 20.0, 0.0), 20.0) - 0.05 * (t >= 60.0))
    true, wanted, estimated = map(np.array, (log.true_m, log.reference, log.estimated_m))
    off = np.abs(true - wanted)
    assert off[550:600].max() < 0.03
    assert off[850:].max() < 0.03
    assert true[600:].min() > 0.45 - 0.03
    assert np.abs(estimated - true)[100:].max() < 0.03
    assert np.abs(log.phi_true[150:]).max() < math.radians(10.0)  # 1 degree of noise, compass in steps of 2
    assert np.abs(np.array(log.u) - np.array(log.u_true))[100:].max() < 0.06


def test_algorithm_8_5_from_end_to_end_with_rendered_pictures() -> None:
    """Self-oscillations of yaw (compass) and surge (dots in pictures), design, 0.5 m kept, 5 s without dots."""
    yaw = identified_yaw()
    surge = identified_surge(yaw, pictures=True)
    assert surge.alpha == pytest.approx(SURGE.alpha, rel=0.15)
    assert surge.beta_quadratic == pytest.approx(SURGE.beta_quadratic, rel=0.35)
    log = keep(Wall(4, pictures=True), surge, yaw, 55.0, lambda _: 0.5, lambda t: 45.0 <= t < 50.0)
    off = np.abs(np.array(log.true_m) - 0.5)
    assert off[300:450].max() < 0.03
    assert off[450:].max() < 0.05


def test_five_seconds_without_the_laser_in_a_constant_current(
    identified: tuple[DegreeOfFreedom, DegreeOfFreedom],
) -> None:
    """Fig. 8.17, and issue 7: at most 5 cm."""
    errors = [
        error
        for drift in (0.0, 0.01, 0.02)
        for error in blind_errors(*identified, drift_m_s=drift, tether=False, runs=4)
    ]
    assert max(errors) < 0.05


def test_five_seconds_without_the_laser_on_the_tether(identified: tuple[DegreeOfFreedom, DegreeOfFreedom]) -> None:
    """A constant force is not what v_d means: the vessel at rest has no damping. It has a state of its own."""
    errors = blind_errors(*identified, drift_m_s=0.0, tether=True, runs=4)
    assert max(errors) < 0.05


def test_without_a_force_the_filter_is_that_of_table_8_2() -> None:
    printed, more = DistanceEkf(SURGE, YAW), DistanceEkf(SURGE, YAW, DistanceTuning(initial_force_n2=0.04))
    assert (printed.state.shape, more.state.shape) == ((7,), (8,))
    for ekf in (printed, more):
        for k in range(300):
            ekf.predict(0.1, 0.1, 0.0)
            ekf.update(psi_rad=0.0, **({"phi_rad": 0.0, "distance_m": 0.5} if k % 5 == 0 else {}))
    assert more.state[7] < -0.01  # it is pushed and does not move: a part of that is a force, the rest a current
    assert 0.0 < more.surge_m_s < printed.surge_m_s
