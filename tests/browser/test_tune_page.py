"""The panel Tune in Chromium, on the whole star in one process and many times faster than real time."""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from bus import topics
from bus.config import Deployment
from services.experiment import ExperimentConfig, Experiments
from services.helm import Helm
from services.vessels import VESSELS_DIR, load_vessel
from tests.browser.cut_texts import cut_texts_at_all_sizes
from tests.browser.test_page import DESK, open_page
from tests.star import Star
from tests.system.heavy_simulator import heavier
from ui.server import Page as PageService
from ui.server import PageConfig

pytestmark = [pytest.mark.browser, pytest.mark.timeout(300)]

TIMES = 20.0
"""How much faster than real time the star runs."""


class HurriedStar:
    """PlaDyPos twice as heavy as its file says, or another vessel, with the page, in a thread of its own."""

    def __init__(self, folder: Path, vessel: str = "pladypos") -> None:
        model = heavier(load_vessel("pladypos").model)
        unknown = {"model": model, "dynamics": model} if vessel == "pladypos" else {}
        still = {"current_x_m_s": 0.03, "current_y_m_s": 0.0, "current_std_m_s": 0.0}
        unsure = {"fault_detection": False}  # to a detector with such a model, thrusters look failed
        self.star = Star(vessel=vessel, simulator=still, estimator=unsure, unknown=unknown)
        deployment = Deployment(
            run_dir=Path("/nonexistent"), recordings_dir=folder, vessel_path=VESSELS_DIR / "pladypos.toml"
        )
        self.page = PageService(PageConfig(port=0), self.star.vessel)
        for service in (Experiments(ExperimentConfig(delay_s=1.0 / 60.0), self.star.vessel, deployment), self.page):
            self.star.bus.add(service)
        self._jobs: list[Callable[[Star], None]] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="star")

    @contextlib.contextmanager
    def running(self) -> Iterator[HurriedStar]:
        """Let time pass."""
        self.star.bus.run_for(1.0)
        self._thread.start()
        try:
            yield self
        finally:
            self._end.set()
            self._thread.join(10.0)

    def _run(self) -> None:
        bus = self.star.bus
        while not self._end.wait(0.005):
            while self._jobs:
                self._jobs.pop(0)(self.star)
            begin_s = time.monotonic()
            bus.run_for(TIMES * 0.02)
            time.sleep(max(0.0, 0.02 - (time.monotonic() - begin_s)))
        bus.stop("ui")

    def ask(self, question: Callable[[Star], Any]) -> Any:
        """Return what a question about the star gives, asked in its own thread."""
        answers: list[Any] = []
        self._jobs.append(lambda star: answers.append(question(star)))
        while not answers:
            time.sleep(0.005)
        return answers[0]

    def wait(self, condition: Callable[[Star], object], what: str, timeout_s: float = 60.0) -> None:
        """Wait until a condition holds in the star."""
        end_s = time.monotonic() + timeout_s
        while not self.ask(condition):
            assert time.monotonic() < end_s, f"not within {timeout_s} s: {what}"
            time.sleep(0.05)


@pytest.fixture
def star(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HurriedStar]:
    monkeypatch.setattr(Helm, "warp", TIMES)  # a page's lease is in real time
    with HurriedStar(tmp_path, getattr(request, "param", "pladypos")).running() as star:
        yield star


@pytest.fixture
def page(star: HurriedStar, browser: Browser) -> Iterator[Page]:
    with browser.new_context(viewport=DESK) as context:
        page = open_page(context.new_page(), f"http://127.0.0.1:{star.page.port}/")
        page.click("[data-tab=tune]")
        expect(page.locator("#tune-table table")).to_be_visible(timeout=10_000)
        yield page


def turned(star: HurriedStar) -> float:
    """Return how far a turn by 90 degrees at the place of now overshoots, in rad, as the helm is asked by hand."""
    begin = star.ask(lambda s: (s.bus.now_s, s.truth[-1]))
    psi = math.remainder(begin[1].psi_rad + math.pi / 2.0, math.tau)
    star.ask(lambda s: s.request("hold", x_m=begin[1].x_m, y_m=begin[1].y_m, psi_rad=psi, take=True))
    star.wait(lambda s: s.bus.now_s > begin[0] + 15.0, "15 s")
    after = star.ask(lambda s: [t.psi_rad for t in s.truth if t.stamp_ns * 1e-9 > begin[0]])
    return max(math.remainder(there - psi, math.tau) for there in after)


@pytest.mark.parametrize(
    ("button", "last"), [("yaw", "yaw"), pytest.param("all", "sway", marks=pytest.mark.soak)], ids=["yaw", "all"]
)
def test_an_unknown_vessel_is_tuned_and_held_by_three_clicks(
    page: Page, star: HurriedStar, button: str, last: str
) -> None:
    star.ask(lambda s: s.request("hold", x_m=2.5, y_m=1.875, psi_rad=0.0))
    star.wait(lambda s: s.bus.now_s > 1010.0, "at rest")
    assert turned(star) > 0.05 * math.pi / 2.0, "without tuning it misses the goal"
    star.ask(lambda s: s.request("stop"))

    hint = page.locator("#tune-hint")
    expect(hint).to_contain_text("three clicks")
    page.click(f"#tune-{button}")
    expect(hint).to_contain_text("STOP ends it")
    expect(page.locator("#tune-status")).to_contain_text(f"self-oscillation {last}: done", timeout=200_000)
    row = page.locator("#tune-table tr", has_text="new reference: overshoots").locator("td").last
    expect(row).to_have_text(re.compile(r"\d\d\.\d → [0-4]\.\d"), timeout=10_000)
    expect(hint).to_contain_text("yaw: inertia 1.0")
    page.click("#tune-engage")
    expect(page.locator("#tune-present")).to_contain_text("engaged by page-")
    expect(hint).to_contain_text("In force. Hold keeps a place with it")
    lines = page.locator("#tune-keep pre")
    expect(lines).to_contain_text(re.compile(r"\[system\]\s+vessel = .*engaged"))
    kept = tomllib.loads(lines.text_content() or "")
    assert load_vessel(kept["system"]["vessel"]).model.yaw.alpha == pytest.approx(1.05, rel=0.02)
    page.click("#hold")
    star.wait(lambda s: (h := s.bus.last(topics.HELM_STATE)) and h.mode == "hold", "holding")
    star.ask(lambda s: s.request("stop"))
    assert turned(star) < 0.05 * math.pi / 2.0

    page.click("#tune-back")
    expect(page.locator("#tune-present")).to_contain_text("the configuration file's")


def test_the_menu_shows_and_engages_another_law_and_refuses_what_is_not_stable(page: Page, star: HurriedStar) -> None:
    page.select_option("#tune-law", "lqr")
    expect(page.locator("#tune [name=position_m]")).to_have_value("0.1")
    page.click("#tune-engage")
    expect(page.locator("#tune-present")).to_contain_text("In force: lqr, engaged by page-")
    expect(page.locator("#tune-law")).to_have_value("lqr")
    expect(page.locator("#tune-keep pre")).to_have_text(re.compile(r'^\[controller\]\s+positioning = "lqr"$'))
    page.select_option("#tune-law", "ipd")
    page.fill("#tune [name=model_function]", "1,1,2")
    page.press("#tune [name=model_function]", "Tab")
    expect(page.locator("#tune-refused")).to_contain_text("the model function 1,1,2 is not stable")
    expect(page.locator("#tune-engage")).to_be_disabled()
    page.click("#tune-discard")
    expect(page.locator("#tune-law")).to_have_value("lqr")
    told = star.ask(lambda s: s.bus.last(topics.CONTROL_GAINS))
    assert told.tuning.law == "lqr"


def test_the_slider_changes_what_is_predicted(page: Page) -> None:
    yaw = page.locator("#tune-table tr", has_text="delay margin").locator("td").last
    expect(yaw).to_have_text("0.93")
    page.locator("#tune [name=yaw_w0_rad_s]").fill("1")  # twice the vessel file's frequency
    expect(yaw).to_have_text("0.93 → 0.47")
    page.locator("#tune [name=yaw_w0_rad_s]").fill("-1")
    expect(yaw).to_have_text("0.93 → 1.87")


@pytest.mark.parametrize("star", ["pladypos", pytest.param("videoray", marks=pytest.mark.soak)], indirect=True)
def test_no_text_is_cut_in_any_tab_at_any_width(page: Page) -> None:
    expect(page.locator("#faults-button")).to_be_visible()
    for field, longest in (("x", "3.875"), ("y", "2.125"), ("psi", "-179.9"), ("speed", "0.125")):
        page.fill(f"#ref-{field}", longest)
    cut = {}
    for tab in page.locator("[role=tab]").all():
        tab.click()
        shown = page.locator(f"#{tab.get_attribute('data-tab')}")
        expect(shown.locator("button, table tbody td").first).to_be_visible()
        cut[tab.inner_text()] = cut_texts_at_all_sizes(page)
    assert not any(cut.values()), cut


@pytest.mark.parametrize("star", ["charlie"], indirect=True)
def test_a_boat_that_only_steers_has_its_heading_loop_tuned(page: Page, star: HurriedStar) -> None:
    expect(page.locator("#tune .tune-buttons").first).to_have_text("Tune yaw")
    expect(page.locator("#tune-law")).to_have_value("heading")
    settles = page.locator("#tune-table tr", has_text="within 5 % after").last.locator("td")
    expect(settles).to_have_count(1)
    page.locator("#tune [name=yaw_w0_rad_s]").fill("1")  # twice the vessel file's frequency
    expect(page.locator("#tune-table tr", has_text="delay margin").locator("td")).to_contain_text("→")
    page.locator("#tune [name=yaw_w0_rad_s]").fill("0.3")
    page.click("#tune-engage")
    expect(page.locator("#tune-present")).to_contain_text("In force: heading, engaged by page-")
    page.click("#tune-yaw")
    star.wait(lambda s: (h := s.bus.last(topics.HELM_STATE)) and h.mode == "experiment" and h.speed_m_s, "under way")
    page.click("#stop")
    star.wait(lambda s: (h := s.bus.last(topics.HELM_STATE)) and h.mode == "stop", "stopped")
