"""The helm: who may act, what is refused, when it suspends, resumes and stops."""

import math
from typing import Any

import pytest

from bus import topics
from bus.clock import NS
from bus.memory_bus import MemoryBus
from bus.messages import (
    ControlStatus,
    HelmAnswer,
    HelmState,
    HelmWrench,
    NavigationState,
    OperatorJoystick,
    OperatorRequest,
    Wrench,
)
from bus.service import Input, Output, Service
from services.helm import Helm, HelmConfig
from services.helm_modes import Checks, Refused
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")


class Source(Service):
    """Stands in for estimator and controller: a pose and a wrench at 30 Hz as long as they are wanted."""

    name = "controller"
    rate_hz = 30.0
    pose = Output(topics.NAVIGATION_STATE)
    wrench = Output(topics.CONTROL_WRENCH)
    state = Input(topics.HELM_STATE)
    status = "tracking"
    poses = True
    wrenches = True

    def step(self, now_s: float) -> None:
        if self.poses:
            self.pose.publish(
                NavigationState.model_validate(
                    {
                        "status": self.status, "x_m": 2.0, "y_m": 1.5, "psi_rad": 0.5, "surge_m_s": 0, "sway_m_s": 0,
                        "yaw_rad_s": 0, "measurement_age_s": 0.0 if self.status == "tracking" else 2.0,
                    }
                )
            )  # fmt: skip
        if self.wrenches:
            self.wrench.publish(Wrench(surge_n=1.0, sway_n=0.5, yaw_nm=0.1, origin_ns=7))


class Pool:
    """A helm on a bus with everything it needs, and what it said."""

    def __init__(self) -> None:
        self.bus = MemoryBus()
        self.source = Source()
        self.answers: list[HelmAnswer] = []
        self.wrenches: list[HelmWrench] = []
        self.bus.tap(topics.HELM_ANSWER, self.answers.append)
        self.bus.tap(topics.HELM_WRENCH, self.wrenches.append)
        self.bus.add(self.source)
        self.start_helm()
        self.bus.run_for(1.2)

    def start_helm(self) -> None:
        self.bus.add(Helm(HelmConfig(), VESSEL))

    def state(self) -> HelmState:
        state = self.bus.last(topics.HELM_STATE)
        assert state is not None
        return state

    def ask(self, mode: str | None, client: str = "page", wait_s: float = 0.1, **fields: object) -> HelmAnswer:
        values = {"request_id": str(len(self.answers)), "client": client, "mode": mode} | fields
        self.bus.publish(topics.OPERATOR_REQUEST, OperatorRequest.model_validate(values))
        self.bus.run_for(wait_s)
        assert self.answers[-1].request_id == values["request_id"]
        return self.answers[-1]

    def steer(self, seconds: float, client: str = "page", **sticks: float) -> None:
        for _ in range(round(seconds * 20)):
            self.bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client=client, **sticks))
            self.bus.run_for(0.05)

    def acts(self) -> bool:
        return any(self.wrenches[-1].vector())


@pytest.fixture
def pool() -> Pool:
    return Pool()


def test_it_starts_disarmed_with_zero_wrench(pool: Pool) -> None:
    assert (pool.state().mode, pool.state().status) == ("stop", "disarmed")
    assert pool.wrenches
    assert not pool.acts()


def test_hold_passes_on_the_controllers_wrench_with_its_origin(pool: Pool) -> None:
    answer = pool.ask("hold", x_m=1.2, y_m=0.8, psi_rad=math.pi / 6)
    assert answer.accepted, answer.reason
    assert (pool.state().x_m, pool.state().y_m, pool.state().law) == (1.2, 0.8, "positioning")
    assert pool.state().sources == {"surge": "controller", "sway": "controller", "yaw": "controller"}
    assert pool.wrenches[-1].surge_n == 1.0
    assert pool.wrenches[-1].origin_ns == 7
    assert not pool.state().suspended


def test_hold_without_reference_means_here(pool: Pool) -> None:
    assert pool.ask("hold").accepted
    assert (pool.state().x_m, pool.state().y_m, pool.state().psi_rad) == (2.0, 1.5, 0.5)


@pytest.mark.parametrize(("x_m", "y_m"), [(0.1, 1.0), (4.9, 1.0), (1.0, 0.0), (1.0, 3.6), (-7.0, 1.0)])
def test_a_place_outside_the_pool_is_refused_and_the_old_one_stays(pool: Pool, x_m: float, y_m: float) -> None:
    assert pool.ask("hold", x_m=1.0, y_m=1.0).accepted
    answer = pool.ask("hold", x_m=x_m, y_m=y_m)
    assert not answer.accepted
    assert "pool" in answer.reason
    assert (pool.state().mode, pool.state().x_m) == ("hold", 1.0)
    assert pool.state().refused == 1


def test_hold_is_refused_without_a_pose(pool: Pool) -> None:
    pool.source.poses = False
    pool.bus.run_for(0.5)
    answer = pool.ask("hold")
    assert not answer.accepted
    assert "estimator" in answer.reason
    pool.source.poses, pool.source.status = True, "lost"
    pool.bus.run_for(0.2)
    assert "lost" in pool.ask("hold").reason


def test_unknown_and_unbuilt_modes_are_refused_with_a_reason(pool: Pool) -> None:
    assert pool.ask("depth").reason == "no mode depth: pladypos has no actuators for heave"
    assert "no mode" in pool.ask(None).reason
    with pytest.raises(Refused, match="no mode hold: charlie has no actuators for sway"):
        Checks(load_vessel("charlie")).rule("hold")


def way(*places: tuple[float, float]) -> list[dict[str, float]]:
    return [{"x_m": x, "y_m": y} for x, y in places]


@pytest.mark.parametrize(
    ("mode", "fields", "says"),
    [
        ("path", {"points": way((1, 1), (6, 1))}, "way-point 2: x must lie in 0.30 ... 4.70 m, inside the pool"),
        ("path", {"points": way((1, 1), (2, 2), (2, 1), (1, 2))}, "crosses itself: legs 1 and 3"),
        ("path", {"points": way((1, 1), (2, 2), (2, 2))}, "two points of a path are equal"),
        ("path", {"points": way((1, 1))}, "two points at least"),
        ("path", {}, "two points at least"),
        (
            "path",
            {"points": way((1, 1), (4.65, 1), (4.65, 3)), "smooth": True},
            "the smooth path leaves the pool",
        ),
        ("path", {"points": way((1, 1), (3, 1)), "speed_m_s": 0.5}, "0.5 m/s is more than pladypos can do"),
        ("path", {"points": way((1, 1), (3, 1)), "speed_m_s": -0.1}, "must be positive"),
        ("line", {"points": way((1, 1), (2, 1), (3, 3))}, "a line goes from one point"),
        ("line", {}, "a line goes from one point"),
        ("speed", {"speed_m_s": -2.0}, "-2 m/s is more than pladypos can do: -0.36 ... 0.36 m/s"),
    ],
)
def test_what_cannot_be_followed_is_refused_and_the_vessel_never_receives_it(
    pool: Pool, mode: str, fields: dict[str, Any], says: str
) -> None:
    assert pool.ask("hold", x_m=1.0, y_m=1.0).accepted
    answer = pool.ask(mode, **fields)
    assert not answer.accepted
    assert says in answer.reason
    assert (pool.state().mode, pool.state().x_m, pool.state().points) == ("hold", 1.0, ())


def test_a_vessel_that_only_steers_is_not_asked_for_turns_that_it_cannot_make() -> None:
    charlie = Checks(load_vessel("charlie")).abilities
    charlie.check_path([(20, 20), (100, 20), (100, 60), (20, 60)], False, 1.0)
    with pytest.raises(ValueError, match=r"leg 2 is too short for its turns: 4\.00 m"):
        charlie.check_path([(20, 20), (100, 20), (100, 24), (20, 24)], False, 1.0)
    with pytest.raises(ValueError, match="the smooth path turns with"):
        charlie.check_path([(20, 20), (40, 20), (40, 24), (20, 30)], True, 1.0)
    with pytest.raises(ValueError, match="more than charlie can do"):
        charlie.check_speed(-0.1)


def test_a_path_ends_in_hold_where_the_controller_says(pool: Pool) -> None:
    answer = pool.ask("path", points=way((1, 1), (3, 1), (3, 3)), smooth=True, speed_m_s=0.1)
    assert answer.reason == "3 way-points, 0.10 m/s"
    state = pool.state()
    assert (state.law, state.smooth, len(state.points), state.request_id) == ("path", True, 3, answer.request_id)
    told = {"law": "ipd", "in_charge": True, "arrived": True, "reference_x_m": 3.0, "reference_y_m": 3.0}
    done = ControlStatus.model_validate(told | {"request_id": "of another path", "reference_psi_rad": 0.7})
    pool.bus.publish(topics.CONTROL_STATUS, done)
    pool.bus.run_for(0.1)
    assert pool.state().mode == "path"
    pool.bus.publish(topics.CONTROL_STATUS, done.model_copy(update={"request_id": answer.request_id}))
    pool.bus.run_for(0.1)
    state = pool.state()
    assert (state.mode, state.x_m, state.y_m, state.psi_rad) == ("hold", 3.0, 3.0, 0.7)
    assert state.reason == "the end of the path is reached"


def test_an_old_request_is_refused_but_an_old_stop_is_not(pool: Pool) -> None:
    old_ns = round((pool.bus.now_s - 30.0) * NS)
    assert "old" in pool.ask("hold", stamp_ns=old_ns).reason
    assert pool.ask("hold").accepted
    assert pool.ask("stop", stamp_ns=old_ns).accepted
    assert pool.state().mode == "stop"


def test_manual_scales_the_sticks_to_what_the_vessel_can(pool: Pool) -> None:
    assert pool.ask("manual").accepted
    pool.steer(0.2, surge=0.5, yaw=-1.0)
    full_n = 4 * math.sin(math.pi / 4) * 0.2 * 15**2 * 0.02  # four thrusters at 45 degrees, full command
    assert pool.wrenches[-1].surge_n == pytest.approx(0.5 * full_n, rel=1e-6)
    assert pool.wrenches[-1].yaw_nm == pytest.approx(-180 * 0.006, rel=1e-6)


def test_the_sticks_of_others_do_nothing(pool: Pool) -> None:
    pool.ask("manual")
    pool.steer(0.2, client="stranger", surge=1.0)
    assert not pool.acts()


def test_a_silent_joystick_stops_within_half_a_second(pool: Pool) -> None:
    pool.ask("manual")
    pool.steer(0.3, surge=1.0)
    assert pool.acts()
    pool.bus.run_for(0.45)
    assert pool.acts()
    pool.bus.run_for(0.15)
    assert not pool.acts()
    assert pool.state().mode == "manual"


def test_closing_the_page_ends_manual_but_not_hold(pool: Pool) -> None:
    pool.ask("manual", lease_s=3.0)
    pool.bus.run_for(3.3)
    assert pool.state().mode == "stop"
    pool.ask("hold", lease_s=3.0)
    pool.bus.run_for(5.0)
    assert pool.state().mode == "hold"
    assert pool.state().holder == ""
    assert pool.acts()


def test_renewing_keeps_the_lease_and_releasing_gives_it_up(pool: Pool) -> None:
    pool.ask("manual", lease_s=3.0)
    for _ in range(4):
        assert pool.ask(None, action="renew", wait_s=1.5).accepted
    assert pool.state().mode == "manual"
    assert not pool.ask(None, client="other", action="renew").accepted
    assert pool.ask(None, action="release").accepted
    assert pool.state().mode == "stop"


def test_an_attended_lease_excludes_others_until_they_take_it(pool: Pool) -> None:
    pool.ask("hold", client="page-a", lease_s=30.0)
    refusal = pool.ask("manual", client="page-b")
    assert not refusal.accepted
    assert "page-a" in refusal.reason
    assert pool.ask("manual", client="page-b", take=True).accepted
    assert pool.state().holder == "page-b"
    assert pool.ask("stop", client="page-a").accepted, "stop is everybody's"


def test_an_unattended_lease_excludes_nobody(pool: Pool) -> None:
    pool.ask("hold", client="cli-1", attended=False, lease_s=600.0)
    assert pool.ask("hold", client="page").accepted


def test_a_silent_controller_suspends_and_resumes_by_itself(pool: Pool) -> None:
    pool.ask("hold")
    pool.source.wrenches = False
    pool.bus.run_for(0.4)
    assert pool.state().suspended
    assert "controller" in pool.state().reason
    assert not pool.acts()
    pool.bus.run_for(8.0)
    pool.source.wrenches = True
    pool.bus.run_for(0.2)
    assert not pool.state().suspended
    assert pool.acts()


@pytest.mark.parametrize("what", ["silent", "lost"])
def test_a_lost_pose_suspends_and_after_ten_seconds_stops(pool: Pool, what: str) -> None:
    pool.ask("hold")
    if what == "silent":
        pool.source.poses = False
    else:
        pool.source.status = "lost"
    pool.bus.run_for(0.4)
    assert pool.state().suspended
    assert not pool.acts()
    pool.bus.run_for(9.0)
    assert pool.state().mode == "hold"
    pool.bus.run_for(1.5)
    assert (pool.state().mode, pool.state().status) == ("stop", "fault")
    pool.source.poses, pool.source.status = True, "tracking"
    pool.bus.run_for(2.0)
    assert pool.state().mode == "stop", "it does not start again by itself after that"
    assert pool.ask("hold").accepted
    assert pool.state().status == "armed"


def test_an_old_wrench_is_not_sent_twice(pool: Pool) -> None:
    pool.ask("hold")
    pool.source.wrenches = False
    before = len([w for w in pool.wrenches if any(w.vector())])
    pool.bus.run_for(0.2)
    assert len([w for w in pool.wrenches if any(w.vector())]) - before <= 1


@pytest.mark.parametrize(
    ("attended", "lease_s", "comes_back"), [(False, 600.0, True), (True, 3.0, True), (True, 0.4, False)]
)
def test_a_restarted_helm_takes_up_hold_only_while_the_lease_lives(
    pool: Pool, attended: bool, lease_s: float, comes_back: bool
) -> None:
    pool.ask("hold", x_m=1.0, y_m=1.0, psi_rad=0.0, attended=attended, lease_s=lease_s)
    pool.bus.kill("helm")
    pool.bus.run_for(0.6)
    pool.start_helm()
    pool.bus.run_for(1.5)
    assert (pool.state().mode == "hold") == comes_back
    assert pool.acts() == comes_back
    if comes_back:
        assert pool.state().x_m == 1.0


def test_a_helm_started_without_a_past_is_disarmed() -> None:
    bus = MemoryBus()
    bus.add(Helm(HelmConfig(), VESSEL))
    bus.run_for(0.5)
    assert bus.last(topics.HELM_STATE) is None, "it waits for its former state before it overwrites it"
    bus.run_for(1.0)
    state = bus.last(topics.HELM_STATE)
    assert state is not None
    assert state.mode == "stop"
