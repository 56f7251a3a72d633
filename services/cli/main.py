"""The command line `starboard`. Heavy modules are imported by the command that needs them."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Annotated, cast

import typer

from bus.config import ConfigError
from services.cli.errors import CliError

app = typer.Typer(
    name="starboard",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

UsageError = cast("type[typer.BadParameter]", typer.BadParameter.__base__)
"""What typer raises for a wrong option or argument, and, with the help as its message, for none where one is needed."""

COMMANDS = {
    "run": "services.cli.run:run",
    "up": "services.cli.up:up",
    "status": "services.cli.status:status",
    "topics": "services.cli.variables:topics",
    "get": "services.cli.variables:get",
    "watch": "services.cli.watch:watch",
    "hz": "services.cli.hz:hz",
    "poke": "services.cli.variables:poke",
    "script": "services.cli.script:script",
    "play": "services.cli.play:play",
    "graph": "services.cli.graph:graph",
    "mode": "services.cli.mode:mode",
    "actuator": "services.cli.actuator:actuator",
    "experiment": "services.cli.experiment:experiment",
    "track": "services.cli.track:track",
    "vessels": "services.cli.vessels:vessels",
    "simulate": "services.cli.simulate:simulate",
    "tune": "services.cli.tune:tune",
    "autotune": "services.cli.autotune:autotune",
    "bench": "services.cli.bench:bench",
    "figures": "services.cli.figures:figures",
}
GROUPS = {
    "identify": "services.cli.identify:app",
    "log": "services.cli.log:app",
    "camera": "services.cli.camera:app",
    "secure": "services.cli.secure:app",
}


def _load(target: str) -> object:
    module, name = target.split(":")
    return getattr(importlib.import_module(module), name)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"starboard {version('starboard')}")
        raise typer.Exit


@app.callback()
def _starboard(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Control system of a laboratory marine vessel: processes around one key-value bus."""


def _register(wanted: str | None) -> None:
    """Add the command that is wanted, or all of them for help and completion: a service starts with few imports."""
    everything = wanted not in (*COMMANDS, *GROUPS)
    for name, target in COMMANDS.items():
        if everything or name == wanted:
            app.command(name)(_load(target))  # type: ignore[type-var]
    for name, target in GROUPS.items():
        if everything or name == wanted:
            app.add_typer(_load(target), name=name)  # type: ignore[arg-type]


def main() -> None:
    """Run a command; a mistake of use is one line on stderr and exit code 2."""
    _register(sys.argv[1] if len(sys.argv) > 1 else None)
    try:
        sys.exit(app(standalone_mode=False) or 0)  # what it returns is the code of a typer.Exit
    except UsageError as error:
        message = error.format_message()
        where = error.ctx.command_path if error.ctx else "starboard"
        print(message if "\n" in message else f"{where}: {message} (`{where} --help`)", file=sys.stderr)
        sys.exit(2)
    except typer.Abort:  # a question without an answer
        print("starboard: ended", file=sys.stderr)
        sys.exit(1)
    except (CliError, ConfigError) as error:
        print(f"starboard: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:  # `starboard topics | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


if __name__ == "__main__":
    main()
