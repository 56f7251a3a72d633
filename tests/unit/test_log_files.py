"""What is written can be read: by us, and by mcap's own reader."""

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from bus import messages as m
from bus import topics
from bus.clock import NS
from bus.service import RawSample
from logs.container import RecordingError
from logs.reader import Recording
from logs.recovery import recover
from logs.writer import LogWriter

T0_NS = 1_700_000_000 * NS
JPEG = b"\xff\xd8" + bytes(range(256)) * 20 + b"\xff\xd9"


def state(i: int) -> m.NavigationState:
    return m.NavigationState(
        stamp_ns=T0_NS + i * 10_000_000,
        seq=i,
        source="estimator",
        status="tracking",
        x_m=i * 0.1,
        y_m=1.0,
        z_m=None,
        psi_rad=0.5,
        surge_m_s=0.0,
        sway_m_s=0.0,
        yaw_rad_s=0.0,
        measurement_age_s=0.0,
    )


def image(i: int) -> m.CameraImage:
    stamp_ns = T0_NS + i * 10_000_000
    return m.CameraImage(
        stamp_ns=stamp_ns, seq=i, source="camera_tracker", frame=7 * i, width_px=8, height_px=6, data=JPEG
    )


def sample(topic: topics.Topic[Any], message: m.Message, delay_ns: int = 2_000_000) -> RawSample:
    return RawSample(topic.key, message.encode(), message.stamp_ns + delay_ns)


def write(path: Path, count: int = 100, *, flush_every: int = 10) -> LogWriter:
    writer = LogWriter(path, "pladypos", {"vessel": "pladypos", "note": "x"}, {"vessel/pladypos.toml": b"a = 1"}, T0_NS)
    for i in range(count):
        writer.write(sample(topics.NAVIGATION_STATE, state(i)))
        if i % 10 == 0:
            writer.write(sample(topics.CAMERA_IMAGE, image(i)))
            commands = m.ActuatorCommand(
                stamp_ns=state(i).stamp_ns, seq=i, source="a", commands={"front_port": i, "b": 0.5}
            )
            writer.write(sample(topics.ACTUATOR_COMMAND, commands))
        if i % flush_every == 0:
            writer.flush()
    return writer


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "a.mcap"
    write(path).finish()
    return path


def test_messages_come_back_as_they_were(path: Path) -> None:
    recording = Recording(path)
    assert recording.complete
    assert (recording.vessel, recording.message_count, recording.duration_s) == ("pladypos", 120, 0.99)
    assert {k: t.messages for k, t in recording.topics.items()} == {
        "actuator/command": 10,
        "camera/image": 10,
        "navigation/state": 100,
    }
    assert recording.topics["navigation/state"].rate_hz == pytest.approx(100 / 0.99)
    entries = list(recording.messages(topics.NAVIGATION_STATE))
    assert [e.message for e in entries] == [state(i) for i in range(100)]
    assert entries[3].publish_ns == state(3).stamp_ns
    assert entries[3].log_ns == state(3).stamp_ns + 2_000_000
    assert [e.message for e in recording.messages("camera/image")] == [image(10 * i) for i in range(10)]
    assert len(list(recording.messages())) == 120
    assert recording.metadata["starboard"]["note"] == "x"
    assert recording.attachments() == {"vessel/pladypos.toml": b"a = 1"}


def test_series(path: Path) -> None:
    recording = Recording(path)
    series = recording.series("navigation/state", "x_m", "z_m", "status")
    np.testing.assert_allclose(series["x_m"], np.arange(100) * 0.1)
    np.testing.assert_allclose(np.diff(series["stamp_s"]), 0.01, atol=1e-6)
    assert np.isnan(series["z_m"]).all()
    assert set(series["status"]) == {"tracking"}
    np.testing.assert_array_equal(
        recording.series(topics.ACTUATOR_COMMAND, "commands.front_port")["commands.front_port"], range(0, 100, 10)
    )
    with pytest.raises(KeyError, match="helm/state: was not recorded; there are actuator/command"):
        recording.series("helm/state", "x_m")
    with pytest.raises(KeyError, match="nonsense"):
        recording.series("navigation/state", "nonsense")
    with pytest.raises(TypeError, match=r"use messages\(\)"):
        recording.series("camera/image", "frame")


def test_mcaps_own_reader_sees_schemas_units_and_pictures(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = {c.topic: (s, c, r) for s, c, r in reader.iter_messages()}
        schema, channel, record = found["pladypos/navigation/state"]
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == ("NavigationState", "jsonschema", "json")
        described = json.loads(schema.data)
        assert described["type"] == "object"
        assert described["properties"]["x_m"]["unit"] == "m"
        assert record.sequence == 99
        assert record.publish_time == state(99).stamp_ns
        assert json.loads(record.data)["x_m"] == pytest.approx(9.9)
        schema, channel, record = found["pladypos/camera/image"]
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == (
            "foxglove.CompressedImage",
            "protobuf",
            "protobuf",
        )
        assert record.data.count(JPEG) == 1


def test_what_nobody_declared_is_kept_as_it_came(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "a.mcap", "v", {"vessel": "v"}, {}, T0_NS)
    deep = b"[" * 100_000
    for key, payload in [("my/json", b'{"a": [1, null]}'), ("my/bytes", b"\x00\xff"), ("my/deep", deep)]:
        writer.write(RawSample(key, payload, T0_NS))
    writer.write(RawSample("helm/state", b'{"mode": "?"}', T0_NS))
    with pytest.raises(ValueError, match="shorter"):
        writer.write(RawSample("camera/image", b"\xff\xff\xff\xff", T0_NS))
    writer.finish()
    recording = Recording(tmp_path / "a.mcap")
    assert {e.key: e.message for e in recording.messages()} == {
        "my/json": {"a": [1, None]},
        "my/bytes": b"\x00\xff",
        "my/deep": deep,
        "helm/state": {"mode": "?"},
    }
    assert recording.topics["my/json"].schema == ""
    assert {e.publish_ns for e in recording.messages()} == {T0_NS}


def whole_before(cut: int, path: Path) -> int:
    """Return how many messages mcap's own reader finds in the chunks that end before `cut`."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        ends = [c.message_end_time for c in summary.chunk_indexes if c.chunk_start_offset + c.chunk_length <= cut]
        return sum(r.log_time <= ends[-1] for *_, r in make_reader(file).iter_messages()) if ends else 0


def test_a_file_cut_anywhere_gives_all_that_was_whole(tmp_path: Path, path: Path) -> None:
    whole = path.read_bytes()
    expected = list(Recording(path).messages())
    draw = random.Random(1)
    for cut in [*(draw.randrange(8, len(whole)) for _ in range(60)), len(whole) - 1, len(whole) - 8, 8, 9]:
        part = tmp_path / "cut.mcap"
        part.write_bytes(whole[:cut])
        recording = Recording(part)
        found = list(recording.messages())
        assert not recording.complete
        assert found == expected[: len(found)]
        assert recording.message_count == len(found) == whole_before(cut, path)
        assert sum(t.messages for t in recording.topics.values()) == len(found)
        done = recover(part)
        again = Recording(done.path)
        assert again.complete
        assert (done.messages, done.damaged_chunks) == (len(found), 0)
        assert list(again.messages()) == found
        assert again.metadata == recording.metadata
        with done.path.open("rb") as file:
            assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(found)
        done.path.unlink()


def test_a_damaged_chunk_is_left_out_and_counted(tmp_path: Path, path: Path) -> None:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[3]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    part = tmp_path / "damaged.mcap"
    part.write_bytes(data[:-100])
    done = recover(part)
    assert done.damaged_chunks == 1
    assert done.messages == 120 - 12
    assert len(list(Recording(part).messages())) == 108


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "is empty"), (b"\x00" * 100, "is no MCAP file"), (b"\x89MCA", "is no MCAP file"), (None, "No such file")],
)
def test_what_is_no_recording_gives_one_line(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=message) as caught:
        Recording(path)
    assert "\n" not in str(caught.value)


def test_a_complete_file_is_not_recovered(path: Path) -> None:
    with pytest.raises(RecordingError, match="nothing to recover"):
        recover(path)


WRITER = """
import sys, time
from pathlib import Path
sys.path.insert(0, {root!r})
from bus import topics
from bus.service import RawSample
from tests.unit.{module} import LogWriter, state
writer = LogWriter(Path({path!r}), "pladypos", {{"vessel": "pladypos"}}, {{}}, 0)
flushed, i = time.time(), 0
while True:
    writer.write(RawSample("navigation/state", state(i).encode(), time.time_ns()))
    i += 1
    time.sleep(0.002)
    if time.time() - flushed >= 0.2:
        writer.flush()
        flushed = time.time()
    print(i, time.time_ns(), flush=True)
"""


def test_a_killed_writer_loses_no_more_than_its_flush_period(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    code = WRITER.format(root=str(Path(__file__).parents[2]), module=Path(__file__).stem, path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            written, last_ns = map(int, line.split())
            if written >= 300:
                break
        process.kill()
    recording = Recording(path)
    assert not recording.complete
    found = list(recording.messages())
    assert [e.message.seq for e in found] == list(range(len(found)))
    assert (last_ns - found[-1].log_ns) / NS <= 0.3
