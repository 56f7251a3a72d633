"""The catalogue, and that declarations, topics, diagrams and configurations agree."""

import os
from pathlib import Path

import pytest

from bus import topics
from bus.config import ConfigError
from bus.messages import Wrench
from bus.service import Input, Output, RawInput
from services.catalog import PROCESSES, ROOT, build, load_settings, run_dir
from services.generate import GENERATED, published_by, read_by, renewed, stale, star_diagram
from services.supervision import supervisor_config

CHAIN = {"camera_tracker", "estimator", "controller", "helm", "allocator", "platform_link"}
CONFIGS = sorted((ROOT / "config").glob("*.toml"))


def test_every_input_has_a_publisher_and_every_output_its_owner() -> None:
    owned = {t.key: t.publisher for t in topics.all_topics()}
    published = {t.key for p in PROCESSES for t in published_by(p)}
    for process in PROCESSES:
        for topic in published_by(process):
            owners = (process.name.removesuffix("_standby"), topics.OPERATOR)
            assert owned[topic.key] in owners, f"{process.name} publishes {topic.key}"
        for topic in read_by(process):
            assert topic.key in published or owned[topic.key] == topics.OPERATOR, f"nobody publishes {topic.key}"


def test_every_topic_with_an_owner_is_published_by_it() -> None:
    published = {(p.name, t.key) for p in PROCESSES for t in published_by(p)}
    for topic in topics.all_topics():
        if topic.publisher not in (topics.OPERATOR, "*"):
            assert (topic.publisher, topic.key) in published, f"{topic.publisher} does not publish {topic.key}"


def test_nothing_is_published_that_nobody_reads_or_logs() -> None:
    read = {t.key for p in PROCESSES for t in read_by(p)}
    assert all(t.logged or t.key in read for t in topics.all_topics())


def test_no_service_of_the_control_chain_reads_the_simulation() -> None:
    for process in PROCESSES:
        if process.name in CHAIN:
            ports = process.service.ports.values()
            assert not any(isinstance(p, RawInput) for p in ports), f"{process.name} reads everything"
            assert not [t.key for t in read_by(process) if t.key.startswith("simulation/")]


def test_nobody_but_the_helm_feeds_the_allocator() -> None:
    allocator = next(p for p in PROCESSES if p.name == "allocator")
    assert [t.publisher for t in read_by(allocator) if issubclass(t.message, Wrench)] == ["helm"]


def test_commands_are_never_kept_for_late_joiners() -> None:
    for topic in (topics.CONTROL_WRENCH, topics.HELM_WRENCH, topics.ACTUATOR_COMMAND, topics.OPERATOR_JOYSTICK):
        assert not topic.latched


@pytest.mark.parametrize("process", PROCESSES, ids=lambda p: p.name)
def test_each_process_is_what_its_entry_says(process: object) -> None:
    service = process.service  # type: ignore[attr-defined]
    assert service.name == process.name  # type: ignore[attr-defined]
    assert len(process.doc) > 10  # type: ignore[attr-defined]
    assert all(isinstance(p, Input | Output | RawInput) for p in service.ports.values())


@pytest.mark.parametrize("path", CONFIGS, ids=lambda p: p.name)
def test_the_configurations_that_we_ship_are_right(path: Path) -> None:
    load_settings(path).check()


def test_services_are_built_with_what_they_ask_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("STARBOARD_RUN_DIR", str(tmp_path))
    settings = load_settings(ROOT / "config" / "simulation.toml")
    assert {build(p, settings).name for p in settings.processes} == {
        p.name for p in PROCESSES if p.name not in ("sensors", "laser_tracker")
    }


def test_processes_are_added_and_replaced_by_configuration(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        '[system.services]\nhelm = "services.allocator:Allocator"\nmine = "services.allocator:Allocator"\n[mine]\n'
    )
    settings = load_settings(path)
    assert settings.process("helm").target == "services.allocator:Allocator"
    assert settings.process("helm").priority == 30
    assert settings.process("mine").name == "mine"
    assert "simulator" not in {p.name for p in settings.processes}
    with pytest.raises(ConfigError, match="known: hub"):
        settings.process("yours")
    path.write_text('[system.services]\nmine = "bus.units:SUFFIXES"\n')
    with pytest.raises(ConfigError, match=r"no bus\.Service"):
        load_settings(path).check()


def test_the_run_directory_can_be_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STARBOARD_RUN_DIR", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert run_dir() == Path("/run/user/7/starboard")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert str(os.getuid()) in run_dir().name
    assert len(str(run_dir())) < 60, "sockets have at most 108 bytes of path"


def test_the_supervisors_configuration_comes_from_the_catalogue() -> None:
    text = supervisor_config(PROCESSES, Path("/run/x"), Path("/etc/pool.toml"))
    for process in PROCESSES:
        assert f"[program:{process.name}]" in text
    assert "programs=hub,hub_standby\npriority=10" in text, "the hubs are a group of their own and stop last"
    assert text.count('"--config" "/etc/pool.toml"') == len(PROCESSES)
    late = [p.name for p in PROCESSES if p.late]
    assert text.count("autostart=false") == len(late)
    assert not {"hub", "recorder", "helm", "platform_link"} & set(late), "what drives and what records starts at once"


def test_only_what_a_file_says_is_checked_before_the_start(tmp_path: Path) -> None:
    path = tmp_path / "pool.toml"
    path.write_text("[helm]\nguards = true\n")
    with pytest.raises(ConfigError, match="guards"):
        load_settings(path).check()
    path.write_text('[system]\nservices = { alarm = "nowhere:Alarm" }\n')
    with pytest.raises(ConfigError, match="nowhere"):
        load_settings(path).check()


@pytest.mark.parametrize(
    ("controller", "says"),
    [
        ("[controller.laws.ipd]\nw0_rad_s = 20.0", "its delay margin is 0.023 s, and sensor and command take 0.050 s"),
        ('[controller.laws.ipd]\nmodel_function = "1,1,2"', "is not stable"),
        ("[controller.laws.lqr]\nposition_m = 1e-9\n[controller]\npositioning = 'lqr'", "would not be stable"),
    ],
)
def test_gains_that_would_not_be_stable_are_refused_before_the_start(
    tmp_path: Path, controller: str, says: str
) -> None:
    file = tmp_path / "own.toml"
    file.write_text(controller)
    with pytest.raises(ConfigError, match=says) as refused:
        load_settings(file).check()
    assert str(file) in str(refused.value)


def test_the_diagram_shows_every_process() -> None:
    diagram = star_diagram()
    assert all(p.name in diagram for p in PROCESSES)
    assert 'hub -- "helm/wrench<br>' in diagram


def test_generated_parts_of_the_docs_are_up_to_date() -> None:
    assert stale(write=False) == [], "run `make docs`"


def test_a_stale_part_is_found_and_renewed(tmp_path: Path) -> None:
    for page, _ in GENERATED.values():
        (tmp_path / page).parent.mkdir(exist_ok=True)
        (tmp_path / page).write_text((ROOT / page).read_text())
    path = tmp_path / "docs" / "topics.md"
    path.write_text(path.read_text().replace("camera/pose", "camera/nose"))
    assert stale(write=True, root=tmp_path) == ["docs/topics.md: topics"]
    assert stale(write=False, root=tmp_path) == []
    with pytest.raises(ValueError, match="no place"):
        renewed("a page", "topics", "content")
