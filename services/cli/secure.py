"""`starboard secure`: who may connect to the hub, and what each may do."""

from __future__ import annotations

import ipaddress
import json
import secrets
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from services.catalog import Settings

app = typer.Typer(help="Keys, passwords and access rules of a hub on the network.", no_args_is_help=True)

DAYS = "3650"
ZENOHD = Path("hub", "zenohd.json5")
"""Configuration of a `zenohd` in our hub's place, where [hub] names one as router."""
_AUTHORITY = ("basicConstraints=critical,CA:TRUE", "keyUsage=critical,keyCertSign,cRLSign")


@app.callback()
def _secure() -> None:
    """Keep `init` a command of its own group."""


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="Where to put them; only its owner can read them.")],
    config: Annotated[Path | None, typer.Option(help="Configuration file of the system.")] = None,
    host: Annotated[
        list[str] | None,
        typer.Option(help="Name or address under which other machines reach the hub; may be given again."),
    ] = None,
) -> None:
    """Make a hub's certificate, a password for each service and the access rules from the declared ports.

    Run it again after a change of services or hosts: keys and passwords that are there stay.
    """
    from services.access import access_rules, bridges
    from services.catalog import load_settings
    from services.star import HUBS

    settings = load_settings(config)
    if shutil.which("openssl") is None:
        raise CliError("the program openssl is missing: apt-get install openssl")
    names = [p.name for p in settings.processes]
    users = list(dict.fromkeys([*(n for n in names if n != HUBS[0]), HUBS[1], "operator"]))
    for part in (folder, folder / "hub", folder / "users"):
        part.mkdir(mode=0o700, parents=True, exist_ok=True)
    hosts = _hosts(settings, host or [])
    _certificate(folder, hosts)
    _passwords(folder, users)
    rules = access_rules(settings.vessel_name, settings.processes, bridges(settings))
    _write(folder / "hub" / "rules.json", json.dumps(rules, indent=1))
    if settings.hub.router:
        _write(folder / ZENOHD, json.dumps(_zenohd(settings.hub.router, folder.absolute()), indent=1))
        print(f"for the machine of {settings.hub.router}:  zenohd -c {folder / ZENOHD}")
    print(f"{folder}: a certificate for {', '.join(hosts)}; {len(users)} users, each with a password and rules")
    print(f'now set in the configuration:  [hub]  security = "{folder}"  and addresses that begin with tls/')


def _zenohd(router: str, folder: Path) -> dict[str, Any]:
    """Return what zenohd needs to route as our hub does: address, certificate, passwords, access rules, lease."""
    from bus.security import hub_settings
    from bus.zenoh_bus import LEASE_MS, MAX_MESSAGE_BYTES
    from services.star import HUBS

    secured = hub_settings(folder, HUBS[1])
    passwords = secured["transport/auth/usrpwd"]["dictionary_file"]
    link = {
        "tx": {"lease": LEASE_MS},
        "rx": {"max_message_size": MAX_MESSAGE_BYTES},
        "tls": secured["transport/link/tls"],
    }
    return {
        "mode": "router",
        "listen": {"endpoints": [f"tls/0.0.0.0:{router.rpartition(':')[2]}"]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "link": link,
            "shared_memory": {"enabled": False},
            "auth": {"usrpwd": {"dictionary_file": passwords}},
        },
        "access_control": secured["access_control"],
    }


def _hosts(settings: Settings, further: list[str]) -> list[str]:
    listening = [a.partition("/")[2].rpartition(":")[0].strip("[]") for a in settings.hub.addresses]
    own = ["localhost", "127.0.0.1", "::1", socket.gethostname()]
    return [h for h in dict.fromkeys([*own, *listening, *further]) if h not in ("0.0.0.0", "::")]


def _certificate(folder: Path, hosts: list[str]) -> None:
    """Make the authority if there is none, and the hub's certificate anew."""
    from bus.security import HUB_NAME

    ca, ca_key, key = folder / "ca.pem", folder / "ca.key", folder / "hub" / "hub.key"
    if not ca_key.exists():
        _key(ca_key)
        extensions = [part for e in _AUTHORITY for part in ("-addext", e)]
        _openssl(
            "req", "-x509", "-new", "-key", ca_key, "-days", DAYS, "-subj", "/CN=starboard", *extensions, "-out", ca
        )
    if not key.exists():
        _key(key)
    names = ",".join(f"{'IP' if _is_address(h) else 'DNS'}:{h}" for h in hosts)
    with tempfile.TemporaryDirectory() as scratch:
        request, extensions_file = Path(scratch) / "request", Path(scratch) / "extensions"
        extensions_file.write_text(
            f"basicConstraints=critical,CA:FALSE\nextendedKeyUsage=serverAuth\nsubjectAltName={names}\n"
        )
        _openssl("req", "-new", "-key", key, "-subj", f"/CN={HUB_NAME}", "-out", request)
        _openssl(
            "x509", "-req", "-in", request, "-CA", ca, "-CAkey", ca_key, "-set_serial", str(secrets.randbits(64)),
            "-days", DAYS, "-extfile", extensions_file, "-out", folder / "hub" / "hub.pem",
        )  # fmt: skip


def _passwords(folder: Path, users: list[str]) -> None:
    for user in users:
        if not (path := folder / "users" / user).exists():
            _write(path, secrets.token_urlsafe(24))
    known = {path.name: path.read_text().strip() for path in sorted((folder / "users").iterdir())}
    _write(folder / "hub" / "passwords", "".join(f"{user}:{known[user]}\n" for user in users))


def _key(path: Path) -> None:
    _write(path, "")
    _openssl("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256", "-out", path)


def _write(path: Path, text: str) -> None:
    """Write a file that only its owner can read, from its first byte on."""
    path.touch(mode=0o600)
    path.write_text(text, encoding="utf-8")


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _openssl(*arguments: str | Path) -> None:
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise CliError(f"openssl {arguments[0]}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
