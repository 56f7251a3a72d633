from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from platform_link.protocol import Command, Decoder, Telemetry, encode

hundredths = st.integers(-32767, 32767).map(lambda n: n / 100)
channels = st.lists(hundredths, max_size=64).map(tuple)
word = st.integers(0, 0xFFFF)
time_us = st.integers(0, 0xFFFFFFFF)
commands = st.builds(Command, word, time_us, channels)
battery = st.none() | st.integers(0, 0xFFFE).map(lambda mv: mv * 1e-3)
telemetry = st.builds(Telemetry, word, time_us, st.booleans(), st.booleans(), channels, battery, word, word)
message = commands | telemetry


@given(message)
def test_round_trip(sent: Any) -> None:
    decoder = Decoder()
    assert decoder.feed(encode(sent)) == [sent]
    assert (decoder.crc_errors, decoder.unknown, decoder.discarded_bytes) == (0, 0, 0)


@given(st.lists(message, max_size=8), st.data())
def test_any_chunking(sent: Any, data: st.DataObject) -> None:
    wire = b"".join(map(encode, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(wire)), max_size=20)))
    decoder = Decoder()
    received = [m for a, b in zip([0, *cuts], [*cuts, len(wire)], strict=True) for m in decoder.feed(wire[a:b])]
    assert received == sent
    assert decoder.crc_errors == 0


@given(message, message, message, st.data())
def test_a_flipped_bit_is_counted_and_spoils_no_other_frame(
    before: Any, hit: Any, after: Any, data: st.DataObject
) -> None:
    wire = bytearray(encode(hit))
    bit = data.draw(st.integers(0, 8 * len(wire) - 1))
    wire[bit // 8] ^= 1 << bit % 8
    decoder = Decoder()
    received = decoder.feed(encode(before) + bytes(wire) + encode(after))
    assert received[0] == before
    assert received[-1] == after
    assert decoder.crc_errors >= 1
    # A damaged delimiter leaves the frame itself intact when its neighbour's delimiter still bounds it.
    assert received[1:-1] in ([], [hit])
    if 0 < bit // 8 < len(wire) - 1:
        assert received[1:-1] == []


@given(st.lists(st.tuples(st.binary(max_size=600), message), min_size=1, max_size=5))
def test_noise_between_frames_loses_no_frame(pieces: Any) -> None:
    decoder = Decoder()
    received = decoder.feed(b"".join(noise + encode(m) for noise, m in pieces))
    assert [m for m in received if m in {m for _, m in pieces}] == [m for _, m in pieces]
    noisy = sum(bool(noise.strip(b"\0")) for noise, _ in pieces)
    assert decoder.crc_errors + decoder.unknown >= noisy
