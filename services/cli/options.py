"""Options and arguments that several commands share, and what the shell completes for them."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from services.cli.errors import CliError

_CHUNK = r"(?:\*\*?|(?:[^/*$#?]|\$\*)+)"
_EXPRESSION = re.compile(rf"{_CHUNK}(?:/{_CHUNK})*")


def key_expression(text: str) -> str:
    """Return a Zenoh key expression as given; raise CliError, one line, when it is none."""
    if not _EXPRESSION.fullmatch(text):
        raise CliError(
            f"{text!r} is no key expression: parts between single slashes, each a name, * (any one), "
            "** (any number of parts), or with $* for any characters: navigation/*, **/status, helm/st$*"
        )
    if re.search(r"\*\*/\*", text):
        raise CliError(f"{text!r}: write ** once, and after any *: */**")
    return text


def key_of_vessel(text: str, vessel: str | None) -> tuple[str, str | None]:
    """Return key expression and vessel (None: the running system's); of a played log the full key says both."""
    played = re.fullmatch(r"(replay/[^/*]+)/(.+)", key_expression(text)) if vessel is None else None
    return (played[2], played[1]) if played else (key_expression(text), vessel)


def complete_key(incomplete: str) -> list[str]:
    """Return the declared keys that begin so; of a template the form with a wildcard."""
    from bus.topics import all_topics

    return [t.pattern for t in all_topics() if t.pattern.startswith(incomplete)]


def complete_operator_key(incomplete: str) -> list[str]:
    """Return the keys that people may write without --force."""
    from bus.topics import OPERATOR, all_topics

    return [t.key for t in all_topics() if t.publisher == OPERATOR and t.key.startswith(incomplete)]


def complete_service(incomplete: str) -> list[str]:
    """Return the names of our services that begin so."""
    from services.catalog import PROCESSES

    return [p.name for p in PROCESSES if p.name.startswith(incomplete)]


def complete_mode(incomplete: str) -> list[str]:
    """Return the helm's modes that begin so."""
    from typing import get_args

    from bus.messages import Mode

    return [mode for mode in get_args(Mode) if mode.startswith(incomplete)]


Hub = Annotated[str | None, typer.Option(help="Address of the hub; without it the running system's.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Vessel = Annotated[
    str | None, typer.Option(help="Prefix of all keys; without it the running system's. A played log: replay/NAME.")
]
Pattern = Annotated[
    str,
    typer.Argument(
        help="Key expression without the vessel: navigation/state, helm/*, **.", autocompletion=complete_key
    ),
]
