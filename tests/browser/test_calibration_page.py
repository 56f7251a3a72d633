"""Calibrate camera on the page: from the board before the (simulated) lens to a saved file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from camera_tracker.calibration import read_json
from camera_tracker.plane import CameraFile
from tests.browser.cut_texts import cut_texts_at_all_sizes
from tests.browser.fake_star import VESSEL, FakeStar
from tests.browser.test_page import DESK, open_page

pytestmark = pytest.mark.browser

FOCAL_PX = VESSEL.camera.scale_px_per_m * VESSEL.camera.height_m
RINGS_ON_CORNERS = """() => {
  const state = starboard.state.values["camera/calibration"];
  const canvas = document.querySelector("#camera");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const like = (i) => data[i + 1] > 220 && data[i] < 180 && data[i + 2] < 220;
  const green = (x, y) => like(4 * (y * width + x));
  let drawn = 0;
  for (let k = 0; k < state.corners_px.length; k += 2) {
    const [x, y] = [Math.round(state.corners_px[k]), Math.round(state.corners_px[k + 1])];
    let near = 0;
    for (let dx = -7; dx <= 7; dx++) for (let dy = -7; dy <= 7; dy++) near += green(x + dx, y + dy);
    drawn += near > 12;
  }
  return state.corners_px.length >= 16 && drawn > 0.4 * state.corners_px.length;
}"""
"""Whether there is a green ring at nearly every corner that the state tells, in the picture that it was found in."""


@pytest.fixture
def star(tmp_path: Path) -> Iterator[FakeStar]:
    with FakeStar(recordings=tmp_path).running() as star:
        yield star


@pytest.fixture
def page(star: FakeStar, browser: Browser) -> Iterator[Page]:
    with browser.new_context(viewport=DESK) as context:
        yield open_page(context.new_page(), star.url)


def begin_fault(page: Page, kind: str) -> None:
    page.click("#faults-button")
    page.click(f"#faults [data-kind={kind}] button[type=submit]")


def test_from_the_board_before_the_lens_to_a_saved_file(page: Page, tmp_path: Path) -> None:
    page.set_default_timeout(30_000)
    begin_fault(page, "board")
    page.click("[data-tab=calibrate]")
    page.click("#calibration-start")
    expect(page.locator("#calibration-running")).to_be_visible()
    page.wait_for_function(RINGS_ON_CORNERS)
    count = "Number(document.querySelector('#calibration-count').textContent)"
    page.wait_for_function(f"{count} >= 7")
    rows = page.locator("#calibration-views tbody tr")
    expect(rows.first).to_have_text(re.compile(r"board-\d\d(left|right|top|bottom|flat)0\.\d{3}"), timeout=30_000)
    page.click("#calibration-solve")
    expect(page.locator("#calibration-result")).to_contain_text("Reprojection error 0.", timeout=30_000)
    expect(page.locator("#calibration-automatic")).not_to_be_checked()
    expect(page.locator("#calibration-coverage [data-state=covered]").first).to_be_visible()
    assert cut_texts_at_all_sizes(page) == []
    page.click("#calibration-save")
    expect(page.locator("#calibration-result")).to_contain_text("File: ", timeout=30_000)
    shown = re.search(r"File: (\S+)", page.inner_text("#calibration-result"))
    assert shown is not None
    assert Path(shown[1]).is_relative_to(tmp_path)
    file: CameraFile = read_json(CameraFile, Path(shown[1]))
    assert file.lens.fx_px == pytest.approx(FOCAL_PX, rel=0.02)
    assert file.lens.rms_px < 0.5
    page.click("#calibration-cancel")
    expect(page.locator("#calibration-form")).to_be_visible()


def test_by_hand_a_view_is_taken_back_and_a_bad_set_refused(page: Page) -> None:
    page.set_default_timeout(30_000)
    page.click("[data-tab=calibrate]")
    page.click("#calibration-start")
    hint = page.locator("#calibration-hint")
    expect(hint).to_have_text(re.compile("^show the board"), timeout=30_000)
    expect(page.locator("#calibration-capture")).to_be_disabled()
    page.uncheck("#calibration-automatic")
    begin_fault(page, "board")
    page.click("[data-tab=calibrate]")
    page.click("#calibration-capture")
    expect(page.locator("#calibration-count")).to_have_text("1", timeout=30_000)
    page.click("#calibration-solve")
    expect(page.locator("#calibration-refused")).to_have_text(
        re.compile("in 1 pictures: take at least 4"), timeout=30_000
    )
    expect(page.locator("#calibration-save")).to_be_disabled()
    page.click("#calibration-undo")
    expect(page.locator("#calibration-count")).to_have_text("0", timeout=30_000)
    page.click("#calibration-cancel")
    expect(page.locator("#calibration-form")).to_be_visible()
