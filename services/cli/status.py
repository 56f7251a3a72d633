"""`starboard status`: every process and topic."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bus.clock import CLOCK
from bus.topics import HUB_STATISTICS, find
from services.cli.system import client, service_states

if TYPE_CHECKING:
    from bus.zenoh_bus import LastValue

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
    carried = _carried(next((_fields(v) for v in values if v.key == HUB_STATISTICS.key), {}))
    topics = [{"key": v.key, "age_s": round((now_ns - v.received_ns) * 1e-9, 3), "rate_hz": v.rate_hz} for v in values]
    if as_json:
        about = {"warp": _warp(services), "clock": _comparable(services), "hub": carried}
        print(json.dumps({"services": services, "topics": topics} | about))
    else:
        _print(services, topics, carried)


def _warp(services: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how fast time shall run, how fast it does by the slowest service, and which that is."""
    told = [s for s in services if s["warp"]]
    slowest = min(told, key=lambda s: float(s["warp_reached"]), default=None)
    if slowest is None:
        return {"factor": 1.0, "reached": None, "slowest": ""}
    return {"factor": slowest["warp"], "reached": slowest["warp_reached"], "slowest": slowest["name"]}


def _fields(value: LastValue) -> dict[str, Any]:
    """Return the fields of a last value; none where anything else was put on its key."""
    topic = find(value.key)
    try:
        return topic.message.decode(value.payload).model_dump() if topic and value.payload else {}
    except ValueError:
        return {}


def _carried(statistics: dict[str, Any]) -> dict[str, Any]:
    """Return what the hub carries and what it refused to keep, of its statistics."""
    return {name: statistics.get(name) for name in ("clients", "linked", "keys", "messages_hz", "bytes_s", "refused")}


def _comparable(services: list[dict[str, Any]]) -> dict[str, Any]:
    """Return to how many ms stamps of different processes can be compared, and whose clocks are not measured.

    A stamp is wrong by at most its process' uncertainty: two of them by that of the two worst. The hub's clock is the
    star's: there is nothing to measure.
    """
    known = sorted(s["clock_uncertainty_ms"] for s in services if s["clock_uncertainty_ms"] is not None)
    unmeasured = [s["name"] for s in services if s["clock_uncertainty_ms"] is None and s["name"] != "hub"]
    return {"comparable_ms": round(sum(known[-2:]), 3) if known else None, "not_measured": unmeasured}


def _service(known: dict[str, Any], beat: Any, now_ns: int) -> dict[str, Any]:
    heartbeat = _fields(beat) if beat else {}
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
    """Return the offset of a service's clock to the hub's: 0 where the measurement cannot tell it from that."""
    offset_ms, uncertainty_ms = service["clock_offset_ms"], service["clock_uncertainty_ms"]
    return "" if uncertainty_ms is None else f"{offset_ms:+.1f} ± {uncertainty_ms:.1f}".replace("+0.0", "0")


def _print(services: list[dict[str, Any]], topics: list[dict[str, Any]], hub: dict[str, Any]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console()
    console.width = max(console.width, 96)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in ("service", "state", "restarts", "Hz", "max ms", "late", "bad", "gaps", "clock ms"):
        table.add_column(name, no_wrap=True, justify="left" if name in ("service", "state") else "right")
    for s in services:
        style = "" if s["state"] == "running" else "yellow" if s["state"] == "starting" else "red"
        numbers = [s["restarts"], s["rate_hz"], s["step_max_ms"], s["late_steps"], s["malformed"], s["gaps"]]
        table.add_row(s["name"], s["state"], *map(str, numbers), _clock(s), style=style)
    console.print(table)
    for s in services:
        if s["note"]:
            console.print(f"{s['name']}: {s['note']}", highlight=False, markup=False)
    if hub["clients"] is not None:
        print(
            f"hub: {hub['clients']} clients, {'with' if hub['linked'] else 'without'} standby, {hub['keys']} keys, "
            f"{hub['messages_hz']:.0f} messages/s, {hub['bytes_s'] / 1000:.0f} kB/s, {hub['refused']} not kept"
        )
    warp, clock = _warp(services), _comparable(services)
    if warp["factor"] != 1.0:
        console.print(f"time runs {warp['factor']:g} times as fast; {warp['reached']:.2f} reached ({warp['slowest']})")
    if clock["comparable_ms"] is not None:
        unmeasured = f"; not measured: {', '.join(clock['not_measured'])}" if clock["not_measured"] else ""
        print(f"clocks measured through the hub: stamps are comparable to {clock['comparable_ms']:.1f} ms{unmeasured}")
    table = Table("topic", "age s", "rate Hz", box=box.SIMPLE_HEAD)
    for t in topics:
        table.add_row(t["key"], f"{t['age_s']:.2f}", f"{t['rate_hz']:.1f}")
    console.print(table)
