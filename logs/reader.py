"""Recordings for notebooks and tools: what is in them, messages as their classes, series as arrays."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel, Message, Schema
from numpy.typing import NDArray
from pydantic_core import from_json

from bus import topics
from bus.clock import NS
from bus.topics import Topic
from logs.container import RecordingError, data_records, open_file, read_contents, read_record
from logs.image import SCHEMA, camera_image


class TopicInfo(NamedTuple):
    """One variable of a recording."""

    key: str
    schema: str
    """Name of the message, empty where there is none."""
    messages: int
    rate_hz: float
    """Messages per second over the whole recording."""


class Entry(NamedTuple):
    """One recorded message."""

    key: str
    message: Any
    """The message in its class; what does not fit (another version, another program): a dict, or bytes."""
    log_ns: int
    """When the recorder received it."""
    publish_ns: int
    """Its stamp."""


class Recording:
    """One MCAP file, also one that was cut off.

    Keys are those of the bus, without the vessel: `navigation/state`. Raises RecordingError, one line, for a file
    that is none.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with open_file(self.path) as file:
            self._contents = read_contents(file)
            found = [read_record(file, head) for head in self._contents.metadata]
        self.metadata: dict[str, dict[str, str]] = {m.name: m.metadata for m in found}
        """What the recorder noted about the system: under `starboard` vessel, git revision, start, versions."""
        self.vessel: str = self.metadata.get("starboard", {}).get("vessel", "")
        self.complete: bool = self._contents.complete
        """Whether the file was finished. All else works on one that was not."""

    @property
    def start_ns(self) -> int:
        """When the first message came, UNIX ns; 0 when there is none."""
        return self._contents.start_ns or 0

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last."""
        return ((self._contents.end_ns or 0) - self.start_ns) / NS

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return self._contents.counts.total()

    @cached_property
    def topics(self) -> dict[str, TopicInfo]:
        """What was recorded, by key."""
        infos = (self._info(channel) for channel in self._contents.channels.values())
        return {info.key: info for info in sorted(infos)}

    def attachments(self) -> dict[str, bytes]:
        """Return the attached files by name: configuration, vessel, topics.json."""
        with open_file(self.path) as file:
            found = [read_record(file, head) for head in self._contents.attachments]
        return {a.name: a.data for a in found}

    def messages(self, *wanted: str | Topic[Any]) -> Iterator[Entry]:
        """Yield the messages of some topics (none named: of all) in the order in which they came."""
        for channel, schema, record in self._records([self._key_of(w) for w in wanted]):
            key = self._key(channel)
            message = _decode(key, schema, channel.message_encoding, record.data)
            yield Entry(key, message, record.log_time, record.publish_time)

    def series(self, topic: str | Topic[Any], *fields: str) -> dict[str, NDArray[Any]]:
        """Return fields of a topic as arrays, and with them `stamp_s` (UNIX time in s, float64).

        A field of a field is named with a dot: `commands.front_port`. Null becomes NaN. Raises KeyError for a topic
        that was not recorded, and for a field that a message does not have; TypeError for a topic of pictures.
        """
        key = self._key_of(topic)
        stamps: list[float] = []
        columns: list[list[Any]] = [[] for _ in fields]
        for channel, _, record in self._records([key]):
            if channel.message_encoding != "json":
                raise TypeError(f"{key}: is no JSON; use messages()")
            values = from_json(record.data)
            stamps.append(record.publish_time / NS)
            for column, name in zip(columns, fields, strict=True):
                column.append(_field(values, name))
        return {"stamp_s": np.array(stamps)} | {n: np.array(c) for n, c in zip(fields, columns, strict=True)}

    def _info(self, channel: Channel) -> TopicInfo:
        schema = self._contents.schemas.get(channel.schema_id)
        count = self._contents.counts[channel.id]
        rate_hz = count / self.duration_s if self.duration_s > 0 else 0.0
        return TopicInfo(self._key(channel), schema.name if schema else "", count, rate_hz)

    def _records(self, keys: list[str]) -> Iterator[tuple[Channel, Schema | None, Message]]:
        numbers = {n: c for n, c in self._contents.channels.items() if not keys or self._key(c) in keys}
        with open_file(self.path) as file:
            for record in data_records(file):
                if isinstance(record, Message) and (channel := numbers.get(record.channel_id)):
                    yield channel, self._contents.schemas.get(channel.schema_id), record

    def _key(self, channel: Channel) -> str:
        return channel.topic.removeprefix(f"{self.vessel}/")

    def _key_of(self, topic: str | Topic[Any]) -> str:
        key = topic.key if isinstance(topic, Topic) else topic.removeprefix(f"{self.vessel}/")
        if key not in self.topics:
            raise KeyError(f"{key}: was not recorded; there are {', '.join(self.topics)}")
        return key


def _decode(key: str, schema: Schema | None, encoding: str, data: bytes) -> Any:
    """Return a message in the best form there is: its class, the values of its JSON, its bytes."""
    name = schema.name if schema is not None else ""
    topic = topics.find(key)
    try:
        if encoding == "protobuf" and name == SCHEMA:
            return camera_image(data)
        if encoding != "json":
            return data
        if topic is not None and name == topic.message.__name__:
            with contextlib.suppress(ValueError):  # another version of the message
                return topic.message.decode(data)
        return from_json(data)
    except ValueError:
        return data


def _field(values: Any, name: str) -> Any:
    for part in name.split("."):
        values = values[part]
    return np.nan if values is None else values


__all__ = ["Entry", "Recording", "RecordingError", "TopicInfo"]
