"""`starboard status`: every process and topic."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from bus.clock import CLOCK
from services.cli.system import client, service_states

HEARTBEAT_STALE_S = 3.0


def status(
    hub: Annotated[str | None, typer.Option(help="Address of the hub; without it the running system's.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Show every process (state, rate, restarts) and every topic (age, rate)."""
    with client(hub) as bus:
        values = bus.last_values()
        names = bus.alive()
    now_ns = CLOCK.now_ns()
    beats = {v.key.split("/")[1]: v for v in values if v.key.startswith("service/") and v.payload}
    known = {s["name"]: s for s in service_states()} or {
        n: {"name": n, "state": "running", "restarts": 0} for n in names
    }
    services = [_service(s, beats.get(n), now_ns) for n, s in known.items()]
    topics = [{"key": v.key, "age_s": round((now_ns - v.received_ns) * 1e-9, 3), "rate_hz": v.rate_hz} for v in values]
    if as_json:
        print(json.dumps({"services": services, "topics": topics, "warp": _warp(services)}))
    else:
        _print(services, topics)


def _warp(services: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how fast time shall run, how fast it does by the slowest service, and which that is."""
    told = [s for s in services if s["warp"]]
    slowest = min(told, key=lambda s: float(s["warp_reached"]), default=None)
    if slowest is None:
        return {"factor": 1.0, "reached": None, "slowest": ""}
    return {"factor": slowest["warp"], "reached": slowest["warp_reached"], "slowest": slowest["name"]}


def _service(known: dict[str, Any], beat: Any, now_ns: int) -> dict[str, Any]:
    heartbeat = json.loads(beat.payload) if beat else {}
    state = known["state"]
    if state == "running" and beat and (now_ns - beat.received_ns) * 1e-9 > HEARTBEAT_STALE_S:
        state = "hung"
    return {
        "name": known["name"],
        "state": state,
        "restarts": known["restarts"],
        "rate_hz": round(heartbeat.get("rate_hz", 0.0), 1),
        "step_max_ms": round(heartbeat.get("step_max_ms", 0.0), 2),
        "late_steps": heartbeat.get("late_steps", 0),
        "malformed": heartbeat.get("malformed", 0),
        "gaps": heartbeat.get("gaps", 0),
        "clock_offset_ms": _ms(heartbeat.get("clock_offset_s")),
        "clock_uncertainty_ms": _ms(heartbeat.get("clock_uncertainty_s")),
        "warp": heartbeat.get("warp"),
        "warp_reached": round(heartbeat.get("warp_reached", 0.0), 2),
        "note": heartbeat.get("note", ""),
    }


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1e3 * seconds, 3)


def _clock(service: dict[str, Any]) -> str:
    """Return the offset of a service's clock to the hub's, where it can be told from none."""
    offset_ms, uncertainty_ms = service["clock_offset_ms"], service["clock_uncertainty_ms"]
    return f"{offset_ms:+.1f} ± {uncertainty_ms:.1f}" if offset_ms else ""


def _print(services: list[dict[str, Any]], topics: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(
        "service", "state", "restarts", "rate Hz", "longest step ms", "late", "malformed", "gaps", "clock ms", "note"
    )
    for s in services:
        style = "" if s["state"] == "running" else "yellow" if s["state"] == "starting" else "red"
        numbers = [s["rate_hz"], s["step_max_ms"], s["late_steps"], s["malformed"], s["gaps"]]
        table.add_row(s["name"], s["state"], str(s["restarts"]), *map(str, numbers), _clock(s), s["note"], style=style)
    console.print(table)
    warp = _warp(services)
    if warp["factor"] != 1.0:
        console.print(f"time runs {warp['factor']:g} times as fast; {warp['reached']:.2f} reached ({warp['slowest']})")
    table = Table("topic", "age s", "rate Hz")
    for t in topics:
        table.add_row(t["key"], f"{t['age_s']:.2f}", f"{t['rate_hz']:.1f}")
    console.print(table)
