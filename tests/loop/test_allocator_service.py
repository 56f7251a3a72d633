import itertools
import math
from dataclasses import replace
from typing import Any

import pytest

from bus import topics
from bus.config import ConfigError
from bus.memory_bus import MemoryBus
from bus.messages import ActuatorCommand, HelmWrench
from marine.actuators import Drive
from marine.vessel import Rudder, Vessel
from platform_link.protocol import Command, Decoder, encode
from services.allocator import Allocator, AllocatorConfig
from services.vessels import load_vessel

PLADYPOS = load_vessel("pladypos")


@pytest.fixture
def bus() -> MemoryBus:
    bus = MemoryBus()
    bus.add(Allocator(AllocatorConfig(), PLADYPOS))
    bus.run_for(0.001)
    return bus


def commands(bus: MemoryBus) -> list[float]:
    last = bus.last(topics.ACTUATOR_COMMAND)
    assert last is not None
    return list(last.commands.values())


def test_full_surge_is_full_command_at_once_and_keeps_the_origin(bus: MemoryBus) -> None:
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", origin_ns=17, surge_n=2.5456, sway_n=0.0, yaw_nm=0.0))
    bus.run_for(0.0)
    command = bus.last(topics.ACTUATOR_COMMAND)
    assert command is not None
    assert command.commands == dict.fromkeys((t.name for t in PLADYPOS.thrusters), 15.0)
    assert command.origin_ns == 17


def test_silence_stops_the_actuators_while_the_allocator_goes_on_telling(bus: MemoryBus) -> None:
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=1.0))
    zero_at_s: list[float] = []
    start_s = bus.now_s

    def note(command: ActuatorCommand) -> None:
        if not any(command.commands.values()):
            zero_at_s.append(bus.now_s - start_s)

    bus.tap(topics.ACTUATOR_COMMAND, note)
    bus.run_for(2.0)
    assert 0.25 <= zero_at_s[0] <= 0.31
    assert len(zero_at_s) >= 30  # 20 Hz of zeros that are fresh
    last = bus.last(topics.ACTUATOR_COMMAND)
    assert last is not None
    assert bus.now_s - last.stamp_ns * 1e-9 <= 0.051


def test_an_old_wrench_stays_old(bus: MemoryBus) -> None:
    stamp_ns = bus.clock.now_ns() - 300_000_000
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", stamp_ns=stamp_ns, surge_n=1.0))
    bus.run_for(0.01)
    assert commands(bus) == [0.0] * 4


def test_stop_leaves_zeros(bus: MemoryBus) -> None:
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=1.0))
    bus.run_for(0.0)
    assert commands(bus) != [0.0] * 4
    bus.stop("allocator")
    assert commands(bus) == [0.0] * 4


def test_attained_knows_limits_and_delivered_knows_rounding_too(bus: MemoryBus) -> None:
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=1.0, sway_n=0.01, yaw_nm=0.1))
    bus.run_for(0.0)
    attained, delivered = bus.last(topics.ACTUATOR_ATTAINED), bus.last(topics.ACTUATOR_DELIVERED)
    assert attained is not None
    assert delivered is not None
    assert attained.vector() == pytest.approx((1.0, 0.01, 0.0, 0.0, 0.0, 0.1), abs=1e-9)
    assert (attained.demanded_surge_n, attained.demanded_yaw_nm, attained.limited) == (1.0, 0.1, False)
    n = commands(bus)
    thrusts = [0.004 * abs(x) * x for x in n]
    assert all(x == int(x) for x in n)
    assert delivered.surge_n == pytest.approx(sum(thrusts) * math.sin(math.pi / 4))
    assert delivered.surge_n != pytest.approx(1.0, abs=1e-4)

    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=4.0, yaw_nm=0.3))
    bus.run_for(0.0)
    attained = bus.last(topics.ACTUATOR_ATTAINED)
    assert attained is not None
    assert attained.limited
    assert attained.surge_n is not None
    assert attained.surge_n < 2.0
    assert attained.yaw_nm == pytest.approx(0.3, rel=0.1)
    assert attained.demanded_sway_n is None


def test_what_the_vessel_cannot_do_is_attained_as_zero(bus: MemoryBus) -> None:
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=1.0, heave_n=2.0))
    bus.run_for(0.0)
    attained = bus.last(topics.ACTUATOR_ATTAINED)
    assert attained is not None
    assert (attained.heave_n, attained.demanded_heave_n, attained.roll_nm) == (0.0, 2.0, None)
    assert attained.limited
    assert attained.surge_n == pytest.approx(1.0)


def allocator(vessel: Vessel, **config: Any) -> MemoryBus:
    bus = MemoryBus()
    bus.add(Allocator(AllocatorConfig(**config), vessel))
    bus.run_for(0.001)
    return bus


def test_a_failed_thruster_rests_and_the_others_do_its_work() -> None:
    bus = allocator(PLADYPOS, failed=("front_port",))
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=0.3, sway_n=0.2, yaw_nm=0.05))
    bus.run_for(1.1)
    command, attained = bus.last(topics.ACTUATOR_COMMAND), bus.last(topics.ACTUATOR_ATTAINED)
    assert command is not None
    assert command.commands["front_port"] == 0.0
    beat = bus.last(topics.HEARTBEAT.of("allocator"))
    assert beat is not None
    assert beat.note == "front_port has failed (configuration); rank 3 on surge, sway, yaw"
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=0.3, sway_n=0.2, yaw_nm=0.05))
    bus.run_for(0.0)
    attained = bus.last(topics.ACTUATOR_ATTAINED)
    assert attained is not None
    assert attained.vector() == pytest.approx((0.3, 0.2, 0.0, 0.0, 0.0, 0.05), abs=1e-6)


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        ({"failed": ("front",)}, "no actuator 'front'"),
        ({"failed": tuple(t.name for t in PLADYPOS.thrusters)}, "no working actuator"),
        ({"priority": {"yaw": 0.0}}, "weights must be positive"),
    ],
)
def test_a_wrong_configuration_is_one_line(config: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        Allocator(AllocatorConfig(**config), PLADYPOS)


def test_a_limited_rate_lets_commands_grow_step_by_step_and_stops_at_once() -> None:
    slow = replace(PLADYPOS, actuators=tuple(replace(t, rate_per_s=20.0) for t in PLADYPOS.thrusters))
    bus = allocator(slow)
    seen: list[float] = []
    bus.tap(topics.ACTUATOR_COMMAND, lambda command: seen.append(command.commands["front_port"]))
    for _ in range(30):
        bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=2.5456, sway_n=0.0, yaw_nm=0.0))
        bus.run_for(0.05)
    assert max(abs(b - a) for a, b in itertools.pairwise(seen)) <= 2.0  # 20 a second at most, rounded
    assert seen[-1] == 15.0
    early = seen.index(15.0)
    assert early >= 12  # 15 / 20 s = 0.75 s, in steps of 0.05 s or less
    bus.stop("allocator")
    assert seen[-1] == 0.0


def test_a_diving_vessel_gets_heave_from_its_vertical_thrusters() -> None:
    falcon = load_vessel("falcon")
    bus = allocator(falcon)
    wrench = HelmWrench(mode="manual", surge_n=40.0, sway_n=-10.0, heave_n=30.0, yaw_nm=5.0)
    bus.publish(topics.HELM_WRENCH, wrench)
    bus.run_for(0.0)
    attained, delivered = bus.last(topics.ACTUATOR_ATTAINED), bus.last(topics.ACTUATOR_DELIVERED)
    assert attained is not None
    assert delivered is not None
    assert not attained.limited
    assert delivered.vector() == pytest.approx((40.0, -10.0, 30.0, 0.0, 0.0, 5.0), abs=0.5)


def test_propeller_and_rudder_turn_and_need_less_angle_at_speed() -> None:
    charlie = load_vessel("charlie")
    actuators = (replace(a, rate_per_s=None) for a in charlie.actuators)
    charlie = replace(charlie, actuators=tuple(replace(a, k_r1=9.0) if isinstance(a, Rudder) else a for a in actuators))
    bus = allocator(charlie)
    angles = []
    for speed_m_s in (0.0, 1.0):
        bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=40.0, yaw_nm=4.0, speed_m_s=speed_m_s))
        bus.run_for(0.0)
        command, delivered = bus.last(topics.ACTUATOR_COMMAND), bus.last(topics.ACTUATOR_DELIVERED)
        assert command is not None
        assert delivered is not None
        assert (delivered.surge_n, delivered.yaw_nm) == pytest.approx((40.0, 4.0), rel=0.02)
        assert delivered.sway_n is not None
        assert delivered.sway_n < 0.0  # the stern is pushed to port, Table 2.2(f)
        angles.append([command.commands[a.name] for a in charlie.actuators if isinstance(a, Rudder)])
    assert len(set(angles[0])) == 1  # both rudders alike, thesis (2.36)
    assert 0.0 < angles[1][0] < angles[0][0]


def test_direct_commands_are_throttle_and_rudder() -> None:
    telemetron = load_vessel("telemetron")
    telemetron = replace(telemetron, actuators=tuple(replace(a, rate_per_s=None) for a in telemetron.actuators))
    bus = allocator(telemetron)
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=0.5, yaw_nm=-0.3))
    bus.run_for(0.0)
    throttle, rudder = telemetron.actuators
    assert commands(bus) == pytest.approx([0.5 / throttle.gain, -0.3 / rudder.gain])  # type: ignore[union-attr]
    bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=-0.5))
    bus.run_for(0.0)
    assert commands(bus) == pytest.approx([0.0, 0.0])  # there is no reverse


def test_a_rudder_turns_no_faster_than_it_can_and_gets_there() -> None:
    charlie = load_vessel("charlie")
    bus = allocator(charlie)
    seen: list[float] = []
    bus.tap(topics.ACTUATOR_COMMAND, lambda command: seen.append(command.commands["rudder_port"]))
    for yaw_nm in (9.0, -9.0):
        for _ in range(40):
            bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=60.0, yaw_nm=yaw_nm))
            bus.run_for(0.05)
    assert max(abs(b - a) for a, b in itertools.pairwise(seen)) <= 0.5 * 0.05 + 0.01 + 1e-9, "and the steps of the link"
    assert (max(seen), seen[-1]) == pytest.approx((-min(seen), -max(seen)), rel=1e-3)
    assert max(seen) > 0.2
    delivered = bus.last(topics.ACTUATOR_DELIVERED)
    assert delivered is not None
    assert delivered.yaw_nm == pytest.approx(-9.0, rel=0.02)


def test_commands_just_outside_the_dead_zone_survive_the_link() -> None:
    """The link carries hundredths; what it rounded into the dead zone gave nothing, and was said to be delivered."""
    videoray = load_vessel("videoray")
    bus, drives = allocator(videoray), {t.name: Drive(t) for t in videoray.thrusters}
    for surge_n in (0.012, 0.02, 0.03, 0.0371, 0.05):
        bus.publish(topics.HELM_WRENCH, HelmWrench(mode="manual", surge_n=surge_n, heave_n=0.0, yaw_nm=0.0))
        bus.run_for(0.01)
        command, told = bus.last(topics.ACTUATOR_COMMAND), bus.last(topics.ACTUATOR_DELIVERED)
        assert command is not None
        assert told is not None
        (sent,) = Decoder().feed(encode(Command(1, 0, tuple(command.commands.values()))))
        arrived = dict(zip(command.commands, sent.commands, strict=True))
        given = sum(drives[name].thrust(arrived[name]) for name in ("port", "starboard"))
        assert given == pytest.approx(told.surge_n, abs=1e-9)
        assert given == pytest.approx(surge_n, abs=0.02), "half of the least thrust, twice"
