"""Half a minute of nonsense on every key of a whole star: nobody dies, all is counted. `make fuzz` runs it."""

import contextlib
import json
import random
import time
from typing import Any

import pytest

from benchmarks.running_star import RunningStar, wait_for
from bus import topics
from bus.topics import HEARTBEAT, HUB_STATISTICS, NAVIGATION_STATE
from bus.zenoh_bus import ZenohBus

pytestmark = [pytest.mark.system, pytest.mark.soak, pytest.mark.timeout(300)]

SECONDS = 30.0
OBEYED = {"operator/request", "operator/tuning", "operator/actuator", "operator/calibration", "simulation/fault"}
"""A message that happens to be good would be carried out: only bytes that are none."""
KEYS = [t.key.replace("{name}", "helm") for t in topics.all_topics()]
KEYS += [
    "noise/a",
    "a/b/c/d",
    "control/**",
    "*/state",
    "@hub/time",
    "@hub/store",
    "@hub/clients",
    "service/nobody/heartbeat",
    "x" * 300,
]
ABSURD: dict[str, list[Any]] = {
    "stamp_ns": [-5, 10**30, 2**63 - 1, 2**64, 0, 1.5, "x", None, True],
    "seq": [-1, 10**40, 2**63, "a", 1e300],
    "source": ["x" * 10_000, "", 5, None, "hub", "a\nb\x00"],
}


def nonsense(good: bytes, chance: random.Random) -> bytes:
    """Return a message in which something is wrong, or no message at all."""
    kind = chance.randrange(6)
    if kind == 0:
        return chance.randbytes(chance.choice((0, 1, 10, 1000, 50_000)))
    if kind == 1:
        return good[: chance.randrange(len(good) + 1)]
    if kind == 2:
        return b"[" * chance.randrange(1, 200_000)
    try:
        fields = json.loads(good)
    except ValueError:
        return b"{}"
    if kind == 3:
        return json.dumps(fields).replace("0", "NaN").encode()
    name = chance.choice(list(ABSURD if kind == 4 else fields))
    fields[name] = chance.choice(ABSURD.get(name, [None, "x", [], {}, 1e308, [[[]]]]))
    return json.dumps(fields).encode()


def test_a_star_outlives_nonsense_on_every_key() -> None:
    chance = random.Random(1)
    with RunningStar() as star:
        star.hold(2.0, 1.5, 0.2, timeout_s=60.0)
        good: dict[str, bytes] = {}
        star.bus.subscribe("**", lambda sample: good.update({sample.key: sample.payload}))
        wait_for(lambda: {"camera/image", "helm/wrench", "service/helm/heartbeat"} <= good.keys(), 10.0, "examples")
        examples = dict(good)
        fuzzer = ZenohBus.connect(star.vessel, (star.hub, star.standby), 5.0)
        with contextlib.closing(fuzzer):
            end_s = time.monotonic() + SECONDS
            while time.monotonic() < end_s:
                key = chance.choice(KEYS)
                example = examples.get(key) or chance.choice(list(examples.values()))
                fuzzer.put(key, chance.randbytes(30) if key in OBEYED else nonsense(example, chance))
                fuzzer.session.put(f"{star.vessel}/{key}", b"{}", attachment=chance.randbytes(9))
                time.sleep(0.001)

        def counted() -> bool:
            statistics = star.last(HUB_STATISTICS)
            beat = star.last(HEARTBEAT.of("helm"))
            return bool(statistics and statistics.refused > 100 and beat and beat.malformed > 100)

        wait_for(counted, 20.0, "the star counts what was refused")
        star.wait(NAVIGATION_STATE, lambda s: s.status == "tracking", 20.0, "poses")
        logs = {path.stem: path.read_text(errors="replace") for path in (star.run_dir / "log").glob("*.log")}
        crashed = {name: text[text.index("Traceback") :][:3000] for name, text in logs.items() if "Traceback" in text}
        assert not crashed  # a loop that a busy machine did not let run for 2 s is no crash
        star.hold(2.0, 1.5, 0.2)
        for tool in ("status", "get **", "hz --seconds 1", "graph --live", "watch --count 50"):
            done = star.cli(*tool.split())
            assert (done.returncode, done.stderr) == (0, ""), tool
        (log,) = star.recordings.glob("*.mcap")
        assert star.cli("log", "info", str(log)).returncode == 0
