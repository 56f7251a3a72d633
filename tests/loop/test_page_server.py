"""The page's server on a running star, with a bare websocket in place of the browser."""

from __future__ import annotations

import json
import logging
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bus import messages as m
from bus import topics
from bus.memory_bus import MemoryBus
from bus.service import RawSample
from services.vessels import load_vessel
from tests.browser.fake_star import VESSEL, FakeStar, wait_for
from ui.server import Page, PageConfig


@pytest.fixture
def star() -> Iterator[FakeStar]:
    with FakeStar().running() as star:
        yield star


def open_page(star: FakeStar, origin: Any = None, max_queue: int = 16) -> AbstractContextManager[ClientConnection]:
    page: AbstractContextManager[ClientConnection] = connect(
        star.url.replace("http", "ws") + "ws", origin=origin, max_queue=max_queue, close_timeout=0.2
    )
    return page


def frames(page: ClientConnection) -> Iterator[dict[str, Any]]:
    while True:
        data = page.recv(timeout=3.0)
        if isinstance(data, str):
            yield json.loads(data)


def say(page: ClientConnection, **message: Any) -> None:
    page.send(json.dumps(message))


def test_a_page_gets_everything_as_it_is_on_the_bus(star: FakeStar) -> None:
    with open_page(star) as page:
        seen: dict[str, Any] = {}
        for frame in frames(page):
            seen |= frame["values"]
            if {"navigation/state", "recorder/status", "service/helm/heartbeat"} <= seen.keys():
                break
        for key, value in seen.items():
            topic = topics.find(key)
            assert topic is not None
            topic.message.model_validate(value)
        picture = next(data for data in page if isinstance(data, bytes))
        assert picture[1 : 1 + picture[0]] == b"camera/image"
        assert m.CameraImage.decode(picture[1 + picture[0] :]).data.startswith(b"\xff\xd8")


def test_a_late_page_gets_the_last_value_of_what_has_ended(star: FakeStar) -> None:
    star.publish(topics.SIMULATION_FAULT, m.SimulationFault(kind="clear"))  # a request: never comes back
    star.do(lambda bus: bus.kill("simulator"))
    with open_page(star) as first:
        next(f for f in frames(first) if "service/helm/heartbeat" in f["values"])
    with open_page(star) as page:
        values = next(f["values"] for f in frames(page) if f["values"])
        assert "service/simulator/heartbeat" in values
        assert "simulation/fault" not in values


def test_a_request_is_published_and_answered(star: FakeStar) -> None:
    with open_page(star) as page, open_page(star) as other:
        say(page, type="mode", request_id="r1", mode="hold", x_m=1.0, y_m=2.0, psi_rad=0.1)
        assert next(f["answers"] for f in frames(page) if f["answers"])[0]["accepted"] is True
        say(other, type="mode", request_id="r2", mode="manual")
        answer = next(f["answers"] for f in frames(other) if f["answers"])[0]
        assert (answer["request_id"], answer["accepted"]) == ("r2", False)
        assert "has the helm" in answer["reason"]


@pytest.mark.parametrize("politely", [True, False])
def test_a_page_that_goes_lets_go_of_stick_and_lease(star: FakeStar, politely: bool) -> None:
    with open_page(star) as page:
        say(page, type="mode", request_id="r1", mode="manual")
        say(page, type="joystick", surge=1.0)
        wait_for(lambda: star.joysticks and star.joysticks[-1].surge == 1.0, "the stick arrives")
        if not politely:
            page.socket.shutdown(socket.SHUT_RDWR)
    wait_for(lambda: star.joysticks[-1].surge == 0.0, "zero stick", timeout_s=0.5)
    wait_for(lambda: star.requests[-1].action == "release", "release", timeout_s=0.5)
    wait_for(lambda: star.helm.wanted.mode == "stop", "manual ends")


def test_a_page_that_falls_silent_lets_go_of_the_stick_at_once_and_of_the_lease_later(star: FakeStar) -> None:
    with open_page(star) as page:
        say(page, type="mode", request_id="r1", mode="manual")
        say(page, type="joystick", yaw=0.4)
        wait_for(lambda: star.joysticks and star.joysticks[-1].yaw == 0.4, "the stick arrives")
        wait_for(lambda: star.joysticks[-1].yaw == 0.0, "zero stick", timeout_s=0.6)
        wait_for(lambda: star.requests[-1].action == "release", "release", timeout_s=4.0)


def test_broken_values_on_the_bus_spoil_nothing(star: FakeStar, caplog: pytest.LogCaptureFixture) -> None:
    def break_things(_bus: MemoryBus) -> None:
        for key, payload in {
            "helm/state": b'{"mode":"fly"}',
            "free/one": b"not json",
            "free/two": b'{"a":NaN}',
            "free/three": b'"\xff"',
            "free/four": b'{"ok":1}',
            "camera/image": b"\xff\xff\xff\xff",
            "helm/answer": b"{}",
        }.items():
            star.page.everything.offer(RawSample(key, payload, 0))

    with open_page(star) as page, caplog.at_level(logging.WARNING):
        star.do(break_things)
        frame = next(f for f in frames(page) if "free/four" in f["values"])
        assert not {"free/one", "free/two", "free/three", "helm/answer"} & frame["values"].keys()
        assert frame["values"]["free/four"] == {"ok": 1}
        assert next(f for f in frames(page) if f["server"]["malformed"])["server"]["malformed"] >= 6
    assert sum("not shown" in r.message for r in caplog.records) == 1


def test_nonsense_is_answered_and_the_page_goes_on(star: FakeStar) -> None:
    with open_page(star) as page:
        page.send("nonsense")
        page.send(b"\x00\xff")
        assert next(f for f in frames(page) if "refused" in f)["refused"]
        assert next(f for f in frames(page) if f["server"]["refused"] == 2)
        say(page, type="mode", request_id="r1", mode="stop")
        assert next(f for f in frames(page) if f["answers"])


def test_a_page_that_does_not_read_holds_up_nobody(star: FakeStar) -> None:
    with open_page(star, max_queue=1), open_page(star) as page:
        times_ns = [next(frames(page))["now_ns"]]
        for frame in frames(page):
            times_ns.append(frame["now_ns"])
            if times_ns[-1] - times_ns[0] > 1_500_000_000:
                break
        assert len(times_ns) > 1.5 * 0.6 * Page.rate_hz


def test_a_foreign_web_site_is_turned_away(star: FakeStar) -> None:
    with pytest.raises(Exception, match="403"):
        open_page(star, origin="http://evil.example")


def test_an_oversized_message_ends_that_page_only(star: FakeStar) -> None:
    with open_page(star) as page, open_page(star) as other:
        page.send("x" * 100_000)
        with pytest.raises(ConnectionClosed):
            for _ in frames(page):
                pass
        assert next(frames(other))


def test_a_port_in_use_is_told_in_one_line_and_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    bus = MemoryBus()
    with socket.create_server(("127.0.0.1", 0)) as taken, caplog.at_level(logging.INFO):
        port = taken.getsockname()[1]
        page = Page(PageConfig(port=port), VESSEL)
        bus.add(page)
        bus.run_for(6.0)
        assert [r.message for r in caplog.records if "cannot listen" in r.message] == [
            f"cannot listen on 127.0.0.1:{port}: Address already in use; trying again every 2 s"
        ]
        heartbeat = bus.last(topics.HEARTBEAT.of("ui"))
        assert heartbeat is not None
        assert heartbeat.note.startswith(f"cannot listen on 127.0.0.1:{port}")
    bus.run_for(3.0)
    assert page.port == port
    bus.stop("ui")


def test_the_documents_tell_pool_vessel_and_units(star: FakeStar) -> None:
    system = httpx.get(star.url + "api/system").json()
    assert system["pool"] == {"length_x_m": 5.0, "length_y_m": 3.75}
    assert [t["name"] for t in system["thrusters"]] == [t.name for t in load_vessel("pladypos").thrusters]
    assert "helm" in system["services"]
    fields = {t["key"]: t["fields"] for t in httpx.get(star.url + "api/topics").json()}
    assert fields["navigation/state"]["yaw_rad_s"]["unit"] == "rad/s"
    assert fields["camera/image"].keys() == {"frame", "width_px", "height_px"}
    assert "stamp_ns" not in fields["helm/state"]


def test_a_tuning_is_tried_out_before_it_is_engaged(star: FakeStar) -> None:
    def tried(**request: Any) -> httpx.Response:
        return httpx.post(star.url + "api/tuning", json=request)

    heavy = {"yaw": {"alpha": 1.05, "beta_quadratic": 0.15}}
    both = {"proposed": {"law": "ipd", "models": heavy}, "present": {"law": "ipd"}, "shaping": {"share": 0.7}}
    yaw = tried(**both).json()["axes"]["yaw"]
    assert yaw["proposed"]["step"]["overshoot_percent"] < 5.0
    assert yaw["present"]["step"]["overshoot_percent"] > 15.0
    assert yaw["proposed"]["gains"]["k_p"] > 1.9 * yaw["present"]["gains"]["k_p"]
    assert tried(**both).json()["axes"]["yaw"] == yaw
    refused = tried(proposed={"law": "ipd", "parameters": {"model_function": "1,1,2"}}).json()
    assert refused == {"refused": "ipd: the model function 1,1,2 is not stable", "axes": {}}
    assert tried(proposed={"law": 1}).status_code == 400
    assert httpx.post(star.url + "api/tuning", content=b"x" * 20_000).status_code == 413
    foreign = httpx.post(star.url + "api/tuning", json=both, headers={"origin": "http://evil.example"})
    assert foreign.status_code == 403


def test_files_are_served_with_their_types_and_nothing_else(star: FakeStar) -> None:
    for path, kind in {"": "text/html", "main.js": "javascript", "style.css": "text/css", "icon.svg": "svg"}.items():
        answer = httpx.get(star.url + path)
        assert answer.status_code == 200
        assert kind in answer.headers["content-type"]
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert httpx.get(star.url + "..%2fserver.py").status_code == 404


@pytest.mark.parametrize("warp", [1.0, 10.0])
def test_pages_are_fed_in_real_time_however_fast_the_stars_runs(warp: float, monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(PageConfig(port=0), load_vessel("pladypos"))
    page.warp = warp
    fed_s: list[float] = []
    page.start(0.0)
    try:
        assert page._web is not None
        monkeypatch.setattr(page._web, "deliver", lambda update, _status: fed_s.append(update.now_ns * 1e-9))
        for step in range(round(10 * warp * page.rate_hz)):
            page.step(1000.0 + step / page.rate_hz)
    finally:
        page.stop(2000.0)
    assert 24.0 < len(fed_s) / 10.0 < 29.0
