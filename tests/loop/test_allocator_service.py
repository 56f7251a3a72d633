import math

import pytest

from bus import topics
from bus.memory_bus import MemoryBus
from bus.messages import ActuatorCommand, HelmWrench
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
