import random
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import pytest

from bus import topics
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import ActuatorCommand, CameraImage, OperatorJoystick, RecorderStatus
from bus.service import RawSample
from logs.reader import Recording
from logs.recorder import Recorder, RecorderConfig
from services.vessels import VESSELS_DIR, load_vessel, vessel_path

VESSEL = load_vessel("pladypos")
Make = Callable[..., Recorder]


@pytest.fixture
def deployment(tmp_path: Path) -> Deployment:
    config = tmp_path / "pool.toml"
    config.write_text("[system]\n")
    return Deployment(config_path=config, vessel_path=vessel_path("pladypos"), recordings_dir=tmp_path / "recordings")


@pytest.fixture
def make(deployment: Deployment) -> Iterator[Make]:
    made: list[Recorder] = []

    def recorder(**config: int | bool) -> Recorder:
        made.append(Recorder(RecorderConfig.model_validate({"min_free_mib": 0} | config), VESSEL, deployment))
        return made[-1]

    yield recorder
    for service in made:
        if service._writer is not None:  # what the kernel does for a killed process
            service._writer.abandon()


def files(deployment: Deployment) -> list[Path]:
    return sorted(deployment.recordings_dir.glob("*.mcap"))


def status(bus: MemoryBus) -> RecorderStatus:
    found = bus.last(topics.RECORDER_STATUS)
    assert found is not None
    return found


def drive(bus: MemoryBus, seconds: float) -> None:
    for _ in range(round(seconds * 20)):
        bus.publish(topics.OPERATOR_JOYSTICK, OperatorJoystick(client="test", surge=0.5), source="page")
        bus.run_for(0.05)


def test_everything_is_recorded_with_its_origin(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make())
    drive(bus, 2.0)
    bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=1, width_px=2, height_px=3, data=b"jpeg"))
    bus.publish(topics.ACTUATOR_COMMAND, ActuatorCommand(commands={"front_port": 3.0}))
    bus.run_for(0.3)
    now = status(bus)
    [path] = files(deployment)
    assert (now.state, now.error, now.file, now.dropped) == ("recording", "", str(path), 0)
    assert now.size_bytes > 0
    assert path.name.endswith("_pladypos.mcap")
    bus.stop("recorder")
    assert status(bus).state == "idle"
    recording = Recording(path)
    assert recording.complete
    assert recording.topics["operator/joystick"].messages == 40
    assert recording.topics["operator/joystick"].rate_hz == pytest.approx(20, rel=0.2)
    assert [e.message.data for e in recording.messages(topics.CAMERA_IMAGE)] == [b"jpeg"]
    assert {"recorder/status", "service/recorder/heartbeat", "actuator/command"} < recording.topics.keys()
    about = recording.metadata["starboard"]
    head = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False, cwd=VESSELS_DIR)
    assert about["vessel"] == "pladypos"
    assert about["git_revision"].removesuffix("-dirty") == (head.stdout[:12] or "unknown")
    assert about["version/mcap"].startswith("1.")
    attached = recording.attachments()
    assert attached["vessel/pladypos.toml"] == vessel_path("pladypos").read_bytes()
    assert attached["config/pool.toml"] == b"[system]\n"
    assert b'"unit": "m/s"' in attached["topics.json"]


def test_a_restarted_recorder_starts_a_new_file(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    for _ in range(3):
        bus.add(make())
        drive(bus, 0.5)
    bus.stop("recorder")
    assert [Recording(path).complete for path in files(deployment)].count(True) == 1
    assert [Recording(path).topics["operator/joystick"].messages >= 8 for path in files(deployment)] == [True] * 3


def test_a_killed_recorder_loses_a_step_at_most(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make())
    drive(bus, 1.0)
    bus.kill("recorder")
    last = list(Recording(files(deployment)[0]).messages(topics.OPERATOR_JOYSTICK))[-1]
    assert bus.now_s - last.log_ns * 1e-9 <= 0.3


def test_switched_off(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make(enabled=False))
    drive(bus, 1.0)
    assert status(bus).state == "idle"
    assert status(bus).dropped == 0
    assert not deployment.recordings_dir.exists()


def test_a_folder_that_cannot_be_written(make: Make, deployment: Deployment, caplog: pytest.LogCaptureFixture) -> None:
    deployment.recordings_dir.write_text("a file where the folder should be")
    bus = MemoryBus()
    bus.add(make())
    drive(bus, 12.0)
    now = status(bus)
    assert (now.state, now.file) == ("error", "")
    assert "recordings: File exists" in now.error
    assert now.dropped > 200
    assert len([r for r in caplog.records if "not recording" in r.message]) == 1
    deployment.recordings_dir.unlink()
    drive(bus, 6.0)
    assert status(bus).state == "recording"
    assert status(bus).error == ""


def test_too_little_space(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make(min_free_mib=2**40))
    drive(bus, 1.0)
    assert status(bus).state == "error"
    assert "MiB free" in status(bus).error
    assert files(deployment) == []


def test_a_disk_that_fills_ends_the_file_and_is_tried_again(
    make: Make, deployment: Deployment, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = MemoryBus()
    service = make()
    bus.add(service)
    drive(bus, 1.0)
    full = Full(service)
    monkeypatch.setattr(service._writer, "_file", full)
    monkeypatch.setattr(service._writer._writer, "_Writer__stream", full)  # type: ignore[union-attr]
    drive(bus, 2.0)
    assert status(bus).state == "error"
    assert "No space left on device" in status(bus).error
    drive(bus, 5.0)
    assert status(bus).state == "recording"
    first, second = files(deployment)
    assert Recording(first).topics["operator/joystick"].messages >= 15
    bus.stop("recorder")
    assert Recording(second).complete


class Full:
    """A file on a disk without space."""

    error: ClassVar[OSError] = OSError(28, "No space left on device")

    def __init__(self, service: Recorder) -> None:
        assert service._writer is not None
        self._file = service._writer._file

    def write(self, data: bytes) -> int:
        raise self.error

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()
        raise self.error


def test_a_recording_that_somebody_removed_is_begun_again(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make())
    drive(bus, 1.0)
    files(deployment)[0].unlink()
    drive(bus, 8.0)
    assert status(bus).state == "recording"
    assert Path(status(bus).file).exists()


def test_a_big_file_is_followed_by_the_next(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    bus.add(make(rotate_mib=1))
    for i in range(30):
        picture = random.Random(i).randbytes(100_000)
        bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=i, width_px=2, height_px=3, data=picture))
        bus.publish(topics.CAMERA_IMAGE, CameraImage(frame=i, width_px=2, height_px=3, data=b"\xff"))
        bus.run_for(0.2)
    bus.stop("recorder")
    recordings = [Recording(path) for path in files(deployment)]
    assert len(recordings) == 4  # 3 MB of noise, and a last one just begun
    assert all(r.complete for r in recordings)
    assert sum(r.topics["camera/image"].messages for r in recordings if "camera/image" in r.topics) == 60


def test_a_malformed_picture_is_dropped_and_counted(make: Make, deployment: Deployment) -> None:
    bus = MemoryBus()
    service = make()
    bus.add(service)
    service.everything.offer(RawSample("camera/image", b"\xff\xff\xff\xff", bus.clock.now_ns()))
    bus.run_for(1.5)
    assert status(bus).dropped == 1
    assert status(bus).state == "recording"
