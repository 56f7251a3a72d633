"""Controller and allocator around a model vessel, with a helm reduced to its switch."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest

from bus import topics
from bus.config import ConfigError, parse
from bus.memory_bus import MemoryBus
from bus.messages import ActuatorCommand, ControlStatus, HelmState, HelmWrench, Mode, NavigationState, Wrench
from bus.service import Input, Output, Service
from marine.actuators import Drive
from marine.allocation import allocation_matrix
from marine.dynamics.uncoupled import UncoupledModel
from marine.frames import wrap_angle
from marine.vessel import DegreeOfFreedom
from services.allocator import Allocator, AllocatorConfig
from services.controller import Controller, ControllerConfig, ReferenceFilterConfig
from services.vessels import load_vessel
from tests.star import build_star

PLADYPOS = load_vessel("pladypos")


class Water(Service):
    """The vessel in a current, and an ideal estimator; drag acts on the velocity through the water."""

    name = "estimator"
    rate_hz = 30.0
    command = Input(topics.ACTUATOR_COMMAND)
    state = Output(topics.NAVIGATION_STATE)

    def __init__(self, psi_rad: float) -> None:
        self.state6 = (1.0, 1.0, psi_rad, 0.0, 0.0, 0.0)
        self.current = (0.0, 0.0)
        self.disturbance_x_n: float | None = None
        self.status: Literal["tracking", "lost"] = "tracking"
        self._model = UncoupledModel(PLADYPOS.model)
        self._B = allocation_matrix(PLADYPOS.thrusters)[[0, 1, 5]]
        self._drives = {t.name: Drive(t) for t in PLADYPOS.thrusters}

    def step(self, now_s: float) -> None:
        message = self.command.latest
        thrusts = [d.thrust(message.commands[name]) if message else 0.0 for name, d in self._drives.items()]
        surge, sway, yaw = (self._B @ thrusts).tolist()
        x, y, psi, u, v, r = self._model.step(self.state6, 1.0 / 30.0, (surge, sway, yaw), self.current)
        self.state6 = (x, y, wrap_angle(psi), u, v, r)
        self.state.publish(
            NavigationState(
                status=self.status,
                x_m=x,
                y_m=y,
                psi_rad=self.state6[2],
                surge_m_s=u,
                sway_m_s=v,
                yaw_rad_s=r,
                measurement_age_s=0.0,
                disturbance_x_n=self.disturbance_x_n,
                origin_ns=round(now_s * 1e9),
            )
        )


class Switch(Service):
    """Passes the controller's wrench on in `hold`, and one of its own in `manual`."""

    name = "helm"
    rate_hz = 20.0
    control = Input(topics.CONTROL_WRENCH, max_age_s=0.25, wakes=True)
    wrench = Output(topics.HELM_WRENCH)
    state = Output(topics.HELM_STATE)

    def __init__(self) -> None:
        self.mode: Mode = "stop"
        self.suspended = False
        self.manual = Wrench(surge_n=0.0, sway_n=0.0, yaw_nm=0.0)
        self.reference = (1.0, 1.0, 0.3)

    def step(self, now_s: float) -> None:
        x_m, y_m, psi_rad = self.reference
        law = "positioning" if self.mode == "hold" else ""
        self.state.publish(
            HelmState(
                mode=self.mode, status="armed", suspended=self.suspended, law=law, x_m=x_m, y_m=y_m, psi_rad=psi_rad
            )
        )
        control = self.control.fresh(now_s)
        source = control if self.mode == "hold" and not self.suspended else self.manual
        if source is not None:
            self.wrench.publish(
                HelmWrench(mode=self.mode, surge_n=source.surge_n, sway_n=source.sway_n, yaw_nm=source.yaw_nm)
            )


class Loop:
    def __init__(self, *, json: bool = False, psi_rad: float = 0.3, config: ControllerConfig | None = None) -> None:
        self.bus = MemoryBus(json=json)
        self.water, self.helm = Water(psi_rad), Switch()
        self.demands: list[Wrench] = []
        self.statuses: list[ControlStatus] = []
        self.bus.tap(topics.CONTROL_WRENCH, self.demands.append)
        self.bus.tap(topics.CONTROL_STATUS, self.statuses.append)
        for service in (
            Allocator(AllocatorConfig(), PLADYPOS),
            Controller(config or ControllerConfig(), PLADYPOS),
            self.helm,
            self.water,
        ):
            self.bus.add(service)

    def hold(self, x_m: float, y_m: float, psi_rad: float) -> None:
        self.helm.mode, self.helm.reference = "hold", (x_m, y_m, psi_rad)

    def record(self, seconds: float) -> list[tuple[float, float, float, float]]:
        """Let time pass; return (seconds since now, x, y, psi) at 30 Hz."""
        track: list[tuple[float, float, float, float]] = []
        start_s = self.bus.now_s
        while self.bus.now_s < start_s + seconds:
            self.bus.run_for(1.0 / 30.0)
            x, y, psi, *_ = self.water.state6
            track.append((self.bus.now_s - start_s, x, y, psi))
        return track


UNFILTERED = ReferenceFilterConfig(enabled=False)
CURRENTS = [(0.0, 0.0), (0.05, 0.0), (0.0, -0.05)]


@pytest.mark.parametrize("current", CURRENTS)
@pytest.mark.parametrize("distance", [1.0, 2.0])
@pytest.mark.parametrize(
    "config",
    [
        ControllerConfig(),
        ControllerConfig(reference_filter=UNFILTERED),
        ControllerConfig(positioning="lqr"),
    ],
    ids=["ipd", "ipd, steps as they are", "lqr"],
)
def test_a_step_overshoots_little_and_arrives(
    current: tuple[float, float], distance: float, config: ControllerConfig
) -> None:
    loop = Loop(config=config)
    loop.water.current = current
    loop.hold(1.0, 1.0, 0.3)
    loop.record(25.0)
    loop.hold(1.0 + distance, 1.0, 0.3)
    track = loop.record(30.0)
    assert max(x for _, x, _, _ in track) - 1.0 <= 1.02 * distance
    assert max(t for t, x, _, _ in track if abs(x - 1.0 - distance) > 0.05) <= 20.0
    rest = track[-150:]
    assert max(math.hypot(x - 1.0 - distance, y - 1.0) for _, x, y, _ in rest) < 0.01
    assert max(abs(psi - 0.3) for *_, psi in rest) < math.radians(1.0)


@pytest.mark.parametrize(("start", "turn"), [(0.3, 1.5), (3.0, 1.0), (-3.0, -2.5)])
def test_turning_goes_the_short_way_and_leaves_the_place(start: float, turn: float) -> None:
    loop = Loop(psi_rad=start)
    loop.water.current = (0.15, 0.0)
    loop.hold(1.0, 1.0, start)
    loop.record(40.0)
    loop.hold(1.0, 1.0, wrap_angle(start + turn))
    track = loop.record(30.0)
    turned = [wrap_angle(psi - start) * math.copysign(1.0, turn) for *_, psi in track]
    assert min(turned) > -0.05
    assert max(turned) <= 1.10 * abs(turn)
    # The current is held against in {E}: nothing has to be integrated anew in the turn.
    assert max(math.hypot(x - 1.0, y - 1.0) for _, x, y, _ in track) < 0.012
    assert abs(turned[-1] - abs(turn)) < math.radians(1.0)


def test_integral_stays_bounded_and_tells_the_disturbance() -> None:
    loop = Loop(config=ControllerConfig(reference_filter=UNFILTERED))
    loop.water.current = (0.05, 0.0)
    loop.hold(3.0, 1.0, 0.3)
    loop.record(60.0)
    held = [s.integral_x_n for s in loop.statuses if s.integral_x_n is not None]
    assert max(map(abs, held)) < 12.0
    assert any(s.saturated for s in loop.statuses)
    # at rest over ground the compensation knows of no drag: the integral holds all of that of 0.05 m/s
    assert held[-1] == pytest.approx(-PLADYPOS.model.surge.drag(0.05), abs=0.02)


def test_taking_over_from_manual_does_not_jump() -> None:
    loop = Loop()
    loop.helm.mode, loop.helm.manual = "manual", Wrench(surge_n=1.2, sway_n=-0.3, yaw_nm=0.1)
    loop.record(3.0)
    assert not loop.demands
    loop.hold(2.0, 2.0, -1.0)
    loop.record(0.2)
    first = loop.demands[0]
    assert (first.surge_n, first.sway_n, first.yaw_nm) == pytest.approx((1.2, -0.3, 0.1), abs=1e-6)
    steps = zip(loop.demands, loop.demands[1:], strict=False)
    assert max(abs((b.surge_n or 0.0) - (a.surge_n or 0.0)) for a, b in steps) < 0.25


def test_suspended_it_goes_on_demanding_what_is_attained() -> None:
    loop = Loop()
    loop.hold(2.0, 1.0, 0.3)
    loop.record(2.0)
    loop.helm.suspended = True
    loop.record(1.0)
    loop.demands.clear()
    loop.record(5.0)
    assert len(loop.demands) >= 140
    assert all(d.vector() == pytest.approx((0.0,) * 6, abs=1e-9) for d in loop.demands)
    assert not loop.statuses[-1].in_charge
    loop.helm.suspended = False
    loop.demands.clear()
    loop.record(0.5)
    assert loop.statuses[-1].in_charge
    assert max(abs(part) for part in loop.demands[0].vector()) < 0.1
    track = loop.record(30.0)
    assert math.hypot(track[-1][1] - 2.0, track[-1][2] - 1.0) < 0.01


def test_without_a_usable_pose_or_helm_it_is_silent() -> None:
    loop = Loop()
    loop.hold(1.2, 1.0, 0.3)
    loop.record(1.0)
    assert loop.demands
    assert loop.demands[-1].origin_ns is not None
    for silence in ("lost", "estimator", "helm"):
        if silence == "lost":
            loop.water.status = "lost"
        else:
            loop.water.status = "tracking"
            loop.bus.pause(silence)
        loop.record(1.5)
        loop.demands.clear()
        loop.record(1.0)
        assert not loop.demands, silence
        assert not loop.statuses[-1].in_charge
        loop.water.status = "tracking"
        if silence != "lost":
            loop.bus.resume(silence)
        loop.record(0.5)
        assert loop.demands, silence


def test_status_comes_five_times_a_second() -> None:
    loop = Loop()
    loop.hold(1.0, 1.0, 0.3)
    loop.record(1.0)
    loop.statuses.clear()
    loop.record(10.0)
    assert 45 <= len(loop.statuses) <= 55


def test_objects_and_json_give_the_same_bits() -> None:
    finals, commands = [], []
    for json in (False, False, True):
        loop = Loop(json=json)
        loop.water.current = (0.03, -0.02)
        sent: list[ActuatorCommand] = []
        loop.bus.tap(topics.ACTUATOR_COMMAND, sent.append)
        loop.hold(2.0, 1.5, 2.0)
        loop.record(10.0)
        finals.append(loop.water.state6)
        commands.append([tuple(c.commands.values()) for c in sent])
    assert finals[0] == finals[1] == finals[2]
    assert commands[0] == commands[1] == commands[2]


def test_displaced_by_half_a_metre_it_comes_back() -> None:
    for heading in (0.0, 1.0, -2.5):
        loop = Loop(psi_rad=heading)
        loop.hold(1.0, 1.0, heading)
        loop.record(5.0)
        loop.water.state6 = (1.3, 0.6, heading, 0.0, 0.0, 0.0)
        track = loop.record(20.0)
        assert max(t for t, x, y, _ in track if math.hypot(x - 1.0, y - 1.0) > 0.05) <= 15.0


def test_without_an_integral_the_estimators_disturbance_is_fed_forward() -> None:
    places: dict[float | None, float] = {}
    pushed = PLADYPOS.model.surge.drag(0.05)
    for disturbance in (None, pushed):
        loop = Loop(config=ControllerConfig(positioning="p_d"))
        loop.water.current = (0.05, 0.0)
        loop.water.disturbance_x_n = disturbance
        loop.hold(1.0, 1.0, 0.3)
        loop.record(30.0)
        places[disturbance] = loop.water.state6[0] - 1.0
    assert places[None] > 4e-3
    assert abs(places[pushed]) < 0.5 * places[None]


@pytest.mark.parametrize(
    ("section", "says"),
    [
        ({"positioning": "pid"}, "no law is called 'pid'; known: ipd, lqr, p_d"),
        ({"laws": {"ipd": {"w0": 0.5}}}, "ipd.w0: no such key; known: model_function, w0_rad_s"),
        ({"laws": {"ipd": {"w0_rad_s": -1.0}}}, "w0 must be positive"),
        ({"laws": {"ipd": {"model_function": "1,1,2"}}}, "not stable"),
        ({"laws": {"lqr": {"position_m": "near"}}}, "lqr.position_m: Input should be a valid number"),
        ({"laws": {"pid": {}}}, "no law is called 'pid'"),
        ({"reference_filter": {"share": 0.0}}, "greater than 0"),
    ],
)
def test_a_wrong_configuration_is_refused_in_a_line(section: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(says)) as refused:
        parse(ControllerConfig, section, Path("my.toml"), "controller")
    assert "\n" not in str(refused.value)


def test_a_law_that_is_not_allowed_is_refused() -> None:
    yaw = DegreeOfFreedom(1.0, 8.0, 0.0)  # 8 / 1 > 5.9 at w0 = 0.5, thesis (8.23)
    vessel = replace(PLADYPOS, model=replace(PLADYPOS.model, yaw=yaw))
    with pytest.raises(ConfigError, match=re.escape("controller.laws.ipd: not stable with drag 20 % too high")):
        Controller(ControllerConfig(), vessel)
    Controller(ControllerConfig(laws={"ipd": {"w0_rad_s": 0.8}}), vessel)


@pytest.mark.parametrize("positioning", ["ipd", "lqr", "p_d"])
def test_every_law_holds_in_the_whole_star(positioning: str) -> None:
    star = build_star(
        simulator={"current_x_m_s": 0.04, "current_y_m_s": 0.03, "current_std_m_s": 0.005},
        controller={"positioning": positioning},
    )
    star.hold(2.5, 1.875, 0.5)
    star.bus.run_for(25.0)
    since_s = star.bus.now_s
    star.bus.run_for(20.0)
    distance_m, angle_rad = star.rms_error(2.5, 1.875, 0.5, since_s)
    assert distance_m < 2e-3
    assert math.degrees(angle_rad) < 0.2
