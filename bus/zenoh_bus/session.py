"""Opening Zenoh: settings (docs/adr/0001-zenoh.md), and what receives a message."""

from __future__ import annotations

import ctypes
import json
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from bus.config import ConfigError
from bus.security import Secured
from bus.service import first_line

LEASE_MS = 400
"""A silent hub counts as dead after this; found in docs/adr/0001-zenoh.md to survive a loaded two-core machine."""

_QUEUE = 8
"""Messages sent at once that wait for the sending thread; with Zenoh's 2 a busy machine drops some of a quick burst."""

TRY_MS = 300
"""So long one address is tried before the next."""

MAX_MESSAGE_BYTES = 32_000_000
"""A larger message ends its sender's connection: Zenoh's own limit is 1 GB, and it would be gathered in memory."""

_stays: set[int] = set()
"""Zenoh's threads that keep their state in the interpreter."""


def direct(take: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback[zenoh.Sample]:
    """Return a handler that calls `take` in the thread that receives.

    Such a thread is none of Python's: for each call it would get a new state, with 16 kB of memory mapped and cleared
    for its frames, which takes three times as long as all else about a message. So it takes one and keeps it.
    """

    def call(sample: zenoh.Sample) -> None:
        if (thread := threading.get_ident()) not in _stays:
            _stays.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()  # without its Release
        take(sample)

    return zenoh.handlers.Callback(call, indirect=False)


def key_sent_on(sample: zenoh.Sample) -> str:
    """Return the key of a message, or "" for one that was sent on another key than it came under.

    That happens for a moment when clients return to a hub that hung (docs/adr/0001-zenoh.md). So we attach the key.
    """
    key, sent = str(sample.key_expr), sample.attachment
    try:
        return key if sent is None or sent.to_string() == key else ""
    except ValueError:  # not even a text
        return ""


class HubUnreachableError(ConnectionError):
    """Nobody answers at the hub's address."""


def _settings(
    mode: str, listen: tuple[str, ...], connect: tuple[str, ...], timeout_ms: int, secured: Secured
) -> zenoh.Config:
    tx = {"lease": LEASE_MS, "queue": {"size": {"real_time": _QUEUE, "data": _QUEUE}}}
    link = {"tx": tx, "rx": {"max_message_size": MAX_MESSAGE_BYTES}}
    values: dict[str, Any] = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        # Shared memory between processes of one machine would cost each reader of one large message 16 MB resident.
        "transport": {"link": link, "unicast": {"open_timeout": 200}, "shared_memory": {"enabled": False}},
    }
    if listen:
        values["listen"] = {"endpoints": list(listen), "exit_on_failure": True}
    if connect:
        values["connect"] = {
            "endpoints": list(connect),
            "timeout_ms": timeout_ms,
            "exit_on_failure": timeout_ms >= 0,
            "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2},
        }
    config = zenoh.Config.from_json5(json.dumps(values))
    for path, value in secured.items():
        config.insert_json5(path, json.dumps(value))
    return config


def open_session(
    mode: str, endpoints: tuple[str, ...], timeout_ms: int, link: tuple[str, ...] = (), secured: Secured | None = None
) -> zenoh.Session:
    """Return a session; raise HubUnreachableError for a client, ConfigError for a hub that cannot listen."""
    zenoh.init_log_from_env_or("off")  # its own lines repeat what we say in one
    listen, connect = ((), endpoints) if mode == "client" else (endpoints, link)
    try:
        return zenoh.open(_settings(mode, listen, connect, timeout_ms, secured or {}))
    except zenoh.ZError as error:
        where = ", ".join(endpoints)
        if mode == "client":
            raise HubUnreachableError(where) from None
        if "in use" in str(error):
            raise ConfigError(f"cannot listen on {where}: another hub (or program) has this port") from None
        raise ConfigError(f"cannot listen on {where}: {first_line(error).split(' at /')[0]}") from None
