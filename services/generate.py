"""What is generated from the catalogue and the topics: the star's diagram and the tables in docs/.

`python -m services.generate` writes them, `--check` fails when a copy is stale (`make docs`, `make check`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from bus import topics
from bus.config import Section
from bus.messages import Message
from bus.service import Input, Output
from bus.topics import Topic
from bus.units import unit_of
from marine.control.laws import known_laws
from services.catalog import PROCESSES, ROOT, Process, SystemConfig
from services.star import declared_star, mermaid

BEGIN = "<!-- generated: {} -->"
END = "<!-- end of generated: {} -->"


def read_by(process: Process) -> list[Topic[Any]]:
    """Return the topics that a process reads through typed inputs."""
    return [p.topic for p in process.service.ports.values() if isinstance(p, Input)]


def published_by(process: Process) -> list[Topic[Any]]:
    """Return the topics that a process publishes, besides its heartbeat."""
    return [p.topic for p in process.service.ports.values() if isinstance(p, Output)]


def star_diagram() -> str:
    """Return the star as a Mermaid flowchart: what each process sends to the hub and gets from it."""
    return mermaid(declared_star())


def process_table() -> str:
    """Return the list of processes as Markdown."""
    lines = ["| process | at least every | what it does |", "|---|---|---|"]
    for process in PROCESSES:
        period_ms = 1000.0 / process.service.rate_hz
        lines.append(f"| `{process.name}` | {period_ms:.0f} ms | {process.doc} |")
    return "\n".join(lines)


def topic_table() -> str:
    """Return all topics with their fields as Markdown."""
    lines = ["| key | publisher | rate | quality | what it is | fields |", "|---|---|---|---|---|---|"]
    for topic in topics.all_topics():
        rate = "on change" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz"
        fields = ", ".join(
            f"{name} [{unit}]" if (unit := unit_of(name)) else name
            for name in topic.message.model_fields
            if name not in Message.model_fields
        )
        lines.append(f"| `{topic.key}` | {topic.publisher} | {rate} | {topic.qos.value} | {topic.doc} | {fields} |")
    return "\n".join(lines)


def configuration_tables() -> str:
    """Return every section of a configuration file with its keys and defaults as Markdown."""
    sections: list[tuple[str, type[Section] | None]] = [("system", SystemConfig)]
    sections += [(p.name, p.config) for p in PROCESSES]
    return "\n\n".join(_section_table(name, model) for name, model in sections if model and model.model_fields)


def _section_table(name: str, model: type[Section]) -> str:
    lines = [f"### [{name}]", "", "| key | default | meaning |", "|---|---|---|"]
    for key, field in model.model_fields.items():
        default = "required" if field.is_required() else f"`{field.get_default(call_default_factory=True)}`"
        lines.append(f"| `{key}` | {default.replace('|', '/')} | {field.description or ''} |")
    return "\n".join(lines)


def law_table() -> str:
    """Return every positioning law with its parameters as Markdown."""
    lines = ["| law | what it does | parameters of `[controller.laws.NAME]` |", "|---|---|---|"]
    for law in known_laws().values():
        parameters = "; ".join(
            f"`{f.name}` = `{f.default}`: {f.metadata.get('doc', '')}" for f in fields(law.Parameters)
        )
        lines.append(f"| `{law.name}` | {(law.__doc__ or '').splitlines()[0]} | {parameters} |")
    return "\n".join(lines)


GENERATED: dict[str, tuple[str, Callable[[], str]]] = {
    "star": ("docs/architecture.md", lambda: f"```mermaid\n{star_diagram()}\n```"),
    "processes": ("docs/architecture.md", process_table),
    "topics": ("docs/topics.md", topic_table),
    "laws": ("docs/control.md", law_table),
    "configuration": ("docs/configuration.md", configuration_tables),
}
"""Name of a generated part -> the page it stands in, and what makes it."""


def renewed(text: str, name: str, content: str) -> str:
    """Return a page with the part of that name renewed; raise ValueError when the page has no place for it."""
    begin, end = BEGIN.format(name), END.format(name)
    head, found, rest = text.partition(begin)
    _, closed, tail = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"no place for the generated part {name!r}")
    return f"{head}{begin}\n{content}\n{end}{tail}"


def stale(write: bool, root: Path = ROOT) -> list[str]:
    """Return which generated parts differ from their source; with `write` renew them."""
    differing = []
    for name, (page, make) in GENERATED.items():
        path = root / page
        text = path.read_text(encoding="utf-8")
        new = renewed(text, name, make())
        if new != text:
            differing.append(f"{page}: {name}")
            if write:
                path.write_text(new, encoding="utf-8")
    return differing


def main() -> None:
    """Renew the generated parts, or with --check fail when one is stale."""
    check = "--check" in sys.argv[1:]
    differing = stale(write=not check)
    for part in differing:
        print(f"{'stale' if check else 'renewed'}: {part}", file=sys.stderr)
    if check and differing:
        sys.exit("run `make docs`")


if __name__ == "__main__":
    main()
