"""Whatever the vessel and the relay: what was simulated is identified again."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marine.identification import describing_function as df
from marine.identification import harmonic, prediction, self_oscillation, step
from marine.identification.oscillation import Oscillation
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import Drag
from marine.vessel import DegreeOfFreedom


@settings(max_examples=15, deadline=None)
@given(
    alpha=st.floats(0.01, 100.0),
    k=st.floats(0.02, 2.0),
    C=st.floats(0.1, 50.0),
    share=st.floats(-0.3, 0.3),
    drag=st.sampled_from(["constant", "linear"]),
)
def test_projection_of_any_relay_experiment(alpha: float, k: float, C: float, share: float, drag: Drag) -> None:
    """k: drag against inertia; x_a is 0.3 rad; the disturbance is a share of C."""
    x_a = 0.3
    omega = np.sqrt(C / (alpha * x_a))  # its order of magnitude
    beta, name = (k * alpha * omega, "beta") if drag == "constant" else (k * alpha / x_a, "beta_quadratic")
    dof = DegreeOfFreedom(alpha, beta, 0.0) if drag == "constant" else DegreeOfFreedom(alpha, 0.0, beta)
    expected = prediction.oscillation(dof, C, x_a)
    if expected.omega is None:
        return  # heavy constant drag: the amplitude does not reach the hysteresis
    loop = RelayLoop(dof, C, x_a, share * C, sample_time_s=0.015 / expected.omega)
    t, eta, tau = loop.run(60.0 / expected.omega, steps=1)
    found = harmonic.project(t, eta[:, 0], tau[:, 0], drag=drag, axis="linear")
    assert found["alpha"] == pytest.approx(alpha, rel=0.02)
    assert found[name] == pytest.approx(beta, rel=0.02)
    assert found["delta"] == pytest.approx(share * C, abs=0.01 * C)


@given(alpha=st.floats(0.01, 100.0), beta=st.floats(0.01, 100.0), ratio=st.floats(1.05, 5.0), delay=st.floats(0.0, 0.3))
def test_table_6_3_inverts_the_describing_function(alpha: float, beta: float, ratio: float, delay: float) -> None:
    """An oscillation that satisfies (5.17) for alpha and beta gives them back, whatever the delay."""
    x_a = 0.2
    gain = df.relay(1.0, x_a, ratio * x_a).gain
    omega = 1.3
    scale = df.with_delay(gain, omega, delay)
    p = self_oscillation.marine_parameters(Oscillation(1.0, x_a, ratio * x_a, omega), delay)
    assert complex(p["alpha"] * omega**2, -p["beta"] * omega) == pytest.approx(scale)
    assert p["beta_quadratic"] == pytest.approx(3.0 * pi / 8.0 * p["beta"] / (ratio * x_a * omega))


@settings(max_examples=25, deadline=None)
@given(
    alpha=st.floats(0.1, 100.0), beta=st.floats(0.05, 50.0), tau=st.floats(0.1, 100.0), sign=st.sampled_from([1, -1])
)
def test_whole_fit_of_any_step(alpha: float, beta: float, tau: float, sign: int) -> None:
    t = np.linspace(0.0, 2.5 * step.time_constant(tau, alpha, beta, "linear"), 400)
    eta = step.position_response(t, sign * tau, alpha, beta, "linear", eta_0=0.3)
    found = step.fit_response(t, sign * tau, eta=eta)
    assert (found["alpha"], found["beta_quadratic"]) == pytest.approx((alpha, beta), rel=1e-3)
