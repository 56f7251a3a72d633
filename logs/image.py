"""Pictures in a recording: foxglove.CompressedImage, so that Foxglove shows them, with our header beside.

The header (frame number, size, source) travels in a field that foxglove's message does not have; other readers skip
it, as protobuf asks of unknown fields.
"""

from __future__ import annotations

from bus.clock import NS
from bus.messages import CameraImage

SCHEMA = "foxglove.CompressedImage"
_DATA_FIELD = 2
_HEADER_FIELD = 1000
_LENGTH_DELIMITED = 2


def image_schema() -> tuple[str, str, bytes]:
    """Return name, encoding and data of the schema."""
    from foxglove.messages import CompressedImage

    schema = CompressedImage.get_schema()
    return schema.name, schema.encoding, schema.data


def compressed_image(stamp_ns: int, header: bytes, jpeg: bytes) -> bytes:
    """Return a picture as protobuf: `stamp_ns` in UNIX ns, our JSON header, the JPEG bytes as they came."""
    from foxglove.messages import CompressedImage, Timestamp

    stamp = Timestamp(sec=min(stamp_ns // NS, 0xFFFFFFFF), nsec=stamp_ns % NS)
    image = CompressedImage(timestamp=stamp, frame_id="camera", data=jpeg, format="jpeg")
    return image.encode() + _varint(_HEADER_FIELD << 3 | _LENGTH_DELIMITED) + _varint(len(header)) + header


def camera_image(data: bytes) -> CameraImage:
    """Return a recorded picture; raise ValueError when it lacks our header. (foxglove-sdk writes but does not read.)"""
    fields = _length_delimited(data)
    if _HEADER_FIELD not in fields:
        raise ValueError("not written by starboard")
    return CameraImage.model_validate_json(fields[_HEADER_FIELD]).model_copy(
        update={"data": fields.get(_DATA_FIELD, b"")}
    )


def _length_delimited(data: bytes) -> dict[int, bytes]:
    """Return the fields of a protobuf message that has only strings, bytes and messages, as this one."""
    fields, at = {}, 0
    while at < len(data):
        tag, at = _read_varint(data, at)
        length, at = _read_varint(data, at)
        if tag & 7 != _LENGTH_DELIMITED or at + length > len(data):
            raise ValueError(f"not a {SCHEMA}")
        fields[tag >> 3] = data[at : at + length]
        at += length
    return fields


def _varint(value: int) -> bytes:
    coded = bytearray()
    while value > 0x7F:
        coded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*coded, value])


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(data):
        byte = data[at]
        value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
        if byte < 0x80:
            return value, at
    raise ValueError("protobuf ends within a number")
