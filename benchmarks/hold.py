"""How well the vessel holds, against the simulator's truth: real processes, rendered camera, current and noise."""

from __future__ import annotations

import math
import time

from benchmarks.result import NotMeasured, Result
from benchmarks.running_star import RunningStar, wait_for
from bus.messages import SimulationTruth
from bus.service import RawSample
from bus.topics import SIMULATION_TRUTH
from marine.frames import wrap_angle

SETTLE_S = 25.0
WATCH_S = 30.0
STEP_S = 30.0
CURRENT = "[simulator]\ncurrent_x_m_s = 0.05\ncurrent_y_m_s = 0.0\ncurrent_std_m_s = 0.0\n"
PLACE = (1.8, 1.5, 0.5)
STEP_M = 1.0
BAND_M = 0.05


def measure() -> list[Result]:
    """Return root mean square errors while holding, and overshoot and settling time of a step of 1 m."""
    begin_s = time.monotonic()
    with RunningStar(CURRENT) as star:
        try:
            star.hold(*PLACE)
        except TimeoutError as error:
            raise NotMeasured(f"the vessel does not hold: {str(error).splitlines()[0]}") from None
        possible_s = time.monotonic() - begin_s
        heard: list[SimulationTruth] = []

        def hear(sample: RawSample) -> None:
            heard.append(SimulationTruth.decode(sample.payload))

        star.bus.subscribe(SIMULATION_TRUTH.key, hear)
        _pass(SETTLE_S)
        heard.clear()
        _pass(WATCH_S)
        held = list(heard)
        star.hold(PLACE[0] + STEP_M, PLACE[1], PLACE[2])
        heard.clear()
        _pass(STEP_S)
        moved = list(heard)
    if len(held) < WATCH_S * 10 or len(moved) < STEP_S * 10:
        raise NotMeasured("the simulator's truth did not arrive")
    overshoot, settled_s = step_figures([(t.stamp_ns * 1e-9, t.x_m) for t in moved], PLACE[0], PLACE[0] + STEP_M)
    return [
        Result(
            "hold_position_rms_mm",
            1e3 * _rms([math.hypot(t.x_m - PLACE[0], t.y_m - PLACE[1]) for t in held]),
            goal=10.0,
        ),
        Result("hold_heading_rms_deg", math.degrees(_rms([wrap_angle(t.psi_rad - PLACE[2]) for t in held])), goal=1.0),
        Result("step_1m_overshoot_percent", 100.0 * overshoot, goal=10.0),
        Result("step_1m_within_5cm_after_s", settled_s, goal=20.0),
        Result("start_to_holding_possible_s", possible_s, goal=5.0),
    ]


def step_figures(response: list[tuple[float, float]], start: float, end: float) -> tuple[float, float]:
    """Return (overshoot as part of the step, time in s until it stays within BAND_M) of a response (s, m)."""
    overshoot = max(0.0, *((x - end) / (end - start) for _, x in response))
    outside = [t for t, x in response if abs(x - end) > BAND_M]
    return overshoot, (max(outside) if outside else response[0][0]) - response[0][0]


def _rms(errors: list[float]) -> float:
    return math.sqrt(sum(e * e for e in errors) / len(errors))


def _pass(seconds: float) -> None:
    end_s = time.monotonic() + seconds
    wait_for(lambda: time.monotonic() > end_s, seconds + 1.0, "the measurement")
