"""Walks MCAP files, whole or cut off, by the heads of their records: <https://mcap.dev/spec>.

The mcap library reads a file through the summary at its end; a recorder that was killed leaves none. What a summary
says can be found again almost for nothing, because behind every chunk stand indexes that count its messages.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

_HEAD = struct.Struct("<BQ")
_FOOTER_SIZE = 20
_TAIL = _HEAD.size + _FOOTER_SIZE + len(MCAP0_MAGIC)
_TIMES = struct.Struct("<QQ")
_INDEX = struct.Struct("<HI")
_INDEX_ENTRY = 16


class RecordingError(Exception):
    """A file is no recording; one line."""


class Head(NamedTuple):
    """Where a record is: opcode, and offset and length of its content."""

    opcode: int
    offset: int
    length: int


@dataclass
class Contents:
    """What a file holds, as its summary says or as it was found again."""

    complete: bool
    """Whether the file has its end."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    """Messages per channel number."""
    start_ns: int | None = None
    end_ns: int | None = None
    metadata: list[Head] = field(default_factory=list)
    attachments: list[Head] = field(default_factory=list)

    def add(self, record: McapRecord) -> None:
        """Note a schema, a channel or a message."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Message):
            self.counts[record.channel_id] += 1
            self.extend(record.log_time, record.log_time)

    def extend(self, start_ns: int, end_ns: int) -> None:
        """Note a span of time that has messages."""
        self.start_ns = start_ns if self.start_ns is None else min(start_ns, self.start_ns)
        self.end_ns = end_ns if self.end_ns is None else max(end_ns, self.end_ns)


def open_file(path: Path) -> IO[bytes]:
    """Return an open MCAP file; raise RecordingError when it is none."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    magic = file.read(len(MCAP0_MAGIC))
    if magic != MCAP0_MAGIC:
        file.close()
        raise RecordingError(f"{path}: {'is empty' if not magic else 'is no MCAP file'}")
    return file


def heads(file: IO[bytes], start: int = len(MCAP0_MAGIC)) -> Iterator[Head]:
    """Yield the records that are in the file to their last byte, up to its end or its footer."""
    size = file.seek(0, 2)
    while start + _HEAD.size <= size:
        file.seek(start)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        offset, start = start + _HEAD.size, start + _HEAD.size + length
        if start > size or opcode == Opcode.FOOTER:
            return
        yield Head(opcode, offset, length)


def data_records(file: IO[bytes], on_damage: Callable[[], None] = lambda: None) -> Iterator[McapRecord]:
    """Yield schemas, channels, messages, metadata and attachments in the order of the file; skip damaged chunks."""
    for head in heads(file):
        if head.opcode == Opcode.DATA_END:
            return
        if head.opcode == Opcode.CHUNK:
            chunk = chunk_records(file, head)
            if chunk is None:
                on_damage()
            else:
                yield from chunk
        elif head.opcode in _DATA:
            yield read_record(file, head)


def chunk_records(file: IO[bytes], head: Head) -> list[McapRecord] | None:
    """Return the records of a chunk, None when it is damaged; raise RecordingError for an unknown compression."""
    try:
        return breakup_chunk(read_record(file, head), validate_crc=True)
    except UnsupportedCompressionError as error:
        raise RecordingError(str(error)) from None
    except (ValueError, struct.error, McapError, ZstdError):
        return None


def read_record(file: IO[bytes], head: Head) -> Any:
    """Return a record, parsed."""
    file.seek(head.offset)
    stream = ReadDataStream(BytesIO(file.read(head.length)))
    if head.opcode == Opcode.MESSAGE:
        return Message.read(stream, head.length)
    return _READ[head.opcode](stream)


_DATA = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA, Opcode.ATTACHMENT)
_READ: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
}


def read_contents(file: IO[bytes]) -> Contents:
    """Return what a file holds, from its summary or, where that is missing, from its chunks."""
    start = _summary_start(file)
    if start:
        contents = _from_summary(file, start)
        if contents is not None:
            return contents
    return _from_data(file, complete=start is not None)


def _summary_start(file: IO[bytes]) -> int | None:
    """Return where the summary begins, 0 when the file says that it has none, None when its end is missing."""
    size = file.seek(0, 2)
    file.seek(max(size - _TAIL, 0))
    tail = file.read()
    if len(tail) < _TAIL or not tail.endswith(MCAP0_MAGIC):
        return None
    if _HEAD.unpack_from(tail) != (Opcode.FOOTER, _FOOTER_SIZE):
        return None
    return int.from_bytes(tail[_HEAD.size : _HEAD.size + 8], "little")


def _from_summary(file: IO[bytes], start: int) -> Contents | None:
    contents = Contents(complete=True)
    statistics = None
    for head in heads(file, start):
        if head.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            contents.add(read_record(file, head))
        elif head.opcode == Opcode.STATISTICS:
            statistics = read_record(file, head)
        elif head.opcode == Opcode.METADATA_INDEX:
            contents.metadata.append(_indexed(Opcode.METADATA, read_record(file, head)))
        elif head.opcode == Opcode.ATTACHMENT_INDEX:
            contents.attachments.append(_indexed(Opcode.ATTACHMENT, read_record(file, head)))
    if statistics is None:
        return None
    contents.counts.update(statistics.channel_message_counts)
    if statistics.message_count:
        contents.extend(statistics.message_start_time, statistics.message_end_time)
    return contents


def _indexed(opcode: int, index: MetadataIndex | AttachmentIndex) -> Head:
    return Head(opcode, index.offset + _HEAD.size, index.length - _HEAD.size)


def _from_data(file: IO[bytes], *, complete: bool) -> Contents:
    contents = Contents(complete)
    chunk: Head | None = None
    counts: Counter[int] = Counter()
    for head in heads(file):
        if head.opcode == Opcode.MESSAGE_INDEX:
            file.seek(head.offset)
            channel, length = _INDEX.unpack(file.read(_INDEX.size))
            counts[channel] += length // _INDEX_ENTRY
            continue
        if chunk is not None and head.opcode == Opcode.CHUNK:
            _add_chunk(contents, file, chunk, counts)
            chunk, counts = None, Counter()
        if head.opcode == Opcode.CHUNK:
            chunk = head
        elif head.opcode == Opcode.METADATA:
            contents.metadata.append(head)
        elif head.opcode == Opcode.ATTACHMENT:
            contents.attachments.append(head)
        elif head.opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            contents.add(read_record(file, head))
        elif head.opcode == Opcode.DATA_END:
            break
    if chunk is not None:  # the indexes of the last one may be cut off
        _add_chunk(contents, file, chunk, Counter())
    return contents


def _add_chunk(contents: Contents, file: IO[bytes], chunk: Head, counts: Counter[int]) -> None:
    """Note a chunk by the counts of its indexes; open it only when these miss something."""
    if counts and counts.keys() <= contents.channels.keys():
        file.seek(chunk.offset)
        contents.extend(*_TIMES.unpack(file.read(_TIMES.size)))
        contents.counts.update(counts)
        return
    for record in chunk_records(file, chunk) or []:
        contents.add(record)
