"""Who may publish and read which key: the hub's access rules, from the ports that the services declare.

The value is Zenoh's `access_control` (https://zenoh.io/docs/manual/access-control): deny what no rule allows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from bus import topics
from bus.bridge import BridgeConfig
from bus.security import HUB_NAME
from bus.service import Output, RawInput
from bus.topics import OPERATOR
from services.catalog import Process, Settings
from services.star import HUBS

ANSWERED = ("put", "delete", "reply", "liveliness_token")
ASKED = ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber")
WANTED = ("declare_subscriber", "declare_queryable")
"""What a hub tells a client of others' interest: without it a client sends nothing, as nobody seems to listen."""
EVERYTHING = ["**", "**/@hub/**"]
"""All keys, with those that hubs alone use among themselves: no wildcard fits a chunk with an @."""


def bridges(settings: Settings) -> dict[str, BridgeConfig]:
    """Return the sections of the bridges among a configuration's processes, by name."""
    sections = {p.name: settings.section(p) for p in settings.processes}
    return {name: section for name, section in sections.items() if isinstance(section, BridgeConfig)}


def access_rules(
    vessel: str, processes: Iterable[Process], bridged: Mapping[str, BridgeConfig] | None = None
) -> dict[str, Any]:
    """Return the rules for one user per process and for `operator` (the command line).

    A process publishes and reads its ports' keys and its own heartbeat, a bridge (`bridged`: by name) also what it
    passes on. The operator publishes what operators send, plays logs under `replay/`, and reads everything. The
    standby may do all.
    """
    time = f"{vessel}/@hub/time"
    rules: list[dict[str, Any]] = [
        _rule("hubs", [*ANSWERED, *ASKED, "declare_queryable"], ["ingress", "egress"], EVERYTHING),
        _rule("wanted", WANTED, ["egress"], ["**", time]),
        _rule("time_asked", ["query"], ["ingress"], [time]),
        _rule("time_told", ["reply"], ["egress"], [time]),
    ]
    subjects: list[dict[str, Any]] = [
        {"id": "hubs", "usernames": [HUBS[1]]},
        {"id": "hub_of_standby", "cert_common_names": [HUB_NAME]},
    ]
    policies: list[dict[str, Any]] = [{"rules": ["hubs"], "subjects": ["hubs", "hub_of_standby"]}]
    users = {p.name: _ports(vessel, p) for p in processes if p.name not in HUBS}
    for name, config in (bridged or {}).items():
        writes, reads = config.keys(vessel)
        users[name] = (users[name][0] + writes, users[name][1] + reads)
    sent = [f"{vessel}/{t.key}" for t in topics.all_topics() if t.publisher == OPERATOR]
    users[OPERATOR] = ([*sent, "replay/**"], ["**"])
    for name, (writes, reads) in users.items():
        own = [
            _rule(f"{name}_writes", ["put", "liveliness_token"], ["ingress"], writes),
            _rule(f"{name}_asks", ASKED, ["ingress"], reads),
            _rule(f"{name}_gets", ANSWERED, ["egress"], reads),
        ]
        own = [rule for rule in own if rule["key_exprs"]]
        rules += own
        subjects.append({"id": name, "usernames": [name]})
        names = [*(rule["id"] for rule in own), "wanted", "time_asked", "time_told"]
        policies.append({"rules": names, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _ports(vessel: str, process: Process) -> tuple[list[str], list[str]]:
    """Return the full keys that a process (publishes, reads)."""
    ports = process.service.ports.values()
    writes = [p.topic.key for p in ports if isinstance(p, Output)]
    writes += [f"service/{process.name}", topics.HEARTBEAT.of(process.name).key]
    reads = [p.pattern if isinstance(p, RawInput) else p.topic.pattern for p in ports if not isinstance(p, Output)]
    return [f"{vessel}/{key}" for key in dict.fromkeys(writes)], [f"{vessel}/{key}" for key in dict.fromkeys(reads)]


def _rule(name: str, messages: Iterable[str], flows: list[str], keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "messages": list(messages),
        "flows": flows,
        "permission": "allow",
        "key_exprs": keys,
    }
