"""What `starboard bench NAME --markdown` prints."""

from __future__ import annotations

from benchmarks.result import Result, table


def test_each_peer_has_a_column_and_what_was_not_measured_is_empty() -> None:
    results = [
        Result("found_ms", 0.41234, {"opencv": 18.0}, goal=0.5),
        Result("good_fraction", 1.0, {"pupil": 0.5, "opencv": 0.25}),
    ]
    assert table(results).splitlines() == [
        "|  | goal | ours | opencv | pupil |",
        "| --- | --- | --- | --- | --- |",
        "| `found_ms` | 0.5 | 0.412 | 18 |  |",
        "| `good_fraction` |  | 1 | 0.25 | 0.5 |",
    ]
