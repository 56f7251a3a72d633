"""Who may speak on the bus: a hub's certificate, the users' passwords and the access rules, from one folder.

`starboard secure init DIR` makes the folder (services/cli/secure.py):

    ca.pem            whom all trust; every machine needs it
    ca.key            signs the hub's certificate; keep it away from other machines
    hub/              hub.pem, hub.key, passwords, rules.json: what a hub needs
    users/NAME        the password of one service, or of `operator`: copy only those that run on a machine
"""

from __future__ import annotations

import ipaddress
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bus.config import ConfigError

HUB_NAME = "starboard-hub"
"""Common name of the hub's certificate: a standby recognises by it the hub it has linked to."""

_ADDRESS = re.compile(r"(?:tcp|tls|udp|quic|ws)/[^/\s]+:(?P<port>\d{1,5})(?:[?#].*)?|unixsock-stream/.+")

Secured = Mapping[str, Any]
"""Settings of a Zenoh session by their path in its configuration."""


def is_address(endpoint: str) -> bool:
    """Whether a text has the form of an address of Zenoh's: tcp/HOST:PORT, tls/[::1]:PORT, unixsock-stream/PATH."""
    found = _ADDRESS.fullmatch(endpoint)
    return found is not None and int(found["port"] or 1) <= 65535


def is_local(endpoint: str) -> bool:
    """Whether only this machine reaches an address such as tcp/127.0.0.1:7447."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unix"):
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def client_settings(folder: Path, user: str) -> Secured:
    """Return what a client needs to be let in; raise ConfigError where a file is missing."""
    password = _read(folder / "users" / user).strip()
    return _usrpwd_and_tls(folder, {"user": user, "password": password}, {})


def hub_settings(folder: Path, user: str) -> Secured:
    """Return what a hub needs; as a standby it links to the other one as `user`. Raises ConfigError."""
    own = folder / "hub"
    certificate = {"listen_certificate": str(own / "hub.pem"), "listen_private_key": str(own / "hub.key")}
    usrpwd = {"user": user, "password": _read(folder / "users" / user).strip()}
    for name in ("hub.pem", "hub.key", "passwords"):
        _read(own / name)
    settings = _usrpwd_and_tls(folder, usrpwd | {"dictionary_file": str(own / "passwords")}, certificate)
    return {**settings, "access_control": read_rules(folder)}


def read_rules(folder: Path) -> dict[str, Any]:
    """Return the access rules of a folder; raise ConfigError."""
    path = folder / "hub" / "rules.json"
    try:
        rules: dict[str, Any] = json.loads(_read(path))
    except ValueError as error:
        raise ConfigError(f"{path}: not valid JSON: {error}") from None
    return rules


def _usrpwd_and_tls(folder: Path, usrpwd: dict[str, Any], certificate: dict[str, Any]) -> Secured:
    authority = folder / "ca.pem"
    _read(authority)
    return {
        "transport/auth/usrpwd": usrpwd,
        "transport/link/tls": {"root_ca_certificate": str(authority), **certificate},
    }


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; `starboard secure init` makes it") from None
