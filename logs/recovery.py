"""A complete file out of one whose recorder was killed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO, NamedTuple

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import Writer

from logs.container import RecordingError, data_records, open_file, read_contents


class Recovered(NamedTuple):
    """What came out of a recovery."""

    path: Path
    messages: int
    damaged_chunks: int


def recover(path: Path, output: Path | None = None) -> Recovered:
    """Write every intact record of a file to a complete one beside it (`NAME.recovered.mcap`).

    Raises RecordingError when `path` is complete or no recording, or `output` exists or cannot be written.
    """
    output = output or path.with_suffix(".recovered.mcap")
    partial = output.with_name(f".{output.name}.partial")
    with open_file(path) as source:
        if read_contents(source).complete:
            raise RecordingError(f"{path}: is complete; nothing to recover")
        if output.exists():
            raise RecordingError(f"{output}: exists already")
        try:
            with partial.open("wb") as target:
                messages, damaged = _copy(source, target)
            os.replace(partial, output)
        except OSError as error:
            partial.unlink(missing_ok=True)
            raise RecordingError(f"{output}: {error.strerror}") from None
    return Recovered(output, messages, damaged)


def _copy(source: IO[bytes], target: IO[bytes]) -> tuple[int, int]:
    writer = Writer(target)
    writer.start(profile="", library="starboard recovery")
    damaged: list[None] = []
    copier = _Copier(writer)
    for record in data_records(source, lambda: damaged.append(None)):
        copier.add(record)
    writer.finish()  # type: ignore[no-untyped-call]
    return copier.messages, len(damaged)


class _Copier:
    """Adds records to a writer under the numbers that it gives to schemas and channels."""

    def __init__(self, writer: Writer) -> None:
        self.messages = 0
        self._writer = writer
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}

    def add(self, record: McapRecord) -> None:
        if isinstance(record, Message):
            if record.channel_id in self._channels:  # otherwise the chunk that declares it is damaged
                number = self._channels[record.channel_id]
                self._writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
                self.messages += 1
        elif isinstance(record, Schema):
            if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            if record.id not in self._channels:
                schema = self._schemas.get(record.schema_id, 0)
                number = self._writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
                self._channels[record.id] = number
        elif isinstance(record, Metadata):
            self._writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
