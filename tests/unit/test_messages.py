"""Messages: strict, with units, the same after the wire."""

import json
import typing

import pytest
from pydantic import ValidationError

from bus import messages as m
from bus.messages import CameraImage, CameraPose, Message, Wrench, split_image
from bus.topics import all_topics, find
from bus.units import SUFFIXES, unit_of

ALL = sorted({t.message for t in all_topics()}, key=lambda c: c.__name__)
WITHOUT_UNIT = {"commands", "quality", "fraction", "surge", "sway", "heave", "yaw", "rate", "progress", "spread"}
WITHOUT_UNIT |= {"ratio"}  # of likelihoods
# of an experiment, in the unit of its axis, as the message's `unit` says
WITHOUT_UNIT |= {"force", "amplitude", "bias", "measured", "simulated"}
WITHOUT_UNIT |= {"warp", "warp_reached"}  # factors of time


@pytest.mark.parametrize("message", ALL, ids=lambda c: c.__name__)
def test_every_number_states_its_unit_or_is_known_to_have_none(message: type[Message]) -> None:
    for name, field in message.model_fields.items():
        kinds = {field.annotation, *typing.get_args(field.annotation)}
        if float in kinds:
            assert unit_of(name) or name in WITHOUT_UNIT, f"{message.__name__}.{name} has no unit in its name"


@pytest.mark.parametrize("message", ALL, ids=lambda c: c.__name__)
def test_units_stand_in_the_schema(message: type[Message]) -> None:
    properties = message.model_json_schema()["properties"]
    assert properties["stamp_ns"]["unit"] == "ns"
    for name, schema in properties.items():
        assert schema.get("unit", "") == unit_of(name)


def test_the_longer_suffix_wins() -> None:
    assert unit_of("surge_m_s") == "m/s"
    assert unit_of("yaw_rad_s") == "rad/s"
    assert unit_of("yaw_nm") == "Nm"
    assert unit_of("width_px") == "px"
    assert unit_of("frames") == ""
    assert all(unit_of(f"x_{suffix}") == unit for suffix, unit in SUFFIXES.items())


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xff\x00\x12",
        b'{"surge_n": 1.0',
        b'{"surge_n": "much"}',
        b'{"surge_n": NaN}',
        b'{"surge_n": 1e999}',
        b'{"surge_n": 1.0, "torque": 2}',
        b'{"stamp_ns": -1}',
        b'{"stamp_ns": 1e30}',
        b"[]",
    ],
)
def test_malformed_payloads_are_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Wrench.decode(payload)


def test_messages_do_not_change() -> None:
    wrench = Wrench(surge_n=1.0)
    with pytest.raises(ValidationError):
        wrench.surge_n = 2.0  # type: ignore[misc]


def test_floats_survive_the_wire_exactly() -> None:
    pose = CameraPose(frame=7, x_px=0.1 + 0.2, y_px=1e-17, psi_rad=-3.141592653589793, quality=1.0, stamp_ns=2**62)
    assert CameraPose.decode(pose.encode()) == pose


def test_a_message_that_was_sent_stays_as_it_is() -> None:
    wrench = Wrench(surge_n=1.5, origin_ns=9)
    first = wrench.stamped(7, 3, "helm")
    assert first == Wrench(surge_n=1.5, origin_ns=9, stamp_ns=7, seq=3, source="helm")
    again = first.stamped(8, 4, "helm")
    assert again == Wrench(surge_n=1.5, origin_ns=9, stamp_ns=8, seq=4, source="helm")
    assert Wrench.decode(first.encode()) == first
    assert first.seq == 3


def test_a_stamp_that_its_maker_gave_a_message_stays() -> None:
    of_frame = Wrench(surge_n=1.5, stamp_ns=5).stamped(7, 0, "helm")
    assert (of_frame.stamp_ns, of_frame.stamped(8, 1, "other").stamp_ns) == (5, 5)


def test_an_image_keeps_its_bytes_and_is_refused_when_cut() -> None:
    image = CameraImage(frame=3, width_px=800, height_px=600, data=b"\xff\xd8jpeg\x00")
    wire = image.encode()
    header, data = split_image(wire)
    assert json.loads(header)["frame"] == 3
    assert data == image.data
    assert CameraImage.decode(wire).data == image.data
    for broken in (b"", wire[:3], wire[:9], b"\xff\xff\xff\x7f{}"):
        with pytest.raises(ValueError, match=r"\w"):
            CameraImage.decode(broken)


def test_keys_find_their_topics() -> None:
    assert find("navigation/state") is not None
    heartbeat = find("service/helm/heartbeat")
    assert heartbeat is not None
    assert heartbeat.publisher == "helm"
    assert find("service/helm/other") is None
    assert find("nonsense") is None


def test_the_six_components_keep_their_order() -> None:
    wrench = Wrench(surge_n=1, sway_n=2, heave_n=3, roll_nm=4, pitch_nm=5, yaw_nm=6)
    assert wrench.vector() == (1, 2, 3, 4, 5, 6)
    assert Wrench(yaw_nm=6).vector() == (0, 0, 0, 0, 0, 6)
    assert len(m.AXES) == 6
