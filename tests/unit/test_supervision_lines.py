"""What `starboard up` prints of its services' logs."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from services.catalog import PROCESSES
from services.cli.up import teller
from services.supervision import LogLines, ServiceState, Star

CRASH = b"""2026-11-22 06:37:39,123 controller: starting
Traceback (most recent call last):
  File "/x/controller.py", line 3, in <module>
    raise ValueError("no such law")
    ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
ValueError: no such law
"""
HANG = b"""Timeout (0:00:02)!
Thread 0x00007fc9954f96c0 (most recent call first):
  File "/x/threading.py", line 982 in run

Thread 0x00007fc999a12b80 (most recent call first):
  File "/x/selectors.py", line 415 in select
"""


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_a_line_for_each_event_however_the_bytes_come(chunk: int) -> None:
    told: list[tuple[str, str]] = []
    lines = LogLines(Path("/run"), lambda *line: told.append(line))
    for written in (CRASH, HANG, b"goes on\nunfinished"):
        for i in range(0, len(written), chunk):
            lines.take("controller", written[i : i + chunk])
    where = "(traceback in /run/log/controller.log)"
    assert told == [
        ("controller", "starting"),
        ("controller", f"ValueError: no such law {where}"),
        ("controller", f"its loop hangs: ended {where}"),
        ("controller", "goes on"),
    ]


def test_the_texts_of_all_services_stand_below_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    tell = teller(PROCESSES)
    for process in PROCESSES:
        tell(process.name, "runs")
    assert len({line.rindex("runs") for line in capsys.readouterr().out.splitlines()}) == 1


def test_how_a_service_ended_is_told_in_words() -> None:
    told: list[tuple[str, str]] = []
    star: Any = SimpleNamespace(stopping=False, tell=lambda *line: told.append(line))
    for spawnerr in ("Bad exit code -1", "Bad exit code 3; not expected", None):
        Star._tell_end(star, ServiceState("helm"), "stopped", SimpleNamespace(spawnerr=spawnerr))
    assert [text for _, text in told] == [
        "killed by a signal: starts again",
        "Bad exit code 3: starts again",
        "ended: starts again",
    ]
