"""The link to the platform: actuator commands over a port, telemetry back. Silence on the bus sends zeros."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

from bus import topics
from bus.config import Deployment, Section
from bus.messages import LinkStatus, LinkTelemetry
from bus.service import Input, Output, Service
from marine.vessel import Vessel
from platform_link.drivers import Driver, DriverError, open_driver
from platform_link.protocol import MAX_CHANNELS, Decoder, Telemetry, encode_command

RETRY_S = 0.5
SILENCE_S = 1.0
"""A platform that says nothing for so long counts as disconnected."""
TOLD_AFTER_S = 3.0
"""A platform away for so long is worth a line; at the start of a system, and at its end, it is away for a moment."""
KEEP_ALIVE_S = 0.025
"""Send again in the first step so long after the last command. Half a period, because a step that telemetry woke puts
the next one off by a whole period."""
ZEROS_AT_OPEN_S = 0.1
"""A port that has just been opened gets zeros first: nobody knows what the platform ran before, or since when."""
_ZEROS_AT_STOP = 3
_RESTART_GAP = 1000
"""A larger jump of the platform's sequence is its restart, not a loss."""


class PlatformLinkConfig(Section):
    """Section `[platform_link]`."""

    uri: str = "pty://"
    """Port: `serial:///dev/ttyUSB0?baud=115200`, `pty://PATH`, `loop://NAME`; `pty://` is the simulator's."""


class PlatformLink(Service):
    """Send actuator commands to the platform and publish what it answers.

    After opening the port zeros go out for 0.1 s. Then a command goes out at once and again in every step; zeros when
    it is older than 0.25 s or does not fit the vessel. A port that has gone is opened again every 0.5 s.
    """

    name = "platform_link"
    rate_hz = 20.0
    quick = True
    command = Input(topics.ACTUATOR_COMMAND, max_age_s=0.25, wakes=True)
    status = Output(topics.LINK_STATUS)
    telemetry = Output(topics.LINK_TELEMETRY)

    def __init__(self, config: PlatformLinkConfig, vessel: Vessel, deployment: Deployment) -> None:
        self._uri = f"pty://{deployment.run_dir.absolute() / 'platform'}" if config.uri == "pty://" else config.uri
        self._limits = {a.name: (a.lowest, a.n_max) for a in vessel.actuators}
        if len(self._limits) > MAX_CHANNELS:
            raise ValueError(f"{vessel.name}: {len(self._limits)} actuators; the link carries {MAX_CHANNELS}")
        self._zeros = (0.0,) * len(self._limits)
        self._driver: Driver | None = None
        self._error = ""
        self._retry_s = -math.inf
        self._decoder = Decoder()
        self._opened_s = -math.inf
        self._sent = 0
        self._sent_s = -math.inf
        self._received = 0
        self._received_s = -math.inf
        self._lost = 0
        self._rejected = 0
        self._command_age_s: float | None = None
        self._round_trip_s: float | None = None
        self._last: Telemetry | None = None
        self._state = ""
        self._changed_s = math.inf
        self._told = ""
        self._rate_hz = 0.0
        self._window_s = -math.inf
        self._received_before = 0

    def files(self) -> Sequence[int]:
        """Wake when the platform says something."""
        descriptor = self._driver.fileno() if self._driver is not None else None
        return () if descriptor is None else (descriptor,)

    def step(self, now_s: float) -> None:
        """Receive, send, report."""
        try:
            if self._driver is None and now_s >= self._retry_s:
                self._driver = open_driver(self._uri)
                self._opened_s = now_s
                self._error = ""
            if self._driver is not None:
                self._receive(self._driver, now_s)
                if self.command.updated or now_s - self._sent_s >= KEEP_ALIVE_S:
                    self._send(self._driver, self._wanted(now_s), now_s)
        except DriverError as error:
            self._disconnect(str(error), now_s)
        self._report(now_s)

    def stop(self, now_s: float) -> None:
        """Send zeros and close the port."""
        if self._driver is not None:
            with contextlib.suppress(DriverError):
                for _ in range(_ZEROS_AT_STOP):  # a radio may lose one
                    self._send(self._driver, self._zeros, now_s)
        self._disconnect(self._error or "stopped", now_s)
        self._report(now_s)

    def _wanted(self, now_s: float) -> Sequence[float]:
        """Return one command per channel: zeros unless a fresh command fits the vessel."""
        command = self.command.fresh(now_s)
        self._command_age_s = None
        if command is None or now_s - self._opened_s < ZEROS_AT_OPEN_S:
            return self._zeros
        self._command_age_s = now_s - command.stamp_ns * 1e-9
        commands, limits = command.commands, self._limits
        if commands.keys() != limits.keys():
            self._reject(f"refused: it is for {', '.join(commands)}; the vessel has {', '.join(limits)}")
            return self._zeros
        wanted = []
        for name, (lowest, highest) in limits.items():
            value = commands[name]
            if not lowest <= value <= highest:
                self._reject(f"clamped to the vessel's limits: {commands}")
                return [min(max(commands[n], low), high) for n, (low, high) in limits.items()]
            wanted.append(value)
        return wanted

    def _reject(self, reason: str) -> None:
        if not self.command.updated:  # the same command, sent again
            return
        self._rejected += 1
        if self._rejected == 1:
            self.log.warning("command %s (further ones are counted in link/status)", reason)

    def _send(self, driver: Driver, commands: Sequence[float], now_s: float) -> None:
        self._sent += 1
        self._sent_s = now_s
        driver.write(encode_command(self._sent, int(now_s * 1e6), commands))

    def _receive(self, driver: Driver, now_s: float) -> None:
        for message in self._decoder.feed(driver.read()):
            if isinstance(message, Telemetry) and len(message.commands) == len(self._limits):
                self._take(message, now_s)

    def _take(self, message: Telemetry, now_s: float) -> None:
        seq, echo_us, answer, dead_man, commands, battery_v, _, _ = message
        if self._last is not None:
            gap = (seq - self._last.seq - 1) & 0xFFFF
            self._lost += gap if gap < _RESTART_GAP else 0
        if answer:
            self._round_trip_s = ((int(now_s * 1e6) - echo_us) & 0xFFFFFFFF) / 1e6
        self._last = message
        self._received += 1
        self._received_s = now_s
        by_name = dict(zip(self._limits, commands, strict=True))
        self.telemetry.publish(LinkTelemetry(commands=by_name, dead_man=dead_man, battery_v=battery_v))

    def _disconnect(self, error: str, now_s: float) -> None:
        if self._driver is not None:
            self._driver.close()
        self._driver = None
        self._round_trip_s = None
        self._received_s = -math.inf
        self._retry_s = now_s + RETRY_S
        self._error = error

    def _report(self, now_s: float) -> None:
        answering = now_s - self._received_s <= SILENCE_S
        state = "connected" if answering else "disconnected"
        error = self._error or ("" if answering else "the port is open, but the platform says nothing")
        before, self._state = self._state, state
        if state != before:
            self._changed_s = now_s
        if state != self._told and (answering or now_s - self._changed_s >= TOLD_AFTER_S):
            self.log.info("%s", self._error or f"{self._uri}: {error or state}")
            self._told = state
        if (seconds := now_s - self._window_s) >= 1.0 - 1e-6:
            self._rate_hz = (self._received - self._received_before) / seconds
            self._window_s, self._received_before = now_s, self._received
        elif state == before:
            return
        self.status.publish(
            LinkStatus(
                state=state,
                error=error,
                port=self._uri,
                sent=self._sent,
                received=self._received,
                lost=self._lost,
                crc_errors=self._decoder.crc_errors,
                platform_crc_errors=self._last.crc_errors if self._last is not None else 0,
                rejected=self._rejected,
                rate_hz=self._rate_hz,
                round_trip_s=self._round_trip_s,
                command_age_s=self._command_age_s,
            )
        )
