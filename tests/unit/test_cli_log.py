import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from bus.service import RawSample
from logs.writer import LogWriter
from services.cli.errors import CliError
from services.cli.log import app


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A complete recording, one without its end, and a file that is none."""
    for name in ("whole", "cut"):
        writer = LogWriter(tmp_path / f"{name}.mcap", "pladypos", {"vessel": "pladypos"}, {"a.toml": b"1"}, 0)
        for i in range(11):
            writer.write(RawSample("my/key", b'{"a": 1}', 1_700_000_000_000_000_000 + i * 100_000_000))
        writer.finish()
    whole = (tmp_path / "cut.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-50])
    (tmp_path / "none.mcap").write_bytes(b"nonsense")
    return tmp_path


def test_list(folder: Path) -> None:
    cut, none, whole = json.loads(call("list", folder, "--json").stdout)
    assert none == {"file": "none.mcap", "error": "is no MCAP file"}
    assert whole | {"start": ""} == {
        "file": "whole.mcap",
        "vessel": "pladypos",
        "start": "",
        "duration_s": 1.0,
        "size_bytes": (folder / "whole.mcap").stat().st_size,
        "messages": 11,
        "complete": True,
        "grows": False,
    }
    assert (cut["complete"], cut["messages"], cut["grows"]) == (False, 11, True)
    assert "growing" in call("list", folder).stdout
    os.utime(folder / "cut.mcap", (1.0, 1.0))
    table = call("list", folder).stdout
    assert [line.split("│")[-2].strip() for line in table.splitlines() if ".mcap" in line] == [
        "no end",
        "is no MCAP file",
        "yes",
    ]


def test_info(folder: Path) -> None:
    about = json.loads(call("info", folder / "cut.mcap", "--json").stdout)
    assert about["topics"] == [{"key": "my/key", "schema": "", "messages": 11, "rate_hz": 11.0}]
    assert about["metadata"] == {"starboard": {"vessel": "pladypos"}}
    assert about["attachments"] == {"a.toml": 1}
    assert "my/key" in call("info", folder / "whole.mcap").stdout


def test_recover(folder: Path) -> None:
    assert call("recover", folder / "cut.mcap").stdout.endswith("cut.recovered.mcap: 11 messages\n")
    assert json.loads(call("info", folder / "cut.recovered.mcap", "--json").stdout)["complete"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("list", "nowhere"), "no such folder"),
        (("info", "none.mcap"), "is no MCAP file"),
        (("info", "nothing.mcap"), "No such file"),
        (("recover", "whole.mcap"), "nothing to recover"),
    ],
)
def test_mistakes_of_use_are_one_line(folder: Path, arguments: tuple[str, str], message: str) -> None:
    error = call(arguments[0], folder / arguments[1]).exception
    assert isinstance(error, CliError)
    assert message in str(error)
    assert "\n" not in str(error)
