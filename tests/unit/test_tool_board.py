"""What `watch`, `hz`, `play` and `graph` work out, without a bus or a terminal."""

import io
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rich.console import Console

from bus.clock import NS
from bus.messages import CameraImage, SimulationFault
from bus.service import RawSample
from logs.writer import LogWriter
from services.catalog import PROCESSES
from services.cli.board import Board, board_table, scope_table, text_line
from services.cli.hz import Arrivals
from services.cli.options import key_of_vessel
from services.cli.play import Player, _between, _open, _play, wire_bytes
from services.star import HUBS, Node, declared_star, layout, live_star, mermaid, svg

START_NS = 1_700_000_000 * NS


def sample(key: str, at_s: float = 0.0, **fields: Any) -> RawSample:
    values = {"stamp_ns": START_NS, "seq": 0, "source": "me", "origin_ns": None} | fields
    return RawSample(key, json.dumps(values).encode(), START_NS + round(at_s * NS))


def typed(board: Board, *keys: str) -> None:
    for key in keys:
        board.press(key, START_NS)


def picture(table: Any, width: int = 100) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined,no-any-return]


@pytest.fixture
def board() -> Board:
    board = Board()
    board.take(sample("a/pose", i / 10, x_m=float(i), source="tracker", seq=i) for i in range(11))
    board.take([sample("b/state", 0.5, mode="hold", commands={"left": 1.0, "right": 2.0}, source="helm")])
    return board


def test_a_row_for_each_field_with_unit_source_age_and_rate(board: Board) -> None:
    rows = board.rows(START_NS + 2 * NS)
    assert [(r.key, r.field, r.value, r.unit) for r in rows] == [
        ("a/pose", "x_m", "10", "m"),
        ("b/state", "mode", "hold", ""),
        ("b/state", "commands.left", "1", ""),
        ("b/state", "commands.right", "2", ""),
    ]
    assert (rows[0].source, rows[0].age, rows[0].rate) == ("tracker", "1.00", "1.0"), "overdue: the rate falls"
    assert board.rows(START_NS + 1 * NS)[0].rate == "10.0"


def test_filter_sort_and_freeze(board: Board) -> None:
    typed(board, "/", "M", "O", "D", "X", "backspace", "e", "enter")
    assert [r.field for r in board.rows(START_NS)] == ["mode"]
    typed(board, "esc", "s", "s")
    assert board.sort == "rate"
    assert [v.key for v in board.shown(START_NS + NS)] == ["a/pose", "b/state"]
    typed(board, "s")
    assert [v.key for v in board.shown(START_NS + NS)] == ["b/state", "a/pose"], "helm before tracker"
    typed(board, "f")
    board.take([sample("b/state", 3.0, mode="stop", source="helm")])
    assert "hold" in picture(board_table(board, START_NS + 3 * NS, 20))
    assert "FROZEN" in picture(board_table(board, START_NS + 3 * NS, 20))
    typed(board, "f")
    board.take([])
    assert "stop" in picture(board_table(board, START_NS + 3 * NS, 20))


def test_a_chosen_message_is_shown_with_its_history_and_changes(board: Board) -> None:
    typed(board, "down", "down", "up", "enter")
    assert board.scope == "a/pose"
    lines = picture(scope_table(board, 100)).splitlines()
    (x,) = [line.split() for line in lines if line.strip().startswith("x_m")]
    assert x == ["x_m", "m", "10", "9", "8", "7"]
    typed(board, "esc")
    assert board.scope == ""
    typed(board, "q")
    assert board.ended


def test_last_values_of_the_hub_come_first_and_never_replace_what_was_heard() -> None:
    board = Board()
    board.take([sample("a", x_m=2.0)])
    board.know("a", sample("a", x_m=1.0).payload, START_NS, 5.0)
    board.know("b", sample("b", x_m=1.0).payload, START_NS, 5.0)
    assert [(r.key, r.value, r.rate) for r in board.rows(START_NS)] == [("a", "2", "0.0"), ("b", "1", "5.0")]


def test_anything_on_the_bus_can_be_shown() -> None:
    board = Board()
    image = CameraImage(frame=3, width_px=8, height_px=6, data=b"\xff\xd8jpeg").encode()
    odd = [b"\x00\xffnonsense", b"[1, 2]", b"7", b"", image, b'{"[bold]": "[/]"}']
    board.take(RawSample(f"k{i}", payload, START_NS) for i, payload in enumerate(odd))
    text = picture(board_table(board, START_NS, 40))
    assert "payload_bytes" in text
    assert "jpeg_bytes" in text
    for i in range(len(odd)):
        board.scope = f"k{i}"
        assert f"k{i}" in picture(scope_table(board, 100))
        assert f"k{i}" in text_line(RawSample(f"k{i}", odd[i], START_NS))


def test_a_line_of_text_has_units_and_no_null() -> None:
    line = text_line(sample("a/pose", x_m=1.25, z_m=None, source="tracker"))
    assert line.endswith("a/pose [tracker] x_m=1.25 m")


def test_rate_jitter_and_gaps_of_arrivals() -> None:
    arrivals = Arrivals()
    for seq, at_s in [(0, 0.0), (1, 0.1), (2, 0.2), (5, 0.4), (4, 0.5)]:
        arrivals.add(sample("camera/pose", at_s, seq=seq))
    found = arrivals.summary("camera/pose", 2.0)
    assert found["messages"] == 5
    assert found["rate_hz"] == pytest.approx(8.0)
    assert found["declared_hz"] == 30.0
    assert (found["interval_min_ms"], found["interval_max_ms"]) == (100.0, 200.0)
    assert found["jitter_ms"] == pytest.approx(43.301)
    assert (found["gaps"], found["out_of_order"]) == (2, 1)
    assert found["bytes_s"] == round(5 * len(sample("a", seq=1).payload) / 2)
    assert Arrivals().summary("x", 1.0)["rate_hz"] is None


def test_two_publishers_of_one_key_and_a_restart_are_no_gaps() -> None:
    arrivals = Arrivals()
    for source, seq in [("a", 7), ("b", 100), ("a", 8), ("b", 101), ("a", 0), ("a", 1)]:
        arrivals.add(sample("k", seq=seq, source=source))
    assert (arrivals.gaps, arrivals.out_of_order) == (0, 0)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    writer = LogWriter(tmp_path / "log.mcap", "pladypos", {"vessel": "pladypos"}, {}, 0)
    image = CameraImage(stamp_ns=5, seq=1, source="t", frame=3, width_px=8, height_px=6, data=b"\xff\xd8jpeg")
    fault = SimulationFault(stamp_ns=6, seq=2, source="poke", kind="clear")
    payloads = {
        "camera/image": image.encode(),
        "simulation/fault": fault.encode(),
        "mine/json": b'{"a":1}',
        "raw": b"\x00\xff",
    }
    for second, (key, payload) in itertools.product(range(4), payloads.items()):
        writer.write(RawSample(key, payload, START_NS + second * NS))
    writer.finish()
    return tmp_path / "log.mcap"


def test_a_log_is_played_byte_by_byte(log: Path) -> None:
    recording, keys = _open(log, ["**"])
    sent: list[tuple[str, bytes]] = []
    player = Player(0.0, recording.start_ns, lambda key, payload: sent.append((key, payload)))
    _play(player, _between(recording, keys, 0.0, None), lambda at_ns, paused: None)
    assert len(sent) == player.played == 16
    first = dict(sent[:4])
    assert CameraImage.decode(first["camera/image"]).data == b"\xff\xd8jpeg"
    assert SimulationFault.decode(first["simulation/fault"]).source == "poke"
    assert json.loads(first["mine/json"]) == {"a": 1}
    assert first["raw"] == b"\x00\xff"


def test_a_part_of_a_log_is_played_in_its_time(log: Path) -> None:
    recording, keys = _open(log, ["camera/*", "mine/**"])
    assert sorted(keys) == ["camera/image", "mine/json"]
    entries = list(_between(recording, keys, 1.0, 2.0))
    assert [(e.key, e.log_ns - START_NS) for e in entries] == [
        (key, s * NS) for s in (1, 2) for key in ("camera/image", "mine/json")
    ]
    player = Player(4.0, START_NS + NS, lambda key, payload: None)
    assert player.due_in_s(entries[0]) == 0.0
    assert player.due_in_s(entries[2]) == pytest.approx(0.25)
    player.passed(0.1)
    assert player.due_in_s(entries[2]) == pytest.approx(0.15)


def test_text_on_the_wire_is_json() -> None:
    assert wire_bytes("word") == b'"word"'


def cards_apart(nodes: list[Node]) -> Iterator[tuple[Any, Any]]:
    cards, hub, (width, height) = layout(nodes)
    assert len(cards) == len(nodes)
    for card in cards:
        assert 0 <= card.x <= width - 230
        assert 0 <= card.y <= height - card.height
        assert not (card.x - 64 < hub[0] < card.x + 230 + 64 and card.y - 64 < hub[1] < card.y + card.height + 64)
    yield from itertools.combinations(cards, 2)


@pytest.mark.parametrize("count", range(1, 24))
def test_cards_of_any_number_of_clients_do_not_overlap(count: int) -> None:
    nodes = [Node(f"n{i}", tuple(f"k{j}" for j in range(i % 7)), None if i % 3 else ()) for i in range(count)]
    for a, b in cards_apart(nodes):
        beside = a.x + 230 <= b.x or b.x + 230 <= a.x
        assert beside or a.y + a.height <= b.y or b.y + b.height <= a.y


def test_the_picture_names_every_client_and_key() -> None:
    nodes = declared_star()
    assert {n.name for n in nodes} == {"operator"} | {p.name for p in PROCESSES} - set(HUBS)
    root = ElementTree.fromstring(svg(nodes, "a < b & c"))
    texts = ["".join(e.itertext()) for e in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "a < b & c" in texts
    for node in nodes:
        assert node.name in texts
        for key in node.publishes:
            assert f"↑ {key}" in texts


def test_what_is_connected_is_told_from_what_is_declared() -> None:
    declared = [
        Node("operator"),
        Node("helm", ("helm/state",), ("a",)),
        Node("ui", (), None),
        Node("estimator", ("n",)),
    ]
    sources = {
        "helm/state": {"helm"},
        "service/helm/heartbeat": {"helm"},
        "my/key": {"guest"},
        "hub/statistics": {"hub"},
    }
    nodes = {n.name: n for n in live_star(declared, {"helm", "ui"}, sources)}
    assert {name: node.state for name, node in nodes.items()} == {
        "helm": "running",
        "ui": "running",
        "estimator": "missing",
        "guest": "foreign",
    }
    assert nodes["helm"].publishes == ("helm/state",)
    assert nodes["guest"].publishes == ("my/key",)
    text = mermaid(list(nodes.values()))
    assert "estimator (not connected)" in text
    assert 'guest -- "my/key" --> hub' in text


@pytest.mark.parametrize(
    ("text", "vessel", "expected"),
    [
        ("navigation/state", None, ("navigation/state", None)),
        ("replay/pladypos/navigation/state", None, ("navigation/state", "replay/pladypos")),
        ("replay/pladypos/**", None, ("**", "replay/pladypos")),
        ("replay/pladypos", None, ("replay/pladypos", None)),
        ("replay/x/y", "pladypos", ("replay/x/y", "pladypos")),
    ],
)
def test_the_full_key_of_a_played_log_names_its_vessel(
    text: str, vessel: str | None, expected: tuple[str, str | None]
) -> None:
    assert key_of_vessel(text, vessel) == expected
