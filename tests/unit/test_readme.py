"""What the README shows runs, and what it links to is there."""

import logging
import re
import sys
from pathlib import Path

import pytest
import typer

from bus import topics
from bus.memory_bus import MemoryBus
from bus.messages import NavigationState
from services.catalog import ROOT, build, load_settings
from services.cli.main import _register, app

README = (ROOT / "README.md").read_text()


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None
    return found.group(1)


def test_the_service_of_twelve_lines_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    code = block("python")
    assert len([line for line in code.splitlines() if line.strip() and not line.startswith("#")]) == 12
    (tmp_path / "wall_alarm.py").write_text(code)
    (tmp_path / "own.toml").write_text(block("toml"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "wall_alarm", raising=False)
    settings = load_settings(tmp_path / "own.toml")
    bus = MemoryBus()
    bus.add(build(settings.process("alarm"), settings))
    rest = {"y_m": 1, "psi_rad": 0, "surge_m_s": 0, "sway_m_s": 0, "yaw_rad_s": 0, "measurement_age_s": 0}
    with caplog.at_level(logging.WARNING):
        for x_m in (0.8, 0.79, 0.78, 1.2, 1.1, 0.7, 0.71):
            state = rest | {"x_m": x_m, "status": "tracking"}
            bus.publish(topics.NAVIGATION_STATE, NavigationState.model_validate(state))
            bus.run_for(0.2)
    assert caplog.messages == ["only 0.80 m to the wall", "only 0.70 m to the wall"], "on entering only"


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_every_command_and_option_that_is_shown_exists() -> None:
    _register(None)
    starboard = typer.main.get_command(app)
    shown = 0
    for page in PAGES:
        text = re.sub(r"\\\n\s*", " ", page.read_text())
        for line in re.findall(r"(?:^\$ |`)(?:[A-Z_]+=\S+ )?starboard ([^\n`#]*)", text, re.MULTILINE):
            shown += 1
            words = [word.strip("[](),;").split("=")[0] for word in line.split()]
            command = starboard
            known = {"--help", *(option for p in starboard.params for option in p.opts)}
            for word in words:
                inner = getattr(command, "commands", {})
                if word in inner:
                    command = inner[word]
                    known.update(option for p in command.params for option in (*p.opts, *p.secondary_opts))
                elif word.startswith("--"):
                    assert word in known, f"{page.name}: starboard {line}: no option {word}"
                else:
                    assert not inner or word.isupper(), f"{page.name}: starboard {line}: no command {word}"
    assert shown > 150


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_page_is_listed() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    for page in (ROOT / "docs").rglob("*.md"):
        if page.name != "README.md" and page.parent.name != "adr":
            assert f"]({page.relative_to(ROOT / 'docs')})" in index, f"docs/README.md does not list {page.name}"
