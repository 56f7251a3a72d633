"""The page on the whole star as real processes: what an operator does ends at the firmware and at the true place."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from benchmarks.running_star import RunningStar, wait_for
from bus import topics
from bus.messages import SimulationTruth
from services.vessels import load_vessel
from tests.browser.test_page import DESK, open_page, press_at, push_stick, take_stick

pytestmark = [pytest.mark.browser, pytest.mark.system, pytest.mark.timeout(180)]


@pytest.fixture(scope="module")
def star() -> Iterator[RunningStar]:
    with RunningStar("[simulator]\ncurrent_x_m_s = 0.03\ncurrent_y_m_s = -0.02\n") as star:
        star.wait(topics.NAVIGATION_STATE, lambda s: s.status == "tracking", 30.0, "a pose")
        yield star


@pytest.fixture
def page(star: RunningStar, browser: Browser) -> Iterator[Page]:
    with browser.new_context(viewport=DESK) as context:
        yield open_page(context.new_page(), star.page)


def truth(star: RunningStar) -> SimulationTruth:
    message = star.last(topics.SIMULATION_TRUTH)
    assert message is not None
    return message


def at_rest(star: RunningStar) -> bool:
    return not any(truth(star).commands.values())


def test_the_stick_moves_the_true_vessel_and_closing_the_tab_stops_it(page: Page, star: RunningStar) -> None:
    take_stick(page)
    begin = truth(star)
    push_stick(page, "#stick", 0.0, -60.0)
    wait_for(lambda: math.hypot(truth(star).x_m - begin.x_m, truth(star).y_m - begin.y_m) > 0.1, 10.0, "0.1 m ahead")
    assert not at_rest(star)
    page.close()  # in the middle of the drag
    wait_for(lambda: at_rest(star), 1.0, "zero commands at the firmware")
    star.wait(topics.HELM_STATE, lambda s: s.mode == "stop", 1.0, "manual has ended")


def test_a_click_on_the_map_and_hold_ends_at_that_true_place_and_stop_stops(page: Page, star: RunningStar) -> None:
    press_at(page, 3.2, 1.4, drag=(40.0, 40.0))
    page.click("#hold")

    def arrived() -> bool:
        now = truth(star)
        near = math.hypot(now.x_m - 3.2, now.y_m - 1.4) < 0.02 and abs(now.psi_rad - math.pi / 4) < 0.05
        return near and math.hypot(now.surge_m_s, now.sway_m_s) < 0.02

    wait_for(arrived, 60.0, "the true vessel is at the place that was clicked")
    page.click("#stop")
    wait_for(lambda: at_rest(star), 1.0, "zero commands at the firmware")


def test_way_points_on_the_map_are_followed_by_the_true_vessel(page: Page, star: RunningStar) -> None:
    page.click("#route-edit")
    press_at(page, 2.2, 1.2)
    press_at(page, 3.0, 1.2)
    page.fill("#route-speed", "0.2")
    page.click("#route-follow")
    star.wait(topics.HELM_STATE, lambda s: s.mode == "line" and len(s.points) == 2, 5.0, "the helm follows the line")
    star.wait(topics.CONTROL_STATUS, lambda s: (s.along_m or 0.0) > 0.2, 60.0, "the reference is on the line")
    star.wait(topics.HELM_STATE, lambda s: s.mode == "hold", 60.0, "at the end it holds")
    wait_for(lambda: math.hypot(truth(star).x_m - 3.0, truth(star).y_m - 1.2) < 0.05, 20.0, "the true vessel is there")
    page.click("#stop")


def test_an_experiment_is_run_from_the_page_to_its_result(page: Page, star: RunningStar) -> None:
    page.click("[data-tab=experiment]")
    page.fill("#experiment [name=amplitude]", "70")
    page.fill("#experiment [name=hysteresis]", "15")
    page.fill("#experiment [name=oscillations]", "2")
    page.click("#experiment-start")
    star.wait(topics.EXPERIMENT_STATUS, lambda s: s.state == "running" and s.axis == "yaw", 5.0, "it runs")
    page.wait_for_selector("#experiment-estimate polyline", timeout=60_000)  # recursive least squares, while it runs
    page.wait_for_selector("#experiment-result table", timeout=60_000)
    shown = page.inner_text("#experiment-result")
    assert "projection on the first harmonic" in shown
    assert "Vessel file: " in shown
    result = star.last(topics.EXPERIMENT_RESULT)
    assert result is not None
    found = {p.name: p.value for p in result.methods[0].parameters}
    yaw = load_vessel("pladypos").model.yaw
    assert abs(found["alpha"] / yaw.alpha - 1.0) < 0.05
    star.wait(topics.HELM_STATE, lambda s: s.mode == "hold", 1.0, "the controller has all axes again")
    page.click("#stop")
