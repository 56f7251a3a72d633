"""The yaw model on a real ship: better than no model, worse than on its own run."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import ship
from benchmarks.result import NotMeasured, Result


@pytest.fixture
def results() -> dict[str, Result]:
    try:
        return {r.metric: r for r in ship.measure()}
    except NotMeasured as reason:
        pytest.skip(str(reason))


def test_one_zigzag_s_model_predicts_the_others(results: dict[str, Result]) -> None:
    median = results["ship_yaw_rate_prediction_error_p50_percent"]
    own = results["ship_yaw_rate_own_run_error_p50_percent"].value
    assert 0.0 < own < median.value < 50.0  # measured: 31 and 46
    assert median.value < median.peers["rudder_alone"]
    assert results["ship_yaw_rate_prediction_error_worst_percent"].value < 75.0


def test_the_plot_shows_every_run(results: dict[str, Result], tmp_path: Path) -> None:
    ship.draw(tmp_path / "ship.svg")
    assert (tmp_path / "ship.svg").read_text().count("yaw rate, deg/s") == 5


def test_without_data_there_is_no_figure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ship, "DATA", tmp_path)
    with pytest.raises(NotMeasured):
        ship.measure()
