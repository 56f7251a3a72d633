"""Control laws: the time of a step, and how many random designs are unstable within and without the bounds."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.result import Result
from bus.messages import HelmState, WallState, WayPoint
from marine.allocation import axis_limits
from marine.control.base import ZERO, Reference
from marine.control.laws import known_laws
from marine.control.model_function import bessel
from marine.control.stability import drag_bound
from marine.guidance.reference_filter import ReferenceFilter
from services.controller import ControllerConfig
from services.guidance import Guidance, Seen, Tools, guidance_for
from services.tuning import horizontal_limits
from services.vessels import load_vessel

Array = NDArray[np.float64]

CASES = 1000
STEPS = 20_000
MODES: tuple[tuple[str, Literal["direct", "indirect", "line_of_sight"]], ...] = (
    ("pladypos", "direct"),
    ("videoray", "direct"),
    ("charlie", "direct"),
    ("charlie", "indirect"),
    ("charlie", "line_of_sight"),
)
"""Vessels, and how one that steers only follows a line."""


def measure() -> list[Result]:
    """Return the time of a control step of each law, and the share of unstable designs."""
    results = [
        Result(f"control_step_{name}_p99_us", step_us(name), {"p50": step_us(name, 50.0)}, goal=100.0)
        for name in known_laws()
    ]
    return [
        *results,
        *(Result(f"control_step_{mode}_p99_us", us, goal=100.0) for mode, us in mode_steps_us().items()),
        Result(
            "unstable_designs_within_bounds_percent",
            100.0 * unstable_share(CASES, within=True),
            {
                "without_bounds": 100.0 * unstable_share(CASES, within=False),
                "without_limiter_steps_to_50": 100.0 * unstable_share(CASES, within=False, largest_step=50.0),
                "within_bounds_steps_to_50": 100.0 * unstable_share(CASES, within=True, largest_step=50.0),
            },
            goal=0.0,
        ),
    ]


def step_us(name: str, percent: float = 99.0, steps: int = STEPS) -> float:
    vessel = load_vessel("pladypos")
    reach = axis_limits(vessel)
    law = known_laws()[name].for_vessel(known_laws()[name].Parameters(), vessel, (reach[0], reach[1], reach[5]))
    eta, nu = (1.0, 1.0, 3.1), (0.1, -0.05, 0.3)
    law.follow(eta, nu, ZERO)
    times = []
    reference = Reference((1.5, 0.7, -3.0), (0.1, 0.0, 0.2), (0.01, 0.0, 0.1))
    for _ in range(steps):
        begin = time.perf_counter()
        law.step(0.033, reference, eta, nu, (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0))
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.percentile(times, percent))


def mode_steps_us(steps: int = 2000, percent: float = 99.0) -> dict[str, float]:
    """Return vessel and law of helm/state (of lines also how) -> time of a step of the guidance, us."""
    found: dict[str, float] = {}
    for name, line in MODES:
        vessel, config = load_vessel(name), ControllerConfig(line=line)
        limits = horizontal_limits(vessel)
        motion = config.reference_filter.motion(vessel, limits)
        law = config.build("ipd", vessel, limits) if "Y" in vessel.controlled else None
        tools = Tools(vessel, limits, law, motion, ReferenceFilter(motion), config, config.steering)
        laws = guidance_for(tools)[0]
        del laws["depth"]  # the stick's: heave is a loop of its own beside all modes
        for kind, guidance in laws.items():
            how = f"_{line}" if kind == "path" and law is None else ""
            found[f"{name}_{kind}{how}"] = _guidance_us(guidance, kind, steps, percent)
    return found


def _guidance_us(guidance: Guidance, law: str, steps: int, percent: float) -> float:
    points = tuple(WayPoint(x_m=x, y_m=y) for x, y in ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0)))
    order = HelmState(
        mode="path", status="armed", law=law, x_m=2.0, y_m=1.0, psi_rad=1.0, speed_m_s=0.2, distance_m=0.5,
        points=points if law == "path" else (), request_id="1",
    )  # fmt: skip
    wall = WallState(status="tracking", distance_m=0.6, angle_rad=0.1, surge_m_s=0.02, yaw_rad_s=0.01)
    eta, nu, given = (1.5, 1.1, 0.2), (0.1, -0.05, 0.1), (0.2, 0.0, 0.01)
    seen = Seen(0.0, eta, nu, given, ZERO, (0.1, 0.0, 0.0), (True, True, True), 0.0, wall)
    guidance.engage(order, seen)
    guidance.step(order, seen)
    seen, times = replace(seen, dt_s=0.033), []
    for _ in range(steps):
        begin = time.perf_counter()
        guidance.step(order, seen)
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.percentile(times, percent))


def unstable_share(cases: int, *, within: bool, seed: int = 1, largest_step: float = 10.0) -> float:
    """Return the share of random I-PD designs whose step response grows, on vessels unlike the identified ones.

    Half of the vessels have constant drag, half linear drag; identified drag is wrong by up to 20 %, inertia by up to
    10 %, steps go up to step * beta_nunu / alpha = largest_step, actuators have no limits. within: w0 satisfies (8.23)
    and the limiter is set to (8.27); otherwise neither is minded.
    """
    rng = np.random.default_rng(seed)
    w0 = 10.0 ** rng.uniform(-1.0, 0.5, cases)
    alpha = 10.0 ** rng.uniform(-1.0, 2.0, cases)
    linear = np.arange(cases) % 2 == 1
    bound = drag_bound(bessel(3, 1.0)) * w0  # of beta / alpha, in 1/s
    ratio = bound * (rng.uniform(0.0, 1.0, cases) if within else 10.0 ** rng.uniform(-0.5, 0.5, cases))
    beta = np.where(linear, 0.0, ratio * alpha)
    beta_quadratic = np.where(linear, alpha * 10.0 ** rng.uniform(-1.0, 1.0, cases), 0.0)
    size = np.where(linear, 10.0 ** rng.uniform(-1.0, np.log10(largest_step), cases) * alpha, 1.0)
    step = np.where(linear, size / np.where(linear, beta_quadratic, 1.0), 1.0)
    limit = bound * alpha / np.where(linear, beta_quadratic, np.inf) if within else np.full(cases, np.inf)
    limit = np.where(linear, limit, np.inf)
    true = (
        alpha / (1.0 + rng.uniform(-0.1, 0.1, cases)),
        beta / (1.0 + rng.uniform(-0.2, 0.2, cases)),
        beta_quadratic / (1.0 + rng.uniform(-0.2, 0.2, cases)),
    )
    return float(np.mean(_grows(w0, (alpha, beta, beta_quadratic), true, step, limit)))


def _grows(
    w0: Array, identified: tuple[Array, Array, Array], true: tuple[Array, Array, Array], step: Array, limit: Array
) -> NDArray[np.bool_]:
    """Simulate all loops at once as `marine.control.single_loop` does; whether the error is larger late than before."""
    a1, a2, a3 = bessel(3, 1.0)
    alpha, beta, beta_quadratic = identified
    k_i, k_p, k_d = alpha / (a3 / w0**3), a1 / a3 * w0**2 * alpha, a2 / a3 * w0 * alpha
    # The fastest time constant is the vessel's own: the drag may be three times the bound.
    fastest = np.maximum(w0, (true[1] + true[2] * 2.0 * step * w0) / true[0])
    dt = 0.2 / fastest
    eta, nu, integral = np.zeros_like(w0), np.zeros_like(w0), np.zeros_like(w0)
    t, worst = np.zeros_like(w0), np.zeros((3, len(w0)))
    duration = 45.0
    with np.errstate(over="ignore", invalid="ignore"):
        while np.any(t * w0 < duration):
            error = step - eta
            integral += dt * error
            tau = k_i * integral - k_p * eta - k_d * nu + (beta + beta_quadratic * np.minimum(np.abs(nu), limit)) * nu
            middle = nu + 0.5 * dt * (tau - (true[1] + true[2] * np.abs(nu)) * nu) / true[0]
            eta = eta + dt * middle
            nu = nu + dt * (tau - (true[1] + true[2] * np.abs(middle)) * middle) / true[0]
            t += dt
            third = np.minimum(2, (3.0 * t * w0 / duration).astype(int))
            here = third, np.arange(len(w0))
            worst[here] = np.maximum(worst[here], np.where(np.isfinite(eta), np.abs(error) / step, np.inf))
    grows: NDArray[np.bool_] = (worst[2] > 1.05 * worst[1]) & (worst[2] > 0.01) | ~np.isfinite(eta)
    return grows
