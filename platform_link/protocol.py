"""The serial protocol between shore and platform, both directions; described in docs/link-protocol.md.

On the wire: `00 | COBS(body | CRC-32 of body) | 00`. COBS leaves no zero inside a frame, so that a receiver is in step
again at the next zero, whatever came before; the leading zero ends any noise on the line, and a damaged delimiter
spoils one frame only. CRC-32 (IEEE 802.3, as zlib) rather than CRC-16, because a bit flipped in a COBS code byte
becomes several wrong bits of the body, for which a check sum of 16 bits promises only 2^-16.
"""

from __future__ import annotations

import struct
import zlib
from functools import cache
from typing import NamedTuple

from marine.vessel import COMMAND_DIGITS

VERSION = 1
MAX_CHANNELS = 64
COMMANDS_PER_UNIT = 10**COMMAND_DIGITS
"""Commands travel as int16 in hundredths of the actuator's unit: +-327.67 in steps of 0.01."""

_COMMAND, _TELEMETRY = 1, 2
_HEADER = "<BBHIB"  # version, type, sequence, time or echo in us, number of channels
_COUNT = struct.calcsize(_HEADER) - 1  # where that number stands
_STATE = "BHHH"  # flags, battery in mV, CRC errors, refused commands
_CRC = struct.Struct("<I")
_INTACT = 0x2144DF1C  # CRC-32 of anything with its own CRC-32 behind it
_DEAD_MAN, _ANSWER = 1, 2
_NO_BATTERY = 0xFFFF
_MOST = 32767
_MAX_ENCODED = 254  # longest chunk for which COBS needs no code 0xFF
_CODES = [bytes([length + 1]) for length in range(_MAX_ENCODED)]


class Command(NamedTuple):
    """Shore to platform: one value per actuator, in the order of the vessel file and in the actuator's unit."""

    seq: int
    time_us: int
    """Time of sending, modulo 2^32; the answer echoes it."""
    commands: tuple[float, ...]


class Telemetry(NamedTuple):
    """Platform to shore: what the motor drivers run, and how the platform fares."""

    seq: int
    echo_us: int
    """`time_us` of the command that came last."""
    answer: bool
    """Whether this answers a command at once: only then does `echo_us` measure a round trip."""
    dead_man: bool
    """Whether the platform has stopped its actuators for want of commands."""
    commands: tuple[float, ...]
    battery_v: float | None
    crc_errors: int
    """Damaged frames since the platform was switched on, modulo 2^16."""
    refused: int
    """Commands refused for a wrong number of channels, modulo 2^16."""


def encode(message: Command | Telemetry) -> bytes:
    """Return a message as bytes for the wire; commands beyond int16 are clamped.

    Raises ValueError when there are more than `MAX_CHANNELS` commands.
    """
    count, seq = len(message.commands), message.seq & 0xFFFF
    if count > MAX_CHANNELS:
        raise ValueError(f"{count} channels; the protocol carries {MAX_CHANNELS}")
    channels = [round(c * COMMANDS_PER_UNIT) for c in message.commands]
    if count and not -_MOST <= min(channels) <= max(channels) <= _MOST:
        channels = [min(max(c, -_MOST), _MOST) for c in channels]
    if isinstance(message, Command):
        time_us = message.time_us & 0xFFFFFFFF
        body = _layout(_COMMAND, count).pack(VERSION, _COMMAND, seq, time_us, count, *channels)
    else:
        flags = message.dead_man * _DEAD_MAN | message.answer * _ANSWER
        battery = _NO_BATTERY if message.battery_v is None else min(max(round(1e3 * message.battery_v), 0), 0xFFFE)
        state = flags, battery, message.crc_errors & 0xFFFF, message.refused & 0xFFFF
        echo_us = message.echo_us & 0xFFFFFFFF
        body = _layout(_TELEMETRY, count).pack(VERSION, _TELEMETRY, seq, echo_us, count, *channels, *state)
    return b"\0" + _cobs(body + _CRC.pack(zlib.crc32(body))) + b"\0"


@cache
def _layout(kind: int, count: int) -> struct.Struct:
    return struct.Struct(f"{_HEADER}{count}h{_STATE if kind == _TELEMETRY else ''}")


class Decoder:
    """Bytes in, messages out; in step again by itself after damage."""

    def __init__(self) -> None:
        self.crc_errors = 0
        """Pieces between two delimiters that were no intact frame: flipped bits, lost bytes, noise."""
        self.discarded_bytes = 0
        self.unknown = 0
        """Intact frames of another version or type."""
        self._buffer = b""

    def feed(self, data: bytes) -> list[Command | Telemetry]:
        """Return the messages that these bytes complete, oldest first."""
        if not data:
            return []
        *chunks, rest = (self._buffer + data).split(b"\0")
        messages = [message for chunk in chunks if chunk and (message := self._message(chunk)) is not None]
        if len(rest) > _MAX_ENCODED:  # noise: keep just enough of it to count it once, at its end
            self.discarded_bytes += len(rest) - _MAX_ENCODED - 1
            rest = rest[: _MAX_ENCODED + 1]
        self._buffer = rest
        return messages

    def _message(self, chunk: bytes) -> Command | Telemetry | None:
        content = _uncobs(chunk)
        if len(content) <= _COUNT + _CRC.size or zlib.crc32(content) != _INTACT:
            self.crc_errors += 1
            self.discarded_bytes += len(chunk)
            return None
        message = _parse(content[: -_CRC.size])
        self.unknown += message is None
        return message


def _parse(body: bytes) -> Command | Telemetry | None:
    version, kind, count = body[0], body[1], body[_COUNT]
    layout = _layout(kind, count)
    if version != VERSION or kind not in (_COMMAND, _TELEMETRY) or len(body) != layout.size:
        return None
    _, _, seq, time_us, *values = layout.unpack(body)
    commands = tuple([c / COMMANDS_PER_UNIT for c in values[1 : 1 + count]])
    if kind == _COMMAND:
        return Command(seq, time_us, commands)
    flags, battery, crc_errors, refused = values[1 + count :]
    battery_v = None if battery == _NO_BATTERY else battery * 1e-3
    return Telemetry(
        seq, time_us, bool(flags & _ANSWER), bool(flags & _DEAD_MAN), commands, battery_v, crc_errors, refused
    )


def _cobs(content: bytes) -> bytes:
    """Return content without its zeros: each stretch up to one gets its length + 1 in front (Cheshire, Baker 1999)."""
    return b"".join([_CODES[len(stretch)] + stretch for stretch in content.split(b"\0")])


def _uncobs(chunk: bytes) -> bytes:
    """Return the content of a chunk, empty when its code bytes do not add up."""
    if len(chunk) > _MAX_ENCODED:
        return b""
    content, code, end = bytearray(chunk), 0, len(chunk)
    while code < end:
        length = content[code]
        content[code] = 0
        code += length
    return bytes(content[1:]) if code == end else b""
