"""`starboard actuator`: what it refuses before it asks the system."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from services.cli.actuator import actuator
from services.cli.errors import CliError

app = typer.Typer()
app.command()(actuator)


@pytest.mark.parametrize("arguments", [["front_port"], ["front_port", "broken"]])
def test_a_word_about_an_actuator_is_failed_or_works(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, CliError)
    assert "starboard actuator NAME failed" in str(result.exception)
