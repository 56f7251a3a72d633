"""The recorder: everything on the bus into MCAP files."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from datetime import datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import Deployment, Section
from bus.messages import RecorderStatus
from bus.service import Output, RawInput, RawSample, Service
from logs.writer import LogWriter
from marine.vessel import Vessel

RETRY_S = 5.0
_MIB = 2**20
_DISTRIBUTIONS = ("starboard", "eclipse-zenoh", "numpy", "opencv-python-headless", "mcap", "pydantic")


class RecorderConfig(Section):
    """Section `[recorder]`."""

    enabled: bool = True
    rotate_mib: int = Field(2048, gt=0)
    """A new file begins when one has grown to this size."""
    min_free_mib: int = Field(500, ge=0)
    """Recording stops while the disk has less space."""


class Recorder(Service):
    """Record every topic that is to be logged, and every key that nobody declared.

    A file is flushed in each step, so that a killed recorder loses 0.2 s, and finished at the end. When the folder
    or the disk refuses, the recorder says so in its status, counts what it drops and tries again every 5 s.
    """

    name = "recorder"
    rate_hz = 5.0
    everything = RawInput("**")
    status = Output(topics.RECORDER_STATUS)

    def __init__(self, config: RecorderConfig, vessel: Vessel, deployment: Deployment) -> None:
        self._config = config
        self._vessel = vessel
        self._deployment = deployment
        self._writer: LogWriter | None = None
        self._error = ""
        self._retry_s = 0.0
        self._dropped = 0
        self._skipped: dict[str, bool] = {}
        self._status_s = 0.0
        self._told: tuple[str, str] | None = None

    def start(self, now_s: float) -> None:
        """Begin the first file."""
        if self._config.enabled:
            self._open(now_s)

    def step(self, now_s: float) -> None:
        """Write what has come."""
        samples = [s for s in self.everything.take() if not self._skip(s.key)]
        if self._config.enabled:
            if self._writer is None and now_s >= self._retry_s:
                self._open(now_s)
            self._write(samples, now_s)
            if self._writer is not None and self._writer.size_bytes >= self._config.rotate_mib * _MIB:
                self._finish(now_s)
                self._open(now_s)
        if now_s - self._status_s >= 1.0 - 1e-6 or self._told != self._summary():
            self._check_space(now_s)
            self._report(now_s)

    def stop(self, now_s: float) -> None:
        """Finish the file."""
        self._write([s for s in self.everything.take() if not self._skip(s.key)], now_s)
        self._finish(now_s)
        self._report(now_s)

    def _skip(self, key: str) -> bool:
        if key not in self._skipped:
            topic = topics.find(key)
            self._skipped[key] = topic is not None and not topic.logged
        return self._skipped[key]

    def _open(self, now_s: float) -> None:
        folder = self._deployment.recordings_dir
        now_ns = round(now_s * NS)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _require_space(folder, self._config.min_free_mib)
            path = _free_name(folder, now_s, self._vessel.name)
            metadata = {"vessel": self._vessel.name, "title": self._vessel.title} | _provenance(now_s)
            self._writer = LogWriter(path, self._vessel.name, metadata, self._attachments(), now_ns)
        except OSError as error:
            self._fail(error, now_s)
            return
        self._error = ""
        self.log.info("recording to %s", path)

    def _attachments(self) -> dict[str, bytes]:
        deployment = self._deployment
        found = {"topics.json": json.dumps(topic_table(), indent=1).encode()}
        for role, path in (("config", deployment.config_path), ("vessel", deployment.vessel_path)):
            if path is not None:
                found[f"{role}/{path.name}"] = path.read_bytes()
        return found

    def _write(self, samples: list[RawSample], now_s: float) -> None:
        if self._writer is None:
            self._dropped += len(samples) if self._config.enabled else 0
            return
        try:
            for sample in samples:
                try:
                    self._writer.write(sample)
                except ValueError:  # a picture without a header
                    self._dropped += 1
            self._writer.flush()
        except OSError as error:
            self._fail(error, now_s)

    def _finish(self, now_s: float) -> None:
        if self._writer is not None:
            try:
                self._writer.finish()
                self._writer = None
            except OSError as error:
                self._fail(error, now_s)

    def _check_space(self, now_s: float) -> None:
        if self._writer is not None:
            try:
                _require_space(self._writer.path, self._config.min_free_mib)  # also fails when somebody removed it
            except OSError as error:
                self._finish(now_s)
                self._fail(error, now_s)

    def _fail(self, error: OSError, now_s: float) -> None:
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None
        where = error.filename or self._deployment.recordings_dir
        reason = f"{where}: {error.strerror or error}"[:400]
        if reason != self._error:
            self.log.error("not recording: %s (trying again every %g s)", reason, RETRY_S)
        self._error = reason
        self._retry_s = now_s + RETRY_S

    def _summary(self) -> tuple[str, str]:
        return str(self._writer.path) if self._writer is not None else "", self._error

    def _report(self, now_s: float) -> None:
        file, error = self._told = self._summary()
        self._status_s = now_s
        self.status.publish(
            RecorderStatus(
                state="recording" if file else "error" if error else "idle",
                error=error,
                file=file,
                messages=self._writer.messages if self._writer is not None else 0,
                size_bytes=self._writer.size_bytes if self._writer is not None else 0,
                dropped=self._dropped + self.everything.dropped,
            )
        )


def topic_table() -> list[dict[str, object]]:
    """Return every declared topic with its JSON schema, units included."""
    return [
        {
            "key": t.key,
            "publisher": t.publisher,
            "doc": t.doc,
            "rate_hz": t.rate_hz,
            "schema": t.message.model_json_schema(mode="serialization"),
        }
        for t in topics.all_topics()
    ]


def _free_name(folder: Path, now_s: float, vessel: str) -> Path:
    stem = f"{datetime.fromtimestamp(now_s):%Y%m%d-%H%M%S}_{vessel}"
    path, number = folder / f"{stem}.mcap", 1
    while path.exists():  # restarted within the second
        number += 1
        path = folder / f"{stem}-{number}.mcap"
    return path


def _require_space(where: Path, min_free_mib: int) -> None:
    disk = os.statvfs(where)
    if disk.f_bavail * disk.f_frsize < min_free_mib * _MIB:
        raise OSError(0, f"less than {min_free_mib} MiB free on the disk", str(where))


def _provenance(now_s: float) -> dict[str, str]:
    """Return where a recording comes from: start, machine, source code, versions."""
    about = {
        "start": datetime.fromtimestamp(now_s).astimezone().isoformat(timespec="milliseconds"),
        "host": platform.node(),
        "python": platform.python_version(),
        "git_revision": git_revision(),
    }
    for name in _DISTRIBUTIONS:
        try:
            about[f"version/{name}"] = version(name)
        except PackageNotFoundError:
            about[f"version/{name}"] = "unknown"
    return about


@cache
def git_revision() -> str:
    """Return the revision of the source code that runs, with `-dirty` for local changes; `unknown` outside git."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=1.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()
