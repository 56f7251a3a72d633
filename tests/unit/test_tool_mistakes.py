"""Mistakes with the tools of the bus: one line that says what to do."""

import socket
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from bus.clock import NS
from bus.hub import HubConfig
from bus.service import RawSample
from bus.zenoh_bus import LastValue
from logs.writer import LogWriter
from services.catalog import load_settings
from services.cli import watch
from services.cli.errors import CliError
from services.cli.main import main
from services.cli.play import play
from services.cli.status import _comparable, _service
from services.cli.system import client
from services.cli.up import check_ports
from services.cli.variables import poke


def test_a_second_star_does_not_join_the_first_ones_hub(tmp_path: Path) -> None:
    config = tmp_path / "star.toml"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        for hub in (f'listen = ["{address}"]\nstandby = ""', f'listen = ["tcp/127.0.0.1:0"]\nstandby = "{address}"'):
            config.write_text(f"[hub]\n{hub}\n")
            with pytest.raises(CliError, match=f"{address}: another star"):
                check_ports(load_settings(config))
    check_ports(load_settings(config))
    config.write_text(f'[hub]\nrouter = "{address}"\n')
    check_ports(load_settings(config))


@pytest.mark.parametrize("address", ["nonsense", "tcp/127.0.0.1", "tcp/127.0.0.1:99999", "127.0.0.1:7447", ""])
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(CliError, match="no address: write tcp/HOST:PORT"), client(f"{address},tcp/127.0.0.1:7447"):
        pass
    with pytest.raises(ValueError, match="no address: write tcp/HOST:PORT"):
        HubConfig(listen=(address,))


@pytest.mark.parametrize("fields", ["[" * 100_000, "{", "kind", "7", "kind=" + "[" * 100_000])
def test_a_poke_of_nonsense(fields: str) -> None:
    with pytest.raises(CliError, match="simulation/fault: "):
        poke("simulation/fault", [fields])


@pytest.mark.parametrize("span", [{"from_s": 9.0}, {"from_s": 0.0, "to_s": 0.5, "topics": ["other"]}])
def test_there_is_nothing_to_play(span: dict[str, Any], tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    writer = LogWriter(log, "pladypos", {"vessel": "pladypos"}, {}, 0)
    for second, key in ((1, "my/key"), (2, "other")):
        writer.write(RawSample(key, b'{"a": 1}', second * NS))
    writer.finish()
    with pytest.raises(CliError, match=r"no message of these topics from .* \(it lasts 1\.0 s\)"):
        play(log, **span)


def test_a_watch_that_hears_nothing_says_so_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    waits = iter([None, None, None])

    def sleep(_seconds: float) -> None:
        next(waits)

    monkeypatch.setattr(watch, "SILENT_S", -1.0)
    monkeypatch.setattr(time, "sleep", sleep)
    with pytest.raises(StopIteration):
        watch._print_lines(deque(), False, 0.0, 0)
    assert capsys.readouterr().err.count("nothing has come yet") == 1


@pytest.mark.parametrize("payload", [b"", b"[]", b"7", b"\xff", b'{"rate_hz": "x"}', b"[" * 100_000, None])
def test_status_of_a_service_whose_heartbeat_is_nonsense(payload: bytes | None) -> None:
    beat = LastValue("service/helm/heartbeat", payload, 10**9, 1, 1.0, "helm")
    shown = _service({"name": "helm", "state": "running", "restarts": 0}, beat, 10**9)
    assert (shown["state"], shown["rate_hz"], shown["clock_uncertainty_ms"]) == ("running", 0.0, None)


def test_stamps_are_comparable_to_what_the_two_worst_clocks_allow() -> None:
    measured = {"hub": None, "helm": 0.2, "far": 0.7, "ui": 0.4, "old": None}
    services = [{"name": name, "clock_uncertainty_ms": value} for name, value in measured.items()]
    assert _comparable(services) == {"comparable_ms": 1.1, "not_measured": ["old"]}
    assert _comparable(services[:1]) == {"comparable_ms": None, "not_measured": []}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["mode"], "starboard mode: Missing argument 'name'. (`starboard mode --help`)"),
        (["mode", "hold", "--x-m", "abc"], "starboard mode: Invalid value for '--x-m': "),
        (["mode", "hold", "--z", "1"], "starboard mode: No such option: --z (`starboard mode --help`)"),
        (["nonsense"], "starboard: No such command 'nonsense'. (`starboard --help`)"),
        (["mode", "nonsense"], "starboard: no mode is called 'nonsense'"),
    ],
)
def test_a_wrong_command_line_is_one_line(
    arguments: list[str], told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["starboard", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(told)
