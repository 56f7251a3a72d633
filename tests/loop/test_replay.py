"""A recording through one service again: the same service says the same, another one something else."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bus import topics
from bus.config import ConfigError
from bus.messages import Message
from bus.service import RawSample
from bus.topics import Topic
from logs.reader import Recording
from logs.writer import LogWriter
from services.allocator import Allocator
from services.catalog import build, load_settings
from services.cli.errors import CliError
from services.cli.log import app
from services.replay import Comparison, replay
from tests.star import build_star

KEYS = (
    topics.CAMERA_POSE,
    topics.NAVIGATION_STATE,
    topics.HELM_WRENCH,
    topics.HELM_STATE,
    topics.ACTUATOR_COMMAND,
    topics.ACTUATOR_ATTAINED,
    topics.ACTUATOR_DELIVERED,
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds of holding, recorded from `MemoryBus`."""
    path = tmp_path_factory.mktemp("log") / "hold.mcap"
    star = build_star()
    writer = LogWriter(path, "pladypos", {"vessel": "pladypos"}, {}, 0)

    def record(topic: Topic[Message]) -> None:
        star.bus.tap(
            topic, lambda message: writer.write(RawSample(topic.key, message.encode(), star.bus.clock.now_ns()))
        )

    for topic in KEYS:
        record(topic)
    star.hold(1.5, 1.2, 0.5)
    star.bus.run_for(8.0)
    writer.finish()
    return path


def through(log: Path, name: str, tables: str = "") -> dict[str, Comparison]:
    config = log.with_name("own.toml")
    config.write_text(tables)
    settings = load_settings(config)
    return {c.key: c for c in replay(Recording(log), build(settings.process(name), settings)).comparisons}


def test_the_same_allocator_commands_the_same(log: Path) -> None:
    found = through(log, "allocator")
    command = found["actuator/command"]
    assert command.compared >= 0.95 * command.recorded > 200
    assert max(command.largest.values()) <= 1.0, "whole commands, where a wrench lies on the edge of rounding"
    assert found["actuator/attained"].largest["surge_n"] < 1e-9


def test_the_same_estimator_estimates_the_same_and_another_does_not(log: Path) -> None:
    same = through(log, "estimator")["navigation/state"]
    assert same.compared >= 0.95 * same.recorded > 200
    assert same.largest["x_m"] < 0.002
    other = through(log, "estimator", "[estimator]\nenabled = false\n")["navigation/state"]
    assert other.largest["surge_m_s"] > 2 * same.largest["surge_m_s"], "the filter began before the recording did"


def test_what_comes_out_is_written_and_compared_by_the_command(log: Path) -> None:
    out = log.with_name("out.mcap")
    done = CliRunner().invoke(app, ["replay", str(log), "--through", "allocator", "--json", "--output", str(out)])
    rows = {row["key"]: row for row in json.loads(done.stdout)["topics"]}
    written = Recording(out)
    assert written.topics["actuator/command"].messages == rows["actuator/command"]["replayed"]
    assert Allocator.name == next(written.messages("actuator/command")).message.source


@pytest.mark.parametrize(
    ("service", "kind", "reason"),
    [("camera_tracker", CliError, "more than the bus"), ("nobody", ConfigError, "no service is called")],
)
def test_what_cannot_be_replayed_is_refused(log: Path, service: str, kind: type[Exception], reason: str) -> None:
    error = CliRunner().invoke(app, ["replay", str(log), "--through", service]).exception
    assert isinstance(error, kind)
    assert reason in str(error)
