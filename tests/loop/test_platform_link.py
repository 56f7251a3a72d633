from pathlib import Path

import pytest

from bus import topics
from bus.config import Deployment
from bus.memory_bus import M, MemoryBus
from bus.messages import ActuatorCommand
from bus.service import Service
from platform_link.drivers import open_far_end
from platform_link.firmware import Firmware
from platform_link.service import PlatformLink, PlatformLinkConfig
from services.vessels import load_vessel

VESSEL = load_vessel("pladypos")
NAMES = [t.name for t in VESSEL.thrusters]
FORWARD = dict.fromkeys(NAMES, 4.0)
ZEROS = dict.fromkeys(NAMES, 0.0)


class Platform(Service):
    """The firmware at the far end, at 200 Hz."""

    name = "platform"
    rate_hz = 200.0

    def __init__(self, uri: str) -> None:
        self.uri = uri
        self.firmware = Firmware(NAMES)
        self.flip = False
        self.history: list[tuple[float, dict[str, float]]] = []

    def start(self, now_s: float) -> None:
        self.port = open_far_end(self.uri)

    def step(self, now_s: float) -> None:
        data = bytearray(self.port.read())
        if self.flip and data:
            data[5] ^= 1
            self.flip = False
        self.port.write(self.firmware.feed(bytes(data), now_s) + self.firmware.poll(now_s))
        self.history.append((now_s, self.firmware.commands(now_s)))

    def stop(self, now_s: float) -> None:
        self.step(now_s)
        self.port.close()


@pytest.fixture
def uri(tmp_path: Path) -> str:
    return f"loop://{tmp_path}"


@pytest.fixture
def link(uri: str) -> PlatformLink:
    return PlatformLink(PlatformLinkConfig(uri=uri), VESSEL, Deployment())


def last(bus: MemoryBus, topic: topics.Topic[M]) -> M:
    message = bus.last(topic)
    assert message is not None
    return message


def command_for(bus: MemoryBus, seconds: float, commands: dict[str, float] = FORWARD) -> None:
    """Publish commands at 30 Hz."""
    for _ in range(round(seconds * 30)):
        bus.publish(topics.ACTUATOR_COMMAND, ActuatorCommand(commands=commands))
        bus.run_for(1 / 30)


def started(uri: str, link: PlatformLink, *, json: bool = False) -> tuple[MemoryBus, Platform]:
    bus = MemoryBus(json=json)
    platform = Platform(uri)
    bus.add(platform)
    bus.add(link)
    bus.run_for(0.1)
    return bus, platform


@pytest.mark.parametrize("json", [False, True])
def test_commands_arrive_and_telemetry_comes_back(uri: str, link: PlatformLink, json: bool) -> None:
    bus, platform = started(uri, link, json=json)
    command_for(bus, 2.0)
    assert platform.firmware.commands(bus.now_s) == FORWARD
    telemetry, status = last(bus, topics.LINK_TELEMETRY), last(bus, topics.LINK_STATUS)
    assert telemetry.commands == FORWARD
    assert not telemetry.dead_man
    assert (status.state, status.error, status.lost, status.crc_errors) == ("connected", "", 0, 0)
    assert status.rate_hz == pytest.approx(30, abs=12)
    assert status.round_trip_s == pytest.approx(1 / 30, abs=1e-5)  # no descriptor wakes the link on a MemoryBus
    assert status.command_age_s == pytest.approx(0.0, abs=1e-6)


def test_a_link_killed_and_back_at_once_begins_with_zeros(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 1.0)
    assert platform.history[-1][1] == FORWARD
    bus.add(PlatformLink(PlatformLinkConfig(uri=uri), VESSEL, Deployment()))
    command_for(bus, 0.3)
    since_kill = [commands for _, commands in platform.history[-60:]]
    assert ZEROS in since_kill
    assert since_kill[-1] == FORWARD


def test_silence_on_the_bus_sends_zeros(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 1.0)
    last_s = bus.now_s - 1 / 30
    bus.run_until(lambda: platform.firmware.commands(bus.now_s) == ZEROS, 1.0)
    assert 0.25 <= bus.now_s - last_s <= 0.35
    bus.run_for(1.0)
    assert not last(bus, topics.LINK_TELEMETRY).dead_man  # the link keeps sending: zeros


def test_an_old_command_is_old_whenever_it_arrives(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    for age_ns in (300_000_000, -300_000_000):
        stamp_ns = bus.clock.now_ns() - age_ns
        bus.publish(topics.ACTUATOR_COMMAND, ActuatorCommand(stamp_ns=stamp_ns, commands=FORWARD))
        bus.run_for(0.1)
    assert all(commands == ZEROS for _, commands in platform.history)


def test_a_dead_link_leaves_the_rest_to_the_platform(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 1.0)
    bus.kill("platform_link")
    killed_s = bus.now_s
    bus.run_until(lambda: platform.firmware.commands(bus.now_s) == ZEROS, 1.0)
    assert bus.now_s - killed_s <= 0.4


def test_between_commands_the_link_never_falls_below_the_dead_man(uri: str, link: PlatformLink) -> None:
    bus, _platform = started(uri, link)
    sent_before = last(bus, topics.LINK_STATUS).sent
    bus.run_for(10.0)
    assert last(bus, topics.LINK_STATUS).sent - sent_before >= 20 * 10 * 0.9
    assert not last(bus, topics.LINK_TELEMETRY).dead_man


def test_a_flipped_bit_is_counted_and_nothing_else_happens(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 1.0)
    platform.flip = True
    command_for(bus, 1.5)
    status = last(bus, topics.LINK_STATUS)
    assert (status.state, status.platform_crc_errors) == ("connected", 1)
    assert platform.firmware.commands(bus.now_s) == FORWARD


def test_unplugged_and_back(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    states = []
    bus.tap(topics.LINK_STATUS, lambda s: states.append((s.state, s.error)))
    command_for(bus, 1.2)
    platform.port.close()
    bus.kill("platform")
    command_for(bus, 2.0)
    assert states[-1] == ("disconnected", f"{uri}: nobody is at the far end")
    again = Platform(uri)
    bus.add(again)
    begin_s = bus.now_s
    while again.firmware.commands(bus.now_s) != FORWARD and bus.now_s < begin_s + 2:
        command_for(bus, 1 / 30)
    assert bus.now_s - begin_s <= 0.6
    command_for(bus, 1.1)
    assert states[-1] == ("connected", "")


def test_what_lasts_is_one_line_what_passes_is_none(
    uri: str, link: PlatformLink, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "platform_link")
    bus = MemoryBus()
    bus.add(link)
    bus.run_for(1.5)  # a simulator that starts last
    bus.add(platform := Platform(uri))
    bus.run_for(2.0)
    for away_s in (1.0, 4.0, 4.0):
        platform.port.close()
        bus.kill("platform")
        bus.run_for(away_s)
        bus.add(platform := Platform(uri))
        bus.run_for(2.0)
    there, gone = f"{uri}: connected", f"{uri}: nobody is at the far end"
    assert [record.getMessage() for record in caplog.records] == [there, gone, there, gone, there]


def test_a_silent_platform_is_disconnected(uri: str, link: PlatformLink) -> None:
    bus, _platform = started(uri, link)
    bus.pause("platform")
    command_for(bus, 1.5)
    status = last(bus, topics.LINK_STATUS)
    assert status.state == "disconnected"
    assert "says nothing" in status.error


def test_stopping_the_link_stops_the_thrusters_at_once(uri: str, link: PlatformLink) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 1.0)
    bus.stop("platform_link")
    bus.run_for(0.01)
    assert platform.firmware.commands(bus.now_s) == ZEROS
    assert last(bus, topics.LINK_STATUS).state == "disconnected"


def test_what_does_not_fit_the_vessel_is_clamped_or_refused(
    uri: str, link: PlatformLink, caplog: pytest.LogCaptureFixture
) -> None:
    bus, platform = started(uri, link)
    command_for(bus, 0.5, {**FORWARD, NAMES[0]: 99.0})
    assert platform.firmware.commands(bus.now_s) == {**FORWARD, NAMES[0]: 15.0}
    command_for(bus, 0.5, {"rudder": 1.0})
    assert platform.firmware.commands(bus.now_s) == ZEROS
    bus.run_for(1.0)
    assert last(bus, topics.LINK_STATUS).rejected == 30
    assert len([r for r in caplog.records if "counted" in r.message]) == 1


def test_the_simulators_port_is_the_default(tmp_path: Path) -> None:
    link = PlatformLink(PlatformLinkConfig(), VESSEL, Deployment(run_dir=tmp_path))
    far = open_far_end(f"pty://{tmp_path}/platform")
    bus = MemoryBus()
    bus.add(link)
    bus.run_for(0.2)
    assert link.files()
    assert far.read()
    far.close()
    bus.run_for(0.2)
    assert link.files() == ()
    bus.stop("platform_link")
