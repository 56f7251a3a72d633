"""Scripts of timed pokes: what is refused before the first poke, and what is sent when."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.config import ConfigError
from bus.messages import OperatorRequest
from services.cli.script_file import Poke, ScriptRun, read_script

HOLD = 'fields = { request_id = "$id", client = "s", mode = "hold", x_m = "$x_m" }'
DRAWN = f"""
[script]
seed = 7
rounds = 3
between_s = 1.0
[draw]
x_m = {{ low = 0.5, high = 4.5 }}
kind = {{ choices = ["camera_black", "clear"] }}
[[poke]]
key = "operator/request"
{HOLD}
[[poke]]
at_s = [2.0, 4.0]
key = "simulation/fault"
fields = {{ kind = "$kind" }}
times = 2
every_s = 0.5
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "script.toml"
    path.write_text(text)
    return path


def run_through(run: ScriptRun, values: dict[str, Any] | None = None, tick_s: float = 0.013) -> list[Poke]:
    sent = []
    for _ in range(10_000):
        sent += run.advance(tick_s, values or {})
        if run.ended:
            return sent
    raise AssertionError(f"not ended: {run.state}")


def test_pokes_come_in_order_at_their_times_with_what_was_drawn(tmp_path: Path) -> None:
    script = read_script(written(tmp_path, DRAWN))
    sent = run_through(ScriptRun(script))
    assert [p.key for p in sent] == ["operator/request", "simulation/fault", "simulation/fault"] * 3
    requests, faults = sent[::3], sent[1::3]
    assert len({p.fields["x_m"] for p in requests}) == 3
    assert all(0.5 <= p.fields["x_m"] <= 4.5 for p in requests)
    assert len({OperatorRequest.model_validate(p.fields).request_id for p in requests}) == 3
    assert all(2.0 <= f.at_s - r.at_s <= 4.0 for r, f in zip(requests, faults, strict=True))
    assert all(b.at_s - a.at_s == pytest.approx(0.5) for a, b in zip(faults, sent[2::3], strict=True))
    assert requests[1].at_s - sent[2].at_s == pytest.approx(1.0)
    assert [p.round for p in requests] == [1, 2, 3]


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.7))
@settings(max_examples=30)
def test_the_same_seed_sends_the_same_whatever_the_ticks(tmp_path_factory: Any, seed: int, tick_s: float) -> None:
    path = tmp_path_factory.getbasetemp() / "drawn.toml"
    if not path.exists():
        path.write_text(DRAWN)
    script = read_script(path)
    assert run_through(ScriptRun(script, seed), tick_s=tick_s) == run_through(
        ScriptRun(script, seed, dry=True), tick_s=1.0
    )


def test_a_file_without_a_seed_draws_something_else_each_time(tmp_path: Path) -> None:
    script = read_script(written(tmp_path, DRAWN.replace("seed = 7", "")))
    assert run_through(ScriptRun(script)) != run_through(ScriptRun(script))


WAITING = """
[script]
start_when = ["navigation/state.status == tracking"]
pause_unless = ["helm/state.suspended == false"]
[[poke]]
at_s = 1.0
key = "simulation/fault"
fields = { kind = "clear" }
when = ["navigation/state.x_m > 2", "link/telemetry.commands.front_port != 0"]
within_s = 5.0
[[poke]]
at_s = 1.5
key = "simulation/fault"
fields = { kind = "camera_black" }
"""


def test_conditions_hold_the_scripts_clock(tmp_path: Path) -> None:
    run = ScriptRun(read_script(written(tmp_path, WAITING)))
    values: dict[str, Any] = {}
    assert run.advance(10.0, values) == []
    assert run.state == "paused", "nothing was heard of the helm"
    values["helm/state"] = {"suspended": False}
    assert run.advance(10.0, values) == []
    values["navigation/state"] = {"status": "tracking", "x_m": 1.0}
    assert run.advance(10.0, values) == [], "the time before the start does not count"
    assert run.advance(1.5, values) == []
    assert run.state == "waiting"
    values["helm/state"] = {"suspended": True}
    run.advance(100.0, values)
    assert run.state == "paused"
    values |= {"helm/state": {"suspended": False}, "link/telemetry": {"commands": {"front_port": 3.0}}}
    values["navigation/state"]["x_m"] = 2.5
    (first,) = run.advance(0.1, values)
    assert (first.at_s, first.fields) == (1.0, {"kind": "clear"})
    run.paused = True
    assert run.advance(10.0, values) == []
    run.paused = False
    (second,) = run.advance(0.5, values)
    assert second.at_s == 1.5
    assert run.state == "done"


def test_a_condition_that_does_not_come_true_in_time_is_a_failure(tmp_path: Path) -> None:
    run = ScriptRun(read_script(written(tmp_path, WAITING)))
    values = {"helm/state": {"suspended": False}, "navigation/state": {"status": "tracking", "x_m": 1.0}}
    assert run_through(run, values) == []
    assert run.state == "failed"
    assert "navigation/state.x_m > 2" in run.failure
    assert "not within 5 s" in run.failure


FAULT = '[[poke]]\nkey = "simulation/fault"\n'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "poke: Field required"),
        ("[[poke]]\n", "poke.0.key: Field required"),
        ('[[poke]]\nkey = "no/such"\n', "poke.0: no/such: no such variable"),
        ('[[poke]]\nkey = "helm/state"\n', "poke.0: helm/state belongs to helm"),
        (FAULT, "poke.0: simulation/fault: kind: Field required"),
        (FAULT + 'fields = { kind = "clear", x = 1 }\n', "no such field: x"),
        (FAULT + 'fields = { kind = "$nothing" }\n', "$nothing is not drawn"),
        (
            FAULT + 'fields = { kind = "$k" }\n[draw]\nk = { choices = ["clear", "bad"] }\n',
            "poke.0: simulation/fault: kind",
        ),
        (FAULT + 'fields = { kind = "clear", fraction = "$f" }\n[draw]\nf = { low = 0, high = 1.1 }\n', "fraction"),
        (FAULT + 'fields = { kind = "clear" }\n[draw]\nf = { low = 2, high = 1 }\n', "draw.f: needs"),
        (FAULT + 'fields = { kind = "clear" }\n[draw]\nid = { low = 1, high = 2 }\n', "draw.id: this name is given"),
        (FAULT + 'fields = { kind = "clear" }\nat_s = [3, 2]\n', "poke.0.at_s"),
        (FAULT + 'fields = { kind = "clear" }\nwhen = ["helm/state.mood == good"]\n', "has no field mood"),
        (FAULT + 'fields = { kind = "clear" }\nwhen = ["helm/mood.x == 1"]\n', "helm/mood: no such variable"),
        (FAULT + 'fields = { kind = "clear" }\nwhen = ["hold"]\n', "write KEY.FIELD"),
        (FAULT + 'fields = { kind = "clear" }\nwait_s = 1\n', "poke.0.wait_s: no such key"),
        ("[script]\nrounds = 0\n" + FAULT + 'fields = { kind = "clear" }\n', "rounds without end"),
    ],
)
def test_a_script_is_refused_as_a_whole_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as refusal:
        read_script(path)
    assert reason in str(refusal.value)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_force_lets_a_script_write_what_belongs_to_a_service(tmp_path: Path) -> None:
    path = written(tmp_path, '[[poke]]\nkey = "control/wrench"\nfields = { surge_n = 0.1 }\n')
    assert [p.key for p in run_through(ScriptRun(read_script(path, force=True)))] == ["control/wrench"]


def test_rounds_without_end_go_on(tmp_path: Path) -> None:
    endless = DRAWN.replace("rounds = 3", "rounds = 0")
    run = ScriptRun(read_script(written(tmp_path, endless)))
    for _ in range(1000):
        run.advance(0.1, {})
    assert 15 < run.round < 30
    assert not run.ended


def test_the_examples_are_right() -> None:
    examples = sorted((Path(__file__).parents[2] / "docs" / "examples").glob("*.toml"))
    assert examples
    for path in examples:
        assert run_through(ScriptRun(read_script(path), dry=True), tick_s=1.0)
