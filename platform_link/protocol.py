"""The serial protocol between shore and platform, both directions; described in docs/link-protocol.md.

On the wire: `00 | COBS(body | CRC-32 of body) | 00`. COBS leaves no zero inside a frame, so that a receiver is in step
again at the next zero, whatever came before; the leading zero ends any noise on the line, and a damaged delimiter
spoils one frame only. CRC-32 (IEEE 802.3, as zlib) rather than CRC-16, because a bit flipped in a COBS code byte
becomes several wrong bits of the body, for which a check sum of 16 bits promises only 2^-16.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

from marine.vessel import COMMAND_DIGITS

VERSION = 1
MAX_CHANNELS = 64
COMMANDS_PER_UNIT = 10.0**COMMAND_DIGITS
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
_HIGHEST = _MOST / COMMANDS_PER_UNIT
_LOWEST = -_HIGHEST
_MAX_ENCODED = 254  # longest chunk for which COBS needs no code 0xFF
_CODES = [bytes([length + 1]) for length in range(_MAX_ENCODED)]
_BODIES = {
    kind: [struct.Struct(f"{_HEADER}{count}h{state}") for count in range(MAX_CHANNELS + 1)]
    for kind, state in ((_COMMAND, ""), (_TELEMETRY, _STATE))
}
"""The layout of each type's body, by the number of channels."""


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
    if isinstance(message, Command):
        return encode_command(*message)
    return encode_telemetry(**message._asdict())


def encode_command(seq: int, time_us: int, commands: Sequence[float]) -> bytes:
    """Return a `Command` of these fields as bytes for the wire."""
    channels = _channels(commands)
    count = len(channels)
    body = _BODIES[_COMMAND][count].pack(VERSION, _COMMAND, seq & 0xFFFF, time_us & 0xFFFFFFFF, count, *channels)
    return _frame(body)


def encode_telemetry(
    seq: int,
    echo_us: int,
    commands: Sequence[float],
    *,
    answer: bool,
    dead_man: bool,
    battery_v: float | None,
    crc_errors: int,
    refused: int,
) -> bytes:
    """Return a `Telemetry` of these fields as bytes for the wire."""
    channels = _channels(commands)
    count = len(channels)
    flags = dead_man * _DEAD_MAN | answer * _ANSWER
    battery = _NO_BATTERY if battery_v is None else min(max(round(1e3 * battery_v), 0), 0xFFFE)
    state = flags, battery, crc_errors & 0xFFFF, refused & 0xFFFF
    layout = _BODIES[_TELEMETRY][count]
    body = layout.pack(VERSION, _TELEMETRY, seq & 0xFFFF, echo_us & 0xFFFFFFFF, count, *channels, *state)
    return _frame(body)


def _channels(commands: Sequence[float]) -> list[int]:
    if len(commands) > MAX_CHANNELS:
        raise ValueError(f"{len(commands)} channels; the protocol carries {MAX_CHANNELS}")
    return [round(c * COMMANDS_PER_UNIT) if _LOWEST < c < _HIGHEST else _clamped(c) for c in commands]


def _clamped(command: float) -> int:
    return min(max(round(command * COMMANDS_PER_UNIT), -_MOST), _MOST)


def _frame(body: bytes) -> bytes:
    return b"\0" + _cobs(body + _CRC.pack(zlib.crc32(body))) + b"\0"


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
        message = _parse(content)
        if message is None:
            self.unknown += 1
        return message


def _parse(content: bytearray) -> Command | Telemetry | None:
    """Return the message of a body with its CRC behind it; None for another version or type."""
    version, kind, count = content[0], content[1], content[_COUNT]
    if version != VERSION or kind not in _BODIES or count > MAX_CHANNELS:
        return None
    layout = _BODIES[kind][count]
    if len(content) != layout.size + _CRC.size:
        return None
    values = layout.unpack_from(content)
    end = 5 + count
    commands = tuple([c / COMMANDS_PER_UNIT for c in values[5:end]])
    if kind == _COMMAND:
        return Command(values[2], values[3], commands)
    flags, battery, crc_errors, refused = values[end:]
    battery_v = None if battery == _NO_BATTERY else battery * 1e-3
    answer, dead_man = bool(flags & _ANSWER), bool(flags & _DEAD_MAN)
    return Telemetry(values[2], values[3], answer, dead_man, commands, battery_v, crc_errors, refused)


def _cobs(content: bytes) -> bytes:
    """Return content without its zeros: each stretch up to one gets its length + 1 in front (Cheshire, Baker 1999)."""
    return b"".join([_CODES[len(stretch)] + stretch for stretch in content.split(b"\0")])


def _uncobs(chunk: bytes) -> bytearray:
    """Return the content of a chunk, empty when its code bytes do not add up."""
    code, end = 0, len(chunk)
    if end > _MAX_ENCODED:
        return bytearray()
    content = bytearray(chunk)
    while code < end:
        content[code] = 0
        code += chunk[code]
    return content[1:] if code == end else bytearray()
