"""The whole star on a `MemoryBus`, without pictures: for closed-loop tests and benchmarks."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import math
import typing
from pathlib import Path
from typing import Any, ClassVar

from bus import topics
from bus.config import Deployment
from bus.memory_bus import MemoryBus
from bus.messages import HelmAnswer, Message, Mode, OperatorRequest, SimulationFault, SimulationTruth
from bus.service import Service
from marine.frames import wrap_angle
from platform_link.service import PlatformLink
from services.allocator import Allocator
from services.catalog import PROCESSES
from services.controller import Controller
from services.estimator import Estimator
from services.helm import Helm
from services.simulator.sensors import Sensors
from services.simulator.service import Simulator
from services.simulator.stand_in import PoseStandIn
from services.vessels import load_vessel

SERVICES: tuple[type[Service], ...] = (
    Simulator,
    PoseStandIn,
    Sensors,
    Estimator,
    Controller,
    Helm,
    Allocator,
    PlatformLink,
)
_links = itertools.count()


class Star:
    """The bus, and what an operator and an observer do with it.

    sections: configuration by service name, as in a TOML file: `Star(simulator={"current_x_m_s": 0.0})`.
    unknown: fields of the vessel that are different in the simulator, and that nobody else knows.
    """

    kinds: ClassVar[tuple[type[Service], ...]] = SERVICES

    def __init__(
        self,
        *,
        json: bool = False,
        vessel: str = "pladypos",
        deployment: Deployment = Deployment(run_dir=Path("/nonexistent")),  # noqa: B008 - frozen
        unknown: dict[str, Any] | None = None,
        **sections: dict[str, Any],
    ) -> None:
        self.bus = MemoryBus(json=json)
        self.vessel = load_vessel(vessel)
        self._deployment = deployment
        self._world = dataclasses.replace(self.vessel, **(unknown or {}))
        self.truth: list[SimulationTruth] = []
        """Every simulation/truth so far."""
        self._answers: list[HelmAnswer] = []
        link = f"loop://star{next(_links)}"
        self._sections: dict[str, dict[str, Any]] = {
            "simulator": {"pictures": False, "laser_pictures": False, "state_file": False, "link": link},
            "platform_link": {"uri": link},
        }
        for name, values in sections.items():
            self._sections.setdefault(name, {}).update(values)
        self.bus.tap(topics.SIMULATION_TRUTH, self.truth.append)
        self.bus.tap(topics.HELM_ANSWER, self._answers.append)
        absent = {p.name for p in PROCESSES if not p.fits(self.vessel)}
        for kind in self.kinds:
            if kind.name not in absent:
                self.start(kind.name)

    def start(self, name: str) -> None:
        """Start a service, in place of one of the same name: what a supervisor does."""
        kind = next(k for k in self.kinds if k.name == name)
        wanted = inspect.signature(kind.__init__).parameters
        config = typing.get_type_hints(kind.__init__).get("config")
        vessel = self._world if name == "simulator" else self.vessel
        given: dict[str, Any] = {"vessel": vessel, "deployment": self._deployment}
        if config is not None:
            given["config"] = config(**self._sections.get(name, {}))
        self.bus.add(kind(**{key: value for key, value in given.items() if key in wanted}))

    def request(self, mode: Mode, **fields: Any) -> HelmAnswer:
        """Ask the helm for a mode (fields: x_m, y_m, psi_rad, lease_s ...) and return its answer."""
        number = len(self._answers)
        fields = {"lease_s": 3600.0, "attended": False, **fields}
        self.bus.publish(
            topics.OPERATOR_REQUEST, OperatorRequest(request_id=str(number), client="test", mode=mode, **fields)
        )
        self.bus.run_until(lambda: len(self._answers) > number, 1.0)
        return self._answers[number]

    def hold(self, x_m: float, y_m: float, psi_rad: float = 0.0) -> None:
        """Hold a pose from now on; AssertionError when the helm refuses."""
        answer = self.request("hold", x_m=x_m, y_m=y_m, psi_rad=psi_rad)
        assert answer.accepted, answer.reason

    def fault(self, kind: Any, **fields: Any) -> None:
        """Inject a fault."""
        self.bus.publish(topics.SIMULATION_FAULT, SimulationFault(kind=kind, **fields))

    def record(self, *topics_of_interest: topics.Topic[Any]) -> list[Message]:
        """Return a list that every further message of these topics is put into."""
        messages: list[Message] = []
        for topic in topics_of_interest:
            self.bus.tap(topic, messages.append)
        return messages

    def rms_error(self, x_m: float, y_m: float, psi_rad: float, since_s: float) -> tuple[float, float]:
        """Return RMS distance in m and RMS heading error in rad of the truth from a pose, since a bus time."""
        poses = [t for t in self.truth if t.stamp_ns * 1e-9 >= since_s]
        distance2 = sum((t.x_m - x_m) ** 2 + (t.y_m - y_m) ** 2 for t in poses)
        angle2 = sum(wrap_angle(t.psi_rad - psi_rad) ** 2 for t in poses)
        return math.sqrt(distance2 / len(poses)), math.sqrt(angle2 / len(poses))


def build_star(*, json: bool = False, vessel: str = "pladypos", **sections: Any) -> Star:
    """Return a star that has run until its pose is tracked."""
    star = Star(json=json, vessel=vessel, **sections)

    def tracked() -> bool:
        state = star.bus.last(topics.NAVIGATION_STATE)
        return state is not None and state.status == "tracking"

    star.bus.run_until(tracked, 5.0)
    return star
