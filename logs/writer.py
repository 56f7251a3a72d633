"""Bus messages into an MCAP file that Foxglove, the mcap tools and `logs.reader` open.

What is only recorded is not decoded: JSON goes in as it came, described by the JSON schema of its message class;
pictures become foxglove.CompressedImage (protobuf) around the JPEG bytes as they came.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from mcap.writer import Writer

from bus import topics
from bus.messages import CameraImage, Message, split_image
from bus.service import RawSample
from logs.image import compressed_image, image_schema

_HEADER = re.compile(rb'\s*\{\s*"stamp_ns"\s*:\s*(\d{1,19})\s*,\s*"seq"\s*:\s*(\d{1,18})\D')
"""How every message of ours begins (bus.messages.Message)."""


class LogWriter:
    """Writes one recording. Chunks of 1 MiB, zstd; what was flushed survives the death of the process.

    Channels are called `<vessel>/<key>`; log_time is the arrival, publish_time the message's stamp and sequence its
    seq (arrival and 0 where a message does not begin with them). Every method raises OSError when the disk refuses.
    """

    def __init__(
        self, path: Path, vessel: str, metadata: Mapping[str, str], attachments: Mapping[str, bytes], now_ns: int
    ) -> None:
        self.path = path
        self.messages = 0
        self._vessel = vessel
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, _Channel] = {}
        self._file = path.open("xb")
        self._writer = Writer(self._file)
        try:
            self._writer.start(profile="", library="starboard")
            self._writer.add_metadata("starboard", dict(metadata))
            for name, data in attachments.items():
                self._writer.add_attachment(now_ns, now_ns, name, _media_type(name), data)
            self.flush()
        except OSError:
            self.abandon()
            path.unlink(missing_ok=True)  # nothing is in it
            raise

    @property
    def size_bytes(self) -> int:
        """The size of the file so far."""
        return self._file.tell()

    def write(self, sample: RawSample) -> None:
        """Add a message as it came; raise ValueError when it is a picture without a valid header."""
        channel = self._channels.get(sample.key) or self._register(sample)
        payload = head = sample.payload
        if channel.image:
            head, jpeg = split_image(payload)
        found = _HEADER.match(head)
        stamp_ns, seq = (int(found[1]), int(found[2])) if found else (sample.received_ns, 0)
        if channel.image:
            payload = compressed_image(stamp_ns, head, jpeg)
        self._writer.add_message(channel.id, sample.received_ns, payload, stamp_ns, seq & 0xFFFFFFFF)
        self.messages += 1

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the summary and close the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def abandon(self) -> None:
        """Close the file without a summary, after an error: what was flushed can be recovered."""
        with contextlib.suppress(OSError):  # its buffer cannot be written either; the descriptor is closed all the same
            self._file.close()

    def _register(self, sample: RawSample) -> _Channel:
        topic = topics.find(sample.key)
        about: dict[str, str] = {}
        image, schema_id, encoding = False, 0, "json"
        if topic is None:
            encoding = "json" if _is_json(sample.payload) else "application/octet-stream"
        else:
            image = topic.message is CameraImage
            encoding = "protobuf" if image else "json"
            schema_id = self._schema(topic.message)
            about = {"publisher": topic.publisher, "doc": topic.doc}
        number = self._writer.register_channel(f"{self._vessel}/{sample.key}", encoding, schema_id, about)
        channel = self._channels[sample.key] = _Channel(number, image)
        return channel

    def _schema(self, message: type[Message]) -> int:
        name = message.__name__
        if name not in self._schemas:
            if message is CameraImage:
                self._schemas[name] = self._writer.register_schema(*image_schema())
            else:
                text = json.dumps(message.model_json_schema(mode="serialization"))
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", text.encode())
        return self._schemas[name]


class _Channel(NamedTuple):
    id: int
    image: bool


def _is_json(payload: bytes) -> bool:
    try:
        json.loads(payload)
    except (ValueError, RecursionError):
        return False
    return True


def _media_type(name: str) -> str:
    return {".toml": "application/toml", ".json": "application/json"}.get(Path(name).suffix, "text/plain")
