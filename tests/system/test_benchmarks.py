"""The benchmark of the chain measures what it says: extra work shows, and without an allocator there is no value."""

import json
import subprocess
import sys

import pytest

from benchmarks.chain import LISTENING, MINIMUM, measure
from benchmarks.result import NotMeasured
from benchmarks.running_star import ROOT
from services.cli.bench import BENCHMARKS
from tests.system.slow_estimator import EXTRA_S

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

SLOW = LISTENING.replace("services = {", 'services = { estimator = "tests.system.slow_estimator:SlowEstimator",')
WITHOUT_ALLOCATOR = LISTENING.replace(
    "services = {", 'services = { allocator = "tests.system.slow_estimator:SlowEstimator",'
)


def figures(system: str) -> dict[str, float]:
    return {r.metric: r.value for r in measure(seconds=8.0, system=system)}


def test_the_chain_is_fast_and_20_ms_of_extra_work_show_as_20_ms() -> None:
    extra_ms = []
    for _ in range(3):  # another program on the two cores during one of the two runs spoils the difference
        plain, slow = figures(LISTENING), figures(SLOW)
        assert plain["commands_followed"] > MINIMUM
        assert plain["capture_to_command_p50_ms"] < 25.0, "the goal of 8 ms is the benchmark's"
        extra_ms.append(slow["capture_to_command_p50_ms"] - plain["capture_to_command_p50_ms"])
        if abs(extra_ms[-1] - 1e3 * EXTRA_S) <= 3.0:
            return
    pytest.fail(f"20 ms of extra work showed as {extra_ms} ms")


def test_without_an_allocator_there_is_no_value() -> None:
    with pytest.raises(NotMeasured):
        measure(seconds=4.0, system=WITHOUT_ALLOCATOR)


def test_a_benchmark_prints_one_json_document_with_peers() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "services.cli.main", "bench", "wake", "--json"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    document = json.loads(done.stdout)
    assert document["bench"] == "wake"
    assert document["machine"]["cores"] >= 1
    for result in document["results"]:
        assert result["value"] > 0
        assert all(value > 0 for value in result["peers"].values())


def test_an_unknown_benchmark_is_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "services.cli.main", "bench", "speed"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert all(name in done.stderr for name in BENCHMARKS)
