"""The page in headless Chromium against a made-up star: what an operator sees and does."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from bus import messages as m
from bus import topics
from bus.memory_bus import MemoryBus
from bus.service import RawSample, Service
from services.vessels import load_vessel
from tests.browser.fake_star import FakeStar, wait_for

pytestmark = pytest.mark.browser

DESK: ViewportSize = {"width": 1440, "height": 900}
TABLET: ViewportSize = {"width": 1024, "height": 768}
UPRIGHT: ViewportSize = {"width": 820, "height": 1180}
PHONE: ViewportSize = {"width": 390, "height": 844}


CENTRE_OF_MARK = """pose => {
  const canvas = document.querySelector("#camera");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const like = (i, ...rgb) => rgb.every((level, k) => Math.abs(data[i + k] - level) < 6);
  let [x, y, count] = [0, 0, 0];
  for (let i = 0; i < data.length; i += 4) {
    if (!like(i, 0x7d, 0xff, 0xb0)) continue;  // the colour of a good pose
    [x, y, count] = [x + (i / 4) % canvas.width, y + Math.floor(i / 4 / canvas.width), count + 1];
  }
  return count > 100 && Math.hypot(x / count - pose.x_px, y / count - pose.y_px) < 60;
}"""
"""Whether the mark drawn into the picture lies round the pose (its arrow reaches ahead)."""

DASHES_OF_REGION = """pose => {
  const canvas = document.querySelector("#camera");
  const [left, top, right, bottom] = pose.region_px;
  const { data } = canvas.getContext("2d").getImageData(left, top - 1, right - left, 3);
  let green = 0;
  for (let i = 0; i < data.length; i += 4) green += data[i + 1] > 180 && data[i] < 160;
  return green > 40 && green < 3 * (right - left);
}"""
"""Whether the upper edge of the region where the tracker looked is drawn, dashed, into the picture."""


@pytest.fixture
def star() -> Iterator[FakeStar]:
    with FakeStar().running() as star:
        yield star


@pytest.fixture
def page(star: FakeStar, browser: Browser) -> Iterator[Page]:
    with browser.new_context(viewport=DESK) as context:
        yield open_page(context.new_page(), star.url)


def open_page(page: Page, url: str) -> Page:
    """Open the page and wait until it shows the vessel; an error in its console until then fails the test."""
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    page.set_default_timeout(5000)
    page.goto(url)
    page.wait_for_function("window.starboard?.state.values['helm/state'] && starboard.state.values['navigation/state']")
    assert errors == []
    return page


def snapshot(page: Page) -> dict[str, Any]:
    state = page.evaluate("starboard.state")
    assert isinstance(state, dict)
    return state


def press_at(page: Page, x_m: float, y_m: float, drag: tuple[float, float] | None = None) -> None:
    at = page.evaluate(f"starboard.worldToMap({x_m}, {y_m})")
    page.mouse.move(at["x"], at["y"])
    page.mouse.down()
    if drag is not None:
        page.mouse.move(at["x"] + drag[0], at["y"] + drag[1], steps=4)
    page.mouse.up()


def centre(page: Page, selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def take_stick(page: Page) -> None:
    page.click("#manual")
    page.wait_for_function("starboard.state.driving")


def push_stick(page: Page, selector: str, dx: float, dy: float) -> None:
    x, y = centre(page, selector)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=3)


def test_a_click_and_hold_ends_at_that_place_with_the_dragged_heading(page: Page, star: FakeStar) -> None:
    press_at(page, 1.4, 2.2, drag=(40.0, 40.0))
    expect(page.locator("#ref-x")).to_have_value("1.4")
    expect(page.locator("#ref-psi")).to_have_value("45")
    page.click("#hold")
    expect(page.locator("#mode")).to_have_text("holding")
    wait_for(lambda: math.hypot(star.vessel.x - 1.4, star.vessel.y - 2.2) < 0.02, "the vessel is there", 10.0)
    assert star.requests[0].psi_rad == pytest.approx(math.pi / 4, abs=0.01)
    assert star.vessel.psi == pytest.approx(math.pi / 4, abs=0.05)


def test_typed_numbers_choose_a_place_inside_the_pool(page: Page, star: FakeStar) -> None:
    page.fill("#ref-psi", "-270")
    page.fill("#ref-x", "99")
    page.press("#ref-x", "Tab")
    expect(page.locator("#ref-x")).to_have_value("4.7")
    lease = page.locator("#lease")
    expect(lease).to_contain_text("limited by the walls to x 0.30 … 4.70 m)")
    page.fill("#ref-psi", "90")
    page.fill("#ref-y", "-1")
    page.press("#ref-y", "Tab")
    expect(lease).to_contain_text("limited by the walls to x 0.30 … 4.70 m, y 0.30 … 3.45 m)")
    page.fill("#ref-x", "4")
    expect(lease).to_contain_text("limited by the walls to y 0.30 … 3.45 m)")
    page.fill("#ref-x", "99")
    page.click("#hold")
    wait_for(lambda: star.requests, "a request")
    request = star.requests[0]
    assert request.x_m == pytest.approx(5.0 - 0.3)
    assert request.psi_rad == pytest.approx(math.pi / 2)


def test_why_a_clicked_place_was_limited_is_told_while_the_heading_is_dragged(page: Page) -> None:
    press_at(page, 4.95, 2.0, drag=(-60.0, 0.0))
    expect(page.locator("#ref-psi")).to_have_value("180")
    expect(page.locator("#lease")).to_contain_text("limited by the walls to x 0.30 … 4.70 m)")
    press_at(page, 4.5, 2.0)
    expect(page.locator("#lease")).not_to_contain_text("limited")


COUNT_OF_COLOUR = """([x0, y0, x1, y1]) => {
  const canvas = document.querySelector("#map");
  const ratio = canvas.width / canvas.clientWidth, box = canvas.getBoundingClientRect();
  const [left, top] = [Math.min(x0, x1) - box.left - 2, Math.min(y0, y1) - box.top - 2].map((v) => v * ratio);
  const [width, height] = [Math.abs(x1 - x0) + 5, Math.abs(y1 - y0) + 5].map((v) => v * ratio);
  const { data } = canvas.getContext("2d").getImageData(left, top, width, height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) count += data[i] > 200 && data[i + 1] > 140 && data[i + 2] < 110;
  return count / ratio / ratio;
}"""
"""How many pixels between two places on the screen have the colour of a reference."""


def test_way_points_are_set_moved_and_deleted_on_the_map_and_followed(page: Page, star: FakeStar) -> None:
    page.click("#route-edit")
    for place in ((1.0, 1.0), (3.0, 1.0), (3.0, 2.5), (4.0, 3.0)):
        press_at(page, *place)
    at = page.evaluate("starboard.worldToMap(4.0, 3.0)")
    page.mouse.dblclick(at["x"], at["y"])
    begin, end = (page.evaluate(f"starboard.worldToMap({x}, 2.5)") for x in (3.0, 2.0))
    page.mouse.move(begin["x"], begin["y"])
    page.mouse.down()
    page.mouse.move(end["x"], end["y"], steps=4)
    page.mouse.up()
    page.wait_for_function("starboard.state.route.length === 3 && starboard.state.route[2].x_m < 2.1")
    assert star.requests == [], "nothing is asked before Follow"
    page.check("#route-smooth")
    page.fill("#route-speed", "0.12")
    expect(page.locator("#route-follow")).to_have_text("Follow path")
    page.click("#route-follow")
    expect(page.locator("#mode")).to_have_text("following path")
    request = star.requests[0]
    assert (request.mode, request.smooth, request.speed_m_s) == ("path", True, 0.12)
    assert [(round(p.x_m, 1), round(p.y_m, 1)) for p in request.points] == [(1.0, 1.0), (3.0, 1.0), (2.0, 2.5)]
    expect(page.locator("#route-follow")).to_be_disabled()  # it is the helm's now
    first, last = (page.evaluate(f"starboard.worldToMap({x}, 1.0)") for x in (1.5, 2.5))
    box = [first["x"], first["y"] - 40, last["x"], last["y"] + 40]
    page.wait_for_function(f"({COUNT_OF_COLOUR})({box}) > 60")  # the path in force, bent between its way-points


def test_one_way_point_is_a_line_from_here(page: Page, star: FakeStar) -> None:
    page.click("#route-edit")
    press_at(page, 2.0, 2.0)
    page.click("#route-follow")
    expect(page.locator("#mode")).to_have_text("following line")
    assert (star.requests[0].mode, len(star.requests[0].points), star.requests[0].speed_m_s) == ("line", 1, None)


def test_the_guard_is_shown_and_the_stick_stays_under_the_hand(page: Page, star: FakeStar) -> None:
    take_stick(page)
    expect(page.locator("#lease")).to_have_text("You have the helm")
    place = page.locator("#stick").bounding_box()
    star.helm.wanted = star.helm.wanted.model_copy(update={"guard": "before the wall at x = 5 m"})
    expect(page.locator("#guard")).to_have_text("Guard: kept before the wall at x = 5 m")
    assert page.locator("#stick").bounding_box() == place
    star.helm.wanted = star.helm.wanted.model_copy(update={"guard": ""})
    expect(page.locator("#guard")).to_be_hidden()


def test_the_stick_drives_in_manual_and_is_let_go_with_the_button(page: Page, star: FakeStar) -> None:
    push_stick(page, "#stick", 0.0, -60.0)
    page.mouse.up()
    assert star.joysticks == [], "outside manual nothing is sent"
    take_stick(page)
    star.vessel.psi = 0.0
    start = star.vessel.x
    push_stick(page, "#stick", 0.0, -60.0)
    wait_for(lambda: star.vessel.x > start + 0.1, "the vessel moves ahead")
    assert star.joysticks[-1].surge > 0.8
    assert abs(star.joysticks[-1].sway) < 0.1
    page.mouse.up()
    wait_for(lambda: star.joysticks[-1].surge == 0.0, "zero", 0.5)
    push_stick(page, "#yaw-stick", 60.0, 0.0)
    wait_for(lambda: star.joysticks[-1].yaw > 0.5, "yaw to starboard")
    page.mouse.up()


def test_closing_the_tab_in_the_middle_of_a_drag_zeroes_the_stick(page: Page, star: FakeStar) -> None:
    take_stick(page)
    push_stick(page, "#stick", 50.0, 0.0)
    wait_for(lambda: star.joysticks and star.joysticks[-1].sway > 0.5, "driving")
    page.close()
    wait_for(lambda: star.joysticks[-1].sway == 0.0, "zero", 1.0)
    wait_for(lambda: star.helm.wanted.mode == "stop", "manual ends", 1.0)


def test_keys_drive_and_losing_the_focus_lets_go(page: Page, star: FakeStar) -> None:
    page.keyboard.press("m")
    page.wait_for_function("starboard.state.driving")
    page.keyboard.down("w")
    page.keyboard.down("e")
    wait_for(lambda: star.joysticks and (star.joysticks[-1].surge, star.joysticks[-1].yaw) == (1.0, 1.0), "W and E")
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    wait_for(lambda: (star.joysticks[-1].surge, star.joysticks[-1].yaw) == (0.0, 0.0), "zero", 0.5)


@pytest.mark.parametrize("key", ["Escape", "Space"])
def test_stop_by_key_wins_over_the_focused_button(page: Page, star: FakeStar, key: str) -> None:
    take_stick(page)  # the focus is on Manual now
    page.keyboard.press(key)
    wait_for(lambda: star.helm.wanted.mode == "stop", "stopped", 1.0)
    expect(page.locator("#mode")).to_have_text("stopped")
    assert [r.mode for r in star.requests if r.action == "mode"] == ["manual", "stop"]


def test_the_page_that_has_the_helm_renews_and_another_must_take_over(
    page: Page, star: FakeStar, browser: Browser
) -> None:
    take_stick(page)
    wait_for(lambda: sum(r.action == "renew" for r in star.requests) >= 1, "a renewal")
    with browser.new_context(viewport=TABLET) as context:
        other = open_page(context.new_page(), star.url)
        other.click("#manual")
        expect(other.locator(".toast")).to_contain_text("has the helm")
        assert not snapshot(other)["driving"]
        other.get_by_role("button", name="Take over").click()
        other.wait_for_function("starboard.state.driving")
        page.wait_for_function("!starboard.state.driving")  # it hears of it by the next message
        page.click("#stop")  # needs no lease
        wait_for(lambda: star.helm.wanted.mode == "stop", "stopped", 1.0)


def test_every_field_is_in_the_table_with_its_unit_and_a_click_plots_it(page: Page) -> None:
    row = page.locator('#vars [data-key="navigation/state"] [data-path="surge_m_s"]')
    expect(row.locator(".unit")).to_have_text("m/s")
    group = page.locator('#vars [data-key="navigation/state"] .group td')
    expect(group.nth(1)).to_have_text("30 Hz")
    charts = page.locator(".chart")
    before = charts.count()
    row.locator("button").click()
    expect(charts).to_have_count(before + 1)
    page.wait_for_function("[...document.querySelectorAll('.chart .series')].at(-1).textContent.includes('surge')")
    page.fill("#vars-filter", "quality")
    expect(row).to_be_hidden()
    expect(page.locator('#vars [data-path="quality"]')).to_be_visible()
    shown, sent = set(), snapshot(page)["values"]
    page.fill("#vars-filter", "")
    for key in sent:
        shown |= {key for _ in range(page.locator(f'#vars [data-key="{key}"]').count())}
    assert shown == set(sent)


def test_the_camera_shows_the_picture_with_the_tracked_pose(page: Page, star: FakeStar) -> None:
    star.vessel.circles = False  # it stands still, so that picture and pose are of one place
    page.wait_for_function(f"({CENTRE_OF_MARK})(starboard.state.values['camera/pose'])")
    page.wait_for_function(f"({DASHES_OF_REGION})(starboard.state.values['camera/pose'])")
    expect(page.locator("#camera-note")).to_contain_text("quality 0.93")


def test_services_devices_and_recording_are_shown(page: Page, star: FakeStar) -> None:
    beat = m.Heartbeat(
        state="running", pid=1, rate_hz=2, late_steps=0, step_mean_ms=0, step_max_ms=0, clock_offset_s=3.2,
        clock_uncertainty_s=0.0004,
    )  # fmt: skip
    star.publish(topics.HEARTBEAT.of("far"), beat)
    expect(page.locator("#recording")).to_contain_text("REC")
    page.click("[data-tab=health]")
    expect(page.locator('#health [data-service="helm"]')).to_have_attribute("data-level", "ok")
    expect(page.locator('#health [data-service="allocator"]')).to_contain_text("not seen")
    expect(page.locator("#health .devices")).to_contain_text("connected")
    expect(page.locator("#health .devices")).to_contain_text("corrected: far 3200.0 ± 0.4 ms")


def test_a_thruster_is_left_out_and_works_again(page: Page, star: FakeStar) -> None:
    page.click("[data-tab=health]")
    row = page.locator("#actuators tbody[data-actuator=front_port]")
    row.get_by_role("button", name="Leave it out").click()
    expect(row).to_have_attribute("data-level", "error")
    expect(row).to_contain_text("failed (operator)")
    expect(page.locator("#banner")).to_contain_text("front_port has failed")
    wait_for(lambda: star.vessel.crew.failed == {"front_port": "operator"}, "the operator's word")
    row.get_by_role("button", name="Works again").click()
    expect(row).to_have_attribute("data-level", "ok")
    assert star.vessel.crew.failed == {}


def test_a_detected_failure_is_left_out_from_the_banner(page: Page, star: FakeStar) -> None:
    expect(page.locator("#banner-action")).to_be_hidden()
    star.vessel.crew = m.ActuatorHealth(lost={"rear_port": 0.93}, reason="rear_port has lost 93 % of its thrust")
    expect(page.locator("#banner")).to_contain_text("rear_port has lost 93 %")
    page.click("#banner-action")
    wait_for(lambda: star.vessel.crew.failed == {"rear_port": "operator"}, "the operator's word")
    expect(page.locator("#banner")).to_contain_text("rear_port has failed (operator)")
    expect(page.locator("#banner-action")).to_be_hidden()
    star.vessel.crew = m.ActuatorHealth(failed={"rear_port": "detected"}, reason="rear_port has failed (detected)")
    expect(page.locator("#banner-action")).to_have_text("rear_port works again")
    page.click("#banner-action")
    wait_for(lambda: star.vessel.crew.failed == {}, "the operator's word")
    expect(page.locator("#banner-action")).to_be_hidden()


def asked_for(star: FakeStar, mode: m.Mode) -> m.OperatorRequest:
    """Return the newest request for a mode, as soon as there is one."""
    wait_for(lambda: any(request.mode == mode for request in star.requests), f"a request for {mode}")
    return [request for request in star.requests if request.mode == mode][-1]


def test_speed_and_heading_are_asked_for_with_their_references(page: Page, star: FakeStar) -> None:
    page.fill("#ref-psi", "90")
    page.fill("#ref-speed", "0.15")
    page.click("#speed")
    asked = asked_for(star, "speed")
    assert (asked.speed_m_s, asked.x_m) == (0.15, None)
    assert asked.psi_rad == pytest.approx(math.pi / 2, abs=1e-3)
    expect(page.locator("#speed")).to_have_attribute("aria-pressed", "true")
    page.click("#heading")
    asked = asked_for(star, "heading")
    assert (asked.speed_m_s, asked.psi_rad) == (None, None)
    expect(page.locator("#depth")).to_have_count(0)  # this vessel does not dive
    expect(page.locator("#heave-stick")).to_be_hidden()


def test_a_vessel_that_dives_has_a_stick_for_heave_and_mode_depth_but_no_hold_without_sway(browser: Browser) -> None:
    star = FakeStar(vessel=load_vessel("videoray"))
    with star.running(), browser.new_context(viewport=TABLET) as context:
        page = open_page(context.new_page(), star.url)
        expect(page.locator("#hold")).to_be_hidden()
        take_stick(page)
        page.keyboard.down("f")
        wait_for(lambda: star.joysticks and star.joysticks[-1].heave == 1.0, "the stick down")
        page.keyboard.up("f")
        wait_for(lambda: star.joysticks[-1].heave == 0.0, "the stick at rest")
        push_stick(page, "#heave-stick", 0.0, -60.0)
        wait_for(lambda: star.joysticks[-1].heave < -0.5, "the stick up")
        page.mouse.up()
        page.fill("#ref-depth", "0.4")
        page.click("#depth")
        assert asked_for(star, "depth").z_m == 0.4
        expect(page.locator("#depth")).to_have_attribute("aria-pressed", "true")


def test_an_experiment_asks_for_what_it_uses_on_axes_that_there_are(page: Page, star: FakeStar) -> None:
    page.click("[data-tab=experiment]")
    form = page.locator("#experiment-form")
    assert form.locator("[name=axis] option").all_inner_texts() == ["yaw", "surge", "sway"]
    form.locator("[name=axis]").select_option("surge")
    expect(form).to_contain_text("turn back at, m")
    form.locator("[name=hysteresis]").fill("0.3")
    form.locator("[name=name]").select_option("step")
    expect(form.locator("[name=hysteresis]")).to_be_disabled()
    page.click("#experiment-start")
    assert asked_for(star, "experiment").experiment == m.ExperimentPlan(name="step", axis="surge")


def test_a_fault_goes_to_the_simulator(page: Page, star: FakeStar) -> None:
    page.click("#faults-button")
    page.fill('[data-kind="current"] [name="y_m_s"]', "-0.03")
    page.click('[data-kind="current"] >> text=Begin')
    wait_for(lambda: star.vessel.faults, "a fault")
    fault = star.vessel.faults[0]
    assert (fault.kind, fault.active, fault.x_m_s, fault.y_m_s) == ("current", True, 0.05, -0.03)
    page.click('[data-kind="camera_black"] >> text=End')
    wait_for(lambda: len(star.vessel.faults) == 2, "its end")
    assert not star.vessel.faults[1].active


def test_the_banner_shouts_when_bus_helm_or_server_fall_silent(page: Page, star: FakeStar) -> None:
    banner = page.locator("#banner")
    expect(banner).to_be_hidden()
    star.helm.wanted = star.helm.wanted.model_copy(
        update={"mode": "hold", "status": "armed", "suspended": True, "reason": "no wrench from the controller"}
    )
    expect(banner).to_contain_text("no wrench from the controller")
    star.helm.wanted = m.HelmState(mode="stop", status="fault", reason="suspended for 10 s: the pose is lost")
    expect(banner).to_contain_text("the pose is lost. It has stopped: choose a mode to go on.")
    star.helm.wanted = m.HelmState(mode="stop", status="disarmed")
    expect(banner).to_be_hidden()
    star.vessel.unplugged = "/dev/video0: no such camera"
    expect(banner).to_contain_text("No camera /dev/video0: no such camera")
    expect(page.locator("#lamp-camera")).to_have_text("No camera")
    star.vessel.unplugged = ""
    expect(banner).to_be_hidden()
    star.do(lambda bus: bus.pause("helm"))
    expect(banner).to_contain_text("The helm is silent")
    star.do(lambda bus: bus.resume("helm"))
    expect(banner).to_be_hidden()
    star.paused = True
    expect(banner).to_contain_text("Connection to the server lost")
    expect(page.locator("#mode")).to_have_text("unknown")
    star.paused = False
    expect(banner).to_be_hidden()


def test_a_wish_waits_for_a_helm_that_is_silent_unless_stop_takes_it_back(page: Page, star: FakeStar) -> None:
    def silent() -> None:
        star.do(lambda bus: bus.pause("helm"))
        expect(page.locator("#banner")).to_contain_text("The helm is silent")

    def there() -> None:
        star.do(lambda bus: bus.resume("helm"))
        expect(page.locator("#banner")).to_be_hidden()

    def asked() -> list[m.Mode | None]:
        return [r.mode for r in star.requests if r.action == "mode"]

    silent()
    page.click("#hold")
    expect(page.locator(".toast").last).to_contain_text("The helm is silent: hold waits for it")
    page.click("#stop")
    there()
    wait_for(lambda: asked() == ["stop"], "only a stop was asked for")
    silent()
    page.click("#hold")
    there()
    expect(page.locator("#mode")).to_have_text("holding")
    assert asked() == ["stop", "hold"]


def test_a_stop_pressed_without_a_connection_is_sent_after_it(page: Page, star: FakeStar) -> None:
    take_stick(page)
    page.click("#hold")
    expect(page.locator("#mode")).to_have_text("holding")
    page.context.set_offline(True)
    page.evaluate("starboard.cut()")
    page.click("#stop")
    expect(page.locator(".toast").last).to_contain_text("No connection")
    page.context.set_offline(False)
    wait_for(lambda: star.helm.wanted.mode == "stop", "stopped")


def test_odd_values_on_the_bus_do_not_break_the_page(page: Page, star: FakeStar) -> None:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    odd = b'{"a":{"b":[1,null,"x"]},"seq":"no","stamp_ns":null,"<img src=x onerror=alert(1)>":"<b>"}'
    star.do(lambda bus: star.page.everything.offer(RawSample("free/<i>odd", odd, 0)))
    far = {"x_m": -1e9, "y_m": 1e9, "psi_rad": 99.0, "surge_m_s": 0.0, "sway_m_s": 0.0, "yaw_rad_s": 0.0}
    star.publish(topics.NAVIGATION_STATE, m.NavigationState(status="lost", measurement_age_s=1e6, **far))
    expect(page.locator("#vars")).to_contain_text("free/<i>odd")
    page.wait_for_function("starboard.state.values['navigation/state'].status === 'tracking'")
    assert errors == []


def test_bad_measurements_are_told_with_their_reason(page: Page, star: FakeStar) -> None:
    """A pose too far away, a pose that jumped for good, and what is no number: issue 7, bad input."""
    camera, banner = page.locator("#lamp-camera"), page.locator("#banner")
    expect(camera).to_contain_text("tracking")
    star.vessel.rejected = 4
    expect(camera).to_have_text("Camera pose refused")
    star.vessel.jumps = 1
    expect(banner).to_contain_text("The measured pose jumped")
    note = "the measured pose jumped by 0.75 m and 0 degrees: believed after 5 poses"
    beat = m.Heartbeat(state="running", pid=1, rate_hz=25, late_steps=0, step_mean_ms=0, step_max_ms=0, note=note)
    star.publish(topics.HEARTBEAT.of("estimator"), beat)
    expect(banner).to_contain_text("by 0.75 m and 0 degrees: believed after 5 poses. The vessel goes back slowly.")
    page.click("[data-tab=health]")
    nan = b'{"stamp_ns":1,"seq":1,"source":"x","client":"x","surge":NaN}'
    star.do(lambda bus: star.vessel.joystick.offer(nan))
    row = page.locator('#health [data-service="simulator"]')
    expect(row).to_have_attribute("data-level", "warn")
    expect(row).to_contain_text("operator/joystick: dropped a malformed message: surge")


class Notes(Service):
    """Heartbeats of services that have something to tell."""

    name = "notes"
    rate_hz = 5.0
    notes: ClassVar = {
        "estimator": "the measured pose jumped by 0.75 m and 0 degrees: believed after 5 poses",
        "experiment": "engaged models: recordings/pladypos-engaged.toml",
        "hub": "last values not saved: No space left on device",
    }

    def __init__(self, bus: MemoryBus) -> None:
        self.bus = bus

    def step(self, now_s: float) -> None:
        for name, note in self.notes.items():
            beat = m.Heartbeat(
                state="running", pid=1, rate_hz=1, late_steps=0, step_mean_ms=0, step_max_ms=0, note=note
            )
            self.bus.publish(topics.HEARTBEAT.of(name), beat)


def test_the_lamp_goes_back_when_what_a_note_tells_of_is_over(star: FakeStar, browser: Browser) -> None:
    with browser.new_context(viewport=DESK) as context:
        page = context.new_page()
        page.clock.install()
        open_page(page, star.url)
        star.do(lambda bus: bus.add(Notes(bus)))
        page.click("[data-tab=health]")
        lamp, row = page.locator("#lamp-services"), '#health [data-service="{}"]'
        expect(lamp).to_have_attribute("title", re.compile("estimator: the measured pose jumped by 0.75 m"))
        expect(page.locator(row.format("estimator"))).to_have_attribute("data-level", "warn")
        expect(page.locator(row.format("experiment"))).to_have_attribute("data-level", "ok")
        for _ in range(12):  # 18 s, in steps: the page takes a longer silence for a dead connection
            stamp_ns = page.evaluate("starboard.state.values['service/hub/heartbeat'].stamp_ns")
            page.clock.fast_forward(1500)
            page.wait_for_function(f"starboard.state.values['service/hub/heartbeat'].stamp_ns > {stamp_ns}")
        expect(page.locator(row.format("estimator"))).to_have_attribute("data-level", "ok")
        expect(page.locator(row.format("estimator"))).to_contain_text("the measured pose jumped")
        expect(lamp).to_have_attribute("title", re.compile("hub: last values not saved"))
        expect(lamp).not_to_have_attribute("title", re.compile("estimator"))


@pytest.mark.parametrize("size", [DESK, TABLET, UPRIGHT, PHONE], ids=["desk", "tablet", "upright", "phone"])
def test_the_layout_fits_and_stop_is_in_reach(star: FakeStar, browser: Browser, size: ViewportSize) -> None:
    with browser.new_context(viewport=size, has_touch=size is not DESK) as context:
        page = open_page(context.new_page(), star.url)
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
        page.evaluate("window.scrollTo(0, 1e6)")
        stop = page.locator("#stop").bounding_box()
        assert stop is not None
        assert 0 <= stop["y"] <= size["height"] - stop["height"], "in reach wherever one has scrolled to"
        for selector in ("#stop", "#manual", "#hold", "#stick", "#yaw-stick", "#plots-pause", "#ref-x", "#vars-filter"):
            box = page.locator(selector).bounding_box()
            assert box is not None
            assert min(box["width"], box["height"]) >= 44, selector
        if size is DESK:
            assert page.evaluate("document.documentElement.scrollHeight") <= size["height"]
