"""What the whole star costs with the page open in a browser (the browser itself apart)."""

from __future__ import annotations

import psutil
from playwright.sync_api import sync_playwright

from benchmarks.result import NotMeasured, Result
from benchmarks.running_star import RunningStar, wait_for

SETTLE_S = 5.0
SECONDS = 20.0


def measure() -> list[Result]:
    """Return processor time in parts of one core and resident memory, in all and by service."""
    with RunningStar() as star, sync_playwright() as playwright:
        pids = {name: star.pid(name) for name in wait_for(star.states, 10.0, "the services")}
        star.hold(2.0, 1.5, 0.0)
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page()
        page.goto(star.page)
        page.wait_for_timeout(1e3 * SETTLE_S)
        processes = {name: psutil.Process(pid) for name, pid in pids.items()}
        before = {name: _cpu_s(p) for name, p in processes.items()}
        page.wait_for_timeout(1e3 * SECONDS)
        try:
            used = {name: (_cpu_s(p) - before[name]) / SECONDS for name, p in processes.items()}
        except psutil.NoSuchProcess as error:
            raise NotMeasured(f"a service ended while it was measured: {error}") from None
        memory = {name: p.memory_info().rss / 1e6 for name, p in processes.items()}
        browser.close()
    cores = {f"{name}_cores": round(value, 3) for name, value in used.items()}
    megabytes = {f"{name}_mb": round(value, 1) for name, value in memory.items()}
    return [
        Result("all_services_cores", sum(used.values()), cores, goal=0.6),
        Result("all_services_rss_mb", sum(memory.values()), megabytes, goal=1200.0),
    ]


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
