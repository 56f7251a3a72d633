"""Bad data are refused, or identified with a warning, and the reason and the remedy are named."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from marine.identification import harmonic, least_squares, self_oscillation, step, zigzag
from marine.identification.checks import sampled
from marine.identification.oscillation import Oscillation
from marine.identification.relay_loop import RelayLoop
from marine.identification.result import FloatArray, IdentificationError
from marine.vessel import DegreeOfFreedom

YAW = DegreeOfFreedom(0.0304, 0.0, 0.0689)


@pytest.fixture(scope="module")
def record() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(t, eta, nu, tau) of a relay experiment."""
    t, eta, tau = RelayLoop(YAW, 0.08, 0.35, sample_time_s=0.05).run(40.0)
    return t, eta[:, 0], np.gradient(eta[:, 0], t), tau[:, 0]


Record = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def test_the_good_record_passes_without_a_warning(record: Record) -> None:
    t, eta, nu, tau = record
    for found in (
        harmonic.project(t, eta, tau),
        self_oscillation.from_record(t[100:], eta[100:], tau[100:]),
        least_squares.uncoupled(t, tau, nu=nu, eta=eta),
    ):
        assert not found.warnings


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: np.where(np.arange(len(t)) >= 300, t + 3.0, t), "gap of 3.050 s at 14.950 s"),
        (lambda t: np.where(np.arange(len(t)) == 300, t[299], t), "twice the same at sample 300"),
        (lambda t: np.where(np.arange(len(t)) == 300, t[290], t), "going backward at sample 300"),
        (lambda t: np.where(np.arange(len(t)) == 300, np.nan, t), "not a number"),
    ],
)
def test_time_must_run(record: Record, change: Callable[[FloatArray], FloatArray], reason: str) -> None:
    t, eta, nu, tau = record
    broken = change(t)
    methods: tuple[Callable[[], object], ...] = (
        lambda: harmonic.project(broken, eta, tau),
        lambda: self_oscillation.from_record(broken, eta, tau),
        lambda: least_squares.uncoupled(broken, tau, nu=nu),
        lambda: zigzag.integrals(broken, eta, tau),
        lambda: step.type_0(broken, nu, 0.08, axis="angular"),
    )
    for method in methods:
        with pytest.raises(IdentificationError, match=reason):
            method()


def test_signals_must_be_there(record: Record) -> None:
    t, eta, nu, tau = record
    with pytest.raises(IdentificationError, match="eta is constant"):
        harmonic.project(t, 0.0 * eta, tau)
    with pytest.raises(IdentificationError, match="tau is constant"):
        least_squares.uncoupled(t, 0.0 * tau + 0.05, nu=nu)
    with pytest.raises(IdentificationError, match="eta has 799 samples, time has 800"):
        harmonic.project(t, eta[1:], tau)
    with pytest.raises(IdentificationError, match="nu is not a number at sample 5"):
        least_squares.uncoupled(t, tau, nu=np.where(np.arange(len(t)) == 5, np.inf, nu))
    with pytest.raises(IdentificationError, match="too few"):
        sampled(t[:5], eta=eta[:5])
    with pytest.raises(IdentificationError, match="neither velocity nu nor position"):
        least_squares.uncoupled(t, tau)


def test_degrees_are_found_out(record: Record) -> None:
    t, eta, nu, tau = record
    methods: tuple[Callable[[], object], ...] = (
        lambda: harmonic.project(t, np.degrees(eta), tau),
        lambda: self_oscillation.from_record(t, np.degrees(eta), tau),
        lambda: zigzag.integrals(t, np.degrees(eta), tau),
        lambda: least_squares.uncoupled(t, tau, nu=np.degrees(nu)),
        lambda: step.type_0(t, np.degrees(1.0 - np.exp(-t)), 0.08, axis="angular"),
    )
    for method in methods:
        with pytest.raises(IdentificationError, match="degrees"):
            method()
    slow = 0.05  # a ship: even in degrees its rate is small, but heading and rate then disagree
    with pytest.raises(IdentificationError, match="eta is some 57 times too large"):
        least_squares.uncoupled(t, tau, nu=slow * nu, eta=np.degrees(slow * eta))
    with pytest.raises(IdentificationError, match="nu is some 57 times too large"):
        least_squares.uncoupled(t, tau, nu=np.degrees(slow * nu), eta=slow * eta)
    with pytest.raises(IdentificationError, match="more than half a turn"):
        self_oscillation.from_record(10.0 * t, np.degrees(eta), tau)


def test_a_heading_that_wraps_is_refused(record: Record) -> None:
    t, eta, _, tau = record
    wrapped = (eta + 3.0 + np.pi) % (2.0 * np.pi) - np.pi
    with pytest.raises(IdentificationError, match=r"jumps by 6\.\d+ rad at sample \d+: use numpy.unwrap"):
        harmonic.project(t, wrapped, tau)
    assert harmonic.project(t, np.unwrap(wrapped), tau)["alpha"] == pytest.approx(0.0304, rel=0.01)


def test_a_wrong_sign_is_named(record: Record) -> None:
    t, eta, nu, tau = record
    with pytest.raises(IdentificationError, match="sign of tau or of the axis"):
        least_squares.uncoupled(t, -tau, nu=nu)
    with pytest.raises(IdentificationError, match="sign of tau or of the axis"):
        harmonic.project(t, eta, -tau)
    with pytest.raises(IdentificationError, match="wrong sign"):
        self_oscillation.from_record(t, -eta, tau)
    with pytest.raises(IdentificationError, match="eta falls while nu is positive"):
        least_squares.uncoupled(t, tau, nu=nu, eta=-eta)
    with pytest.raises(IdentificationError, match="sign of tau or of the axis"):
        zigzag.integrals(t, eta, -tau, disturbance=True)


def test_too_few_oscillations(record: Record) -> None:
    t, eta, _, tau = (x[:100] for x in record)
    for method in (harmonic.project, self_oscillation.from_record):
        with pytest.raises(IdentificationError, match="whole oscillations are too few"):
            method(t, eta, tau)
    assert "only" in harmonic.project(*(x[:250] for x in (record[0], record[1], record[3]))).warnings[0]


def test_no_self_oscillation() -> None:
    """Hysteresis above the amplitude, (7.12); a relay that chatters (Fig. 7.2) has none either."""
    with pytest.raises(IdentificationError, match="not below the amplitude"):
        self_oscillation.marine_parameters(Oscillation(1.0, 0.4, 0.3, 1.0))
    with pytest.raises(IdentificationError, match=r"with bias 0\.2"):
        self_oscillation.marine_parameters(Oscillation(1.0, 0.4, 0.5, 1.0, x_0=-0.2))


def test_saturation_is_said_and_ramps_are_no_relay(record: Record) -> None:
    t, eta, nu, tau = record
    assert "saturated in 100 %" in harmonic.project(t, eta, tau, tau_limit=0.08).warnings[0]
    assert "saturated" in least_squares.uncoupled(t, tau, nu=nu, tau_limit=0.07).warnings[0]
    ramps = np.convolve(tau, np.ones(20) / 20, mode="same")
    with pytest.raises(IdentificationError, match="no relay's"):
        self_oscillation.from_record(t, eta, ramps)


def test_a_steady_turn_cannot_tell_inertia(record: Record) -> None:
    t = record[0]
    nu = np.full(len(t), 0.5)
    nu[0] = 0.49
    tau = 0.0689 * nu**2
    with pytest.raises(IdentificationError):
        least_squares.uncoupled(t, tau, nu=nu)
