"""The bytes themselves, so that somebody else's firmware can be written from docs/link-protocol.md."""

import zlib

import pytest

from platform_link.firmware import Firmware
from platform_link.protocol import Command, Decoder, Telemetry, encode


def test_the_frame_printed_in_the_documentation() -> None:
    wire = encode(Command(seq=1, time_us=123456, commands=(15.0, -3.0, 0.0, 4.0)))
    assert wire.hex(" ") == "00 04 01 01 01 04 40 e2 01 06 04 dc 05 d4 fe 01 07 90 01 ea b4 fc a7 00"
    body = bytes.fromhex("01 01 01 00 40 e2 01 00 04 dc 05 d4 fe 00 00 90 01")
    assert zlib.crc32(body).to_bytes(4, "little").hex(" ") == "ea b4 fc a7"


def test_longest_frames_fit() -> None:
    full = tuple([327.67] * 64)
    for message in (Command(1, 2, full), Telemetry(1, 2, True, False, full, 12.0, 3, 4)):
        assert Decoder().feed(encode(message)) == [message]
    with pytest.raises(ValueError, match="65 channels"):
        encode(Command(1, 2, tuple([0.0] * 65)))


def test_values_beyond_the_range_are_clamped() -> None:
    [command] = Decoder().feed(encode(Command(1, 2, (1e9, -1e9))))
    assert command.commands == (327.67, -327.67)


def test_endless_noise_is_bounded_and_counted_once() -> None:
    decoder = Decoder()
    for _ in range(100):
        assert decoder.feed(b"\x55" * 1000) == []
    assert len(decoder._buffer) < 300
    assert decoder.feed(encode(Command(1, 2, (3.0,)))) == [Command(1, 2, (3.0,))]
    assert decoder.crc_errors == 1
    assert decoder.discarded_bytes == 100_000


def test_another_version_is_no_crc_error() -> None:
    body = bytes.fromhex("02 01 01 00 00 00 00 00 00")
    content = body + zlib.crc32(body).to_bytes(4, "little")
    coded = b"".join(bytes((len(p) + 1,)) + p for p in content.split(b"\0"))
    decoder = Decoder()
    assert decoder.feed(b"\0" + coded + b"\0") == []
    assert (decoder.unknown, decoder.crc_errors) == (1, 0)


NAMES = ("a", "b")


def telemetry(data: bytes) -> Telemetry:
    [message] = Decoder().feed(data)
    assert isinstance(message, Telemetry)
    return message


def test_firmware_answers_obeys_and_stops_in_silence() -> None:
    firmware = Firmware(NAMES)
    assert firmware.dead_man(0.0)
    answer = telemetry(firmware.feed(encode(Command(7, 555, (1.5, -2.0))), 10.0))
    assert (answer.answer, answer.echo_us, answer.dead_man, answer.commands) == (True, 555, False, (1.5, -2.0))
    assert firmware.commands(10.35) == {"a": 1.5, "b": -2.0}
    assert firmware.commands(10.36) == {"a": 0.0, "b": 0.0}
    told = telemetry(firmware.poll(10.36))
    assert (told.answer, told.dead_man, told.commands) == (False, True, (0.0, 0.0))


def test_firmware_refuses_and_counts_what_does_not_fit() -> None:
    firmware = Firmware(NAMES)
    bad = bytearray(encode(Command(1, 0, (1.0, 1.0))))
    bad[9] ^= 0x10
    assert firmware.feed(bytes(bad), 0.0) == b""
    assert firmware.feed(encode(Command(2, 0, (1.0,))), 0.0) == b""
    assert (firmware.crc_errors, firmware.refused) == (1, 1)
    assert firmware.commands(0.0) == {"a": 0.0, "b": 0.0}
    answer = telemetry(firmware.feed(encode(Command(3, 0, (1.0, 2.0))), 0.0))
    assert (answer.crc_errors, answer.refused) == (1, 1)


def test_firmware_tells_at_20_hz_unless_it_has_just_answered() -> None:
    firmware = Firmware(NAMES)
    told = [t for t in range(100) if firmware.poll(t * 0.01)]
    assert told == list(range(0, 100, 5))
    firmware.feed(encode(Command(1, 0, (0.0, 0.0))), 1.0)
    assert firmware.poll(1.04) == b""
