"""What a page may say, and what becomes of it when it goes: ui.session without a socket."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bus import topics
from bus.messages import CameraImage, Message, OperatorJoystick, OperatorRequest, SimulationFault, Tuning, TuningRequest
from bus.topics import Topic
from ui.session import RATE_LIMIT, SILENCE_S, STICK_SILENCE_S, Session, Update, may_connect

STATUS: dict[str, int] = {"pages": 1}


class Bus:
    def __init__(self) -> None:
        self.sent: list[Message] = []
        self.session = Session("page-1", self.submit)

    def submit(self, topic: Topic[Any], message: Message) -> None:
        assert isinstance(message, topic.message)
        self.sent.append(message)

    def say(self, now_s: float = 0.0, **message: Any) -> str:
        return self.session.receive(json.dumps(message), now_s)

    @property
    def requests(self) -> list[OperatorRequest]:
        return [m for m in self.sent if isinstance(m, OperatorRequest)]

    @property
    def sticks(self) -> list[tuple[float, float, float]]:
        return [(m.surge, m.sway, m.yaw) for m in self.sent if isinstance(m, OperatorJoystick)]


@pytest.fixture
def bus() -> Bus:
    return Bus()


def frame_of(session: Session) -> dict[str, Any]:
    text = session.take(STATUS)[0]
    assert isinstance(text, str)
    frame = json.loads(text)
    assert isinstance(frame, dict)
    return frame


def test_a_mode_becomes_a_request_of_this_client_with_an_attended_lease(bus: Bus) -> None:
    assert bus.say(type="mode", request_id="r1", mode="hold", x_m=1.2, y_m=0.8, psi_rad=0.5, take=True) == ""
    request = bus.requests[0]
    assert (request.client, request.request_id, request.action, request.mode) == ("page-1", "r1", "mode", "hold")
    assert (request.x_m, request.y_m, request.psi_rad, request.take) == (1.2, 0.8, 0.5, True)
    assert request.attended
    assert request.lease_s == 3.0


def test_a_renewal_keeps_the_lease(bus: Bus) -> None:
    bus.say(type="renew")
    assert [(r.action, r.mode) for r in bus.requests] == [("renew", None)]


def test_closing_zeroes_the_stick_and_gives_the_lease_back(bus: Bus) -> None:
    bus.say(type="mode", request_id="r1", mode="manual")
    bus.say(type="joystick", surge=1.0, yaw=-0.5)
    bus.session.close()
    assert bus.sticks == [(1.0, 0.0, -0.5), (0.0, 0.0, 0.0)]
    assert [r.action for r in bus.requests] == ["mode", "release"]
    bus.session.close()
    assert len(bus.requests) == 2, "it is given back once"


def test_closing_a_page_that_only_watched_or_stopped_gives_nothing_back(bus: Bus) -> None:
    bus.say(type="alive")
    bus.session.close()
    assert bus.sent == []
    bus.say(type="mode", request_id="r", mode="stop")
    bus.sent.clear()
    bus.session.close()
    assert bus.sent == []


def test_a_deflected_stick_is_let_go_after_a_short_silence_and_the_page_after_a_long_one(bus: Bus) -> None:
    assert bus.session.patience_s == SILENCE_S
    bus.say(type="joystick", sway=0.3)
    assert bus.session.patience_s == STICK_SILENCE_S
    assert bus.session.fall_silent() is False
    assert bus.sticks[-1] == (0.0, 0.0, 0.0)
    assert bus.session.patience_s == SILENCE_S
    assert bus.session.fall_silent() is True


@pytest.mark.parametrize(
    "nonsense",
    [
        b"",
        b"\xff\xfe\x00",
        "not json",
        "[]",
        "null",
        "{}",
        '{"type":"launch"}',
        '{"type":"joystick","surge":1.5}',
        '{"type":"joystick","surge":NaN}',
        '{"type":"joystick","surge":1e400}',
        '{"type":"mode","request_id":"a","mode":"fly"}',
        '{"type":"mode","mode":"stop"}',
        '{"type":"mode","request_id":"' + "a" * 65 + '","mode":"stop"}',
        '{"type":"renew","client":"page-2"}',
        '{"type":"poke","key":"helm/wrench","value":{}}',
        '{"type":"fault","fault":{"kind":"sink"}}',
        "[" * 10_000,
    ],
)
def test_nonsense_is_counted_answered_in_one_line_and_published_nowhere(bus: Bus, nonsense: str | bytes) -> None:
    reason = bus.session.receive(nonsense, 0.0)
    assert reason
    assert "\n" not in reason
    assert bus.session.refused == 1
    assert bus.sent == []
    assert frame_of(bus.session)["refused"] == reason
    assert "refused" not in frame_of(bus.session), "said once"
    assert bus.say(type="mode", request_id="r", mode="stop") == "", "the session goes on"


def test_a_flood_is_cut_but_a_stop_gets_through(bus: Bus) -> None:
    answers = [bus.say(5.0, type="joystick", surge=0.1) for _ in range(RATE_LIMIT + 50)]
    assert answers.count("") == RATE_LIMIT
    assert len(bus.sticks) == RATE_LIMIT
    assert bus.say(5.9, type="mode", request_id="r", mode="stop") == ""
    assert bus.say(5.9, type="mode", request_id="r", mode="manual") != ""
    assert bus.say(6.0, type="mode", request_id="r", mode="manual") == ""


def test_a_fault_cannot_forge_its_header(bus: Bus) -> None:
    bus.say(type="fault", fault={"kind": "current", "x_m_s": 0.05, "stamp_ns": 7, "origin_ns": 7})
    fault = bus.sent[0]
    assert isinstance(fault, SimulationFault)
    assert (fault.kind, fault.x_m_s, fault.stamp_ns, fault.origin_ns) == ("current", 0.05, 0, None)


def test_a_slow_page_gets_the_newest_values_and_every_answer_of_its_own(bus: Bus) -> None:
    for i in range(1000):
        own = "page-1" if i % 500 == 0 else "page-2"
        answer = (own, b'{"request_id":"%d"}' % i)
        bus.session.offer(Update(i, {"navigation/state": b'{"x_m":%d}' % i}, answers=(answer,)))
    frame = frame_of(bus.session)
    assert frame["now_ns"] == 999
    assert frame["values"] == {"navigation/state": {"x_m": 999}}
    assert [a["request_id"] for a in frame["answers"]] == ["0", "500"]
    assert frame["server"] == {"client": "page-1", "pages": 1}
    assert frame_of(bus.session)["values"] == {}


def test_a_picture_goes_as_it_is_with_its_key(bus: Bus) -> None:
    payload = CameraImage(frame=7, width_px=2, height_px=2, data=b"\xff\xd8jpeg").encode()
    for old in (b"old", payload):
        bus.session.offer(Update(0, {}, {topics.CAMERA_IMAGE.key: old}))
    pictures = bus.session.take(STATUS)[1:]
    assert len(pictures) == 1
    (message,) = pictures
    assert isinstance(message, bytes)
    end = 1 + message[0]
    assert message[1:end] == b"camera/image"
    assert CameraImage.decode(message[end:]).data == b"\xff\xd8jpeg"


def test_a_key_with_quotes_does_not_break_the_frame(bus: Bus) -> None:
    bus.session.offer(Update(0, {'odd"key': b"{}"}))
    assert frame_of(bus.session)["values"] == {'odd"key': {}}


@pytest.mark.parametrize(
    ("origin", "host", "expected"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://192.168.1.5:8080", "192.168.1.5:8080", True),
        ("https://pool.lab", "pool.lab", True),
        (None, "127.0.0.1:8080", True),
        ("http://evil.example", "127.0.0.1:8080", False),
        ("http://127.0.0.1:9999", "127.0.0.1:8080", False),
        ("http://evil.example:8080", "evil.example:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("http://[", "127.0.0.1:8080", False),
    ],
)
def test_only_our_own_page_may_connect(origin: str | None, host: str, expected: bool) -> None:
    assert may_connect(origin, host, ("pool.lab",)) is expected


def test_a_tuning_becomes_a_request_of_this_client_and_takes_no_lease(bus: Bus) -> None:
    assert bus.say(type="tuning", request_id="t1", tuning={"law": "ipd", "parameters": {"w0_rad_s": 0.8}}) == ""
    assert bus.say(type="tuning", request_id="t2", tuning=None) == ""
    assert bus.sent == [
        TuningRequest(request_id="t1", client="page-1", tuning=Tuning(law="ipd", parameters={"w0_rad_s": 0.8})),
        TuningRequest(request_id="t2", client="page-1", tuning=None),
    ]
    assert "law" in bus.say(type="tuning", request_id="t3", tuning={})
