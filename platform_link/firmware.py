"""The program of the platform's microcontroller: commands in, telemetry out, thrusters off in silence.

A class without clock or port: the simulator runs it at the far end of a pseudo-terminal, tests at that of a queue.
"""

from __future__ import annotations

from collections.abc import Sequence

from platform_link.protocol import Command, Decoder, encode_telemetry

TELEMETRY_PERIOD_S = 0.05


class Firmware:
    """The platform's program.

    `actuators`: names in the order of the channels. Without a valid command for `dead_man_s` all commands are zero.
    """

    def __init__(self, actuators: Sequence[str], dead_man_s: float = 0.35) -> None:
        self.actuators = tuple(actuators)
        self.dead_man_s = dead_man_s
        self.battery_v: float | None = None
        self.refused = 0
        """Intact commands with a wrong number of channels."""
        self._decoder = Decoder()
        self._zeros = (0.0,) * len(self.actuators)
        self._commands = self._zeros
        self._no_commands = dict(zip(self.actuators, self._zeros, strict=True))
        self._by_name = self._no_commands
        self._commanded_s: float | None = None
        self._echo_us = 0
        self._seq = 0
        self._told_s: float | None = None

    @property
    def crc_errors(self) -> int:
        """Damaged frames received so far."""
        return self._decoder.crc_errors

    def feed(self, data: bytes, now_s: float) -> bytes:
        """Take in received bytes; return the bytes to send: one telemetry frame for each valid command."""
        answers = b""
        for message in self._decoder.feed(data):
            if isinstance(message, Command):
                answers += self._obey(message, now_s)
        return answers

    def commands(self, now_s: float) -> dict[str, float]:
        """Return the command that each actuator runs, in its own unit. Not to be changed."""
        return self._no_commands if self.dead_man(now_s) else self._by_name

    def poll(self, now_s: float) -> bytes:
        """Return a telemetry frame when none was sent for 0.05 s, otherwise nothing."""
        if self._told_s is not None and now_s - self._told_s < TELEMETRY_PERIOD_S - 1e-6:
            return b""
        return self._telemetry(now_s, answer=False)

    def dead_man(self, now_s: float) -> bool:
        """Return whether the actuators stand still for want of commands."""
        return self._commanded_s is None or now_s - self._commanded_s > self.dead_man_s

    def _obey(self, command: Command, now_s: float) -> bytes:
        _, time_us, commands = command
        if len(commands) != len(self.actuators):
            self.refused += 1
            return b""
        self._commands, self._commanded_s, self._echo_us = commands, now_s, time_us
        self._by_name = dict(zip(self.actuators, commands, strict=True))
        return self._telemetry(now_s, answer=True)

    def _telemetry(self, now_s: float, *, answer: bool) -> bytes:
        self._told_s = now_s
        self._seq += 1
        dead = self.dead_man(now_s)
        return encode_telemetry(
            self._seq,
            self._echo_us,
            self._zeros if dead else self._commands,
            answer=answer,
            dead_man=dead,
            battery_v=self.battery_v,
            crc_errors=self._decoder.crc_errors,
            refused=self.refused,
        )
