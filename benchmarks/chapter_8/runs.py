"""The runs behind the figures of thesis chapter 8: the whole star in one process, every message in a log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from bus import topics
from bus.config import Deployment
from bus.messages import AxisModel, ExperimentPlan, Mode, Tuning, TuningRequest, WayPoint
from bus.service import Service
from camera_tracker.laser.service import LaserTracker
from logs.recorder import Recorder
from marine.vessel import DegreeOfFreedom
from services.experiment import ExperimentConfig, Experiments
from services.identified_vessel import write_models
from services.vessels import load_vessel, vessel_path
from tests.star import SERVICES, Star
from tests.system.heavy_simulator import heavier

STILL = {"current_x_m_s": 0.0, "current_y_m_s": 0.0, "current_std_m_s": 0.0}
WIND = {"wind_drag_area_m2": 2.0, "wind_y_m_s": 4.0, "gust_std_m_s": 0.3}
"""20 N across the line, with gusts (chosen); position 0.5 m and compass 0.5 degrees are Charlie's file's."""
LEARN_S = 60.0
"""Charlie floats so long until its filter knows the wind: by fixes of 0.5 m it does not see it earlier."""
UNDER_WAY_M_S = 0.67
"""Charlie's speed in a self-oscillation: half of what it can."""
WALKS = {"force_walk_n": 0.3, "moment_walk_nm": 0.3, "yaw_rate_walk_rad_s": 0.002}
"""Of Charlie's estimator: a slow vessel in a slow wind (chosen)."""

AGILE = WALKS | {"yaw_rate_walk_rad_s": 0.005}
"""The same for hard turns by the rudder, which the uncoupled model does not foresee."""


class LoggedStar(Star):
    """A star without an overhead picture, but with that of the laser module; a log of everything."""

    kinds: ClassVar[tuple[type[Service], ...]] = (Recorder, *SERVICES, LaserTracker)

    def __init__(self, folder: Path, run: Run) -> None:
        """folder: for the recording; raises OSError when it cannot be written."""
        true = load_vessel(run.vessel)
        vessel = run.told(folder)
        deployment = Deployment(run_dir=folder, recordings_dir=folder, vessel_path=vessel)
        unknown = {"model": true.model, "dynamics": true.dynamics}
        if run.heavy:
            unknown = dict.fromkeys(unknown, heavier(true.model))
        sections: dict[str, Any] = {name: dict(values) for name, values in run.sections.items()}
        sections["simulator"] = {"laser_pictures": True, **STILL, **sections.get("simulator", {})}
        super().__init__(vessel=str(vessel), deployment=deployment, unknown=unknown, **sections)
        self.bus.add(Experiments(ExperimentConfig(delay_s=1.0 / 60.0), self.vessel, deployment))
        self.bus.run_until(self._known, 10.0)

    def _known(self) -> bool:
        state = self.bus.last(topics.NAVIGATION_STATE)
        return state is not None and state.status == "tracking"

    def ask(self, mode: Mode, seconds: float, **fields: Any) -> None:
        """Ask the helm for a mode and run on; RuntimeError with its reason when it refuses."""
        answer = self.request(mode, **fields)
        if not answer.accepted:
            raise RuntimeError(f"{mode}: {answer.reason}")
        self.bus.run_for(seconds)

    def identify(self, axis: Any, amplitude: float, **how: Any) -> AxisModel:
        """Run a self-oscillation to its end and return the model of the best method: thesis Algorithm 8.4 I, II."""
        plan = ExperimentPlan(name="self-oscillation", axis=axis, amplitude=amplitude, **how)
        answer = self.request("experiment", experiment=plan)

        def ended() -> bool:
            status = self.bus.last(topics.EXPERIMENT_STATUS)
            return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

        self.bus.run_until(ended, 300.0)
        result = self.bus.last(topics.EXPERIMENT_RESULT)
        if result is None or result.run != answer.request_id:
            raise RuntimeError(f"self-oscillation {axis}: {self.bus.last(topics.EXPERIMENT_STATUS)}")
        found = {p.name: p.value for p in result.methods[0].parameters}
        return AxisModel(**{name: found.get(name, 0.0) for name in ("alpha", "beta", "beta_quadratic")})

    def tune(self, tuning: Tuning) -> None:
        """Engage a tuning: Algorithm 8.4 III, IV."""
        self.bus.publish(topics.OPERATOR_TUNING, TuningRequest(request_id="tune", client="test", tuning=tuning))
        self.bus.run_for(1.0)
        answer = self.bus.last(topics.CONTROL_ANSWER)
        if answer is None or not answer.accepted:
            raise RuntimeError(f"tuning: {answer}")

    def finish(self) -> Path:
        """End the recording and return it."""
        self.bus.run_for(0.3)
        status = self.bus.last(topics.RECORDER_STATUS)
        assert status is not None
        self.bus.stop("recorder")
        return Path(status.file)


@dataclass(frozen=True)
class Run:
    """A vessel, what its services are told, and what an operator does with it."""

    vessel: str
    drive: Callable[[LoggedStar], None]
    sections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    identified: Mapping[str, DegreeOfFreedom] = field(default_factory=dict)
    """Models that everybody but the simulator has, where they are not the file's."""
    w0_rad_s: float | None = None
    """[hold] of the vessel file; None: as it is there."""
    heavy: bool = False
    """The simulated vessel has twice the inertia and half the drag that its file says."""

    def told(self, folder: Path) -> Path:
        """Return the vessel file of all but the simulator."""
        source, target = vessel_path(self.vessel), folder / f"{self.vessel}.toml"
        models = {
            axis: {"alpha": (m.alpha, 0.0), "beta": (m.beta, 0.0), "beta_quadratic": (m.beta_quadratic, 0.0)}
            for axis, m in self.identified.items()
        }
        write_models(source, target, models, "as the example identified it")
        if self.w0_rad_s is not None:
            head, hold = target.read_text().split("[hold]")
            _, rest = hold.split("w0_rad_s = ", 1)
            target.write_text(f"{head}[hold]\nw0_rad_s = {self.w0_rad_s}  {rest[rest.index('#') :]}")
        return target

    def record(self, folder: Path) -> Path:
        """Run it, and return its recording in a folder; RuntimeError when the helm or an experiment refuses."""
        star = LoggedStar(folder, self)
        self.drive(star)
        return star.finish()


# --- 8.1


def turn(star: LoggedStar) -> None:
    """Example 8.1, 8.3: turn by 90 degrees, the other axes at rest."""
    star.ask("speed", 3.0, speed_m_s=0.0, psi_rad=0.0)
    star.ask("speed", 15.0, speed_m_s=0.0, psi_rad=math.pi / 2.0)


def dive(depth_m: float, seconds: float) -> Callable[[LoggedStar], None]:
    """Example 8.2: from 1 m so much deeper."""

    def drive(star: LoggedStar) -> None:
        star.ask("depth", 30.0, z_m=1.0)
        star.ask("depth", seconds, z_m=1.0 + depth_m)

    return drive


def headings(star: LoggedStar) -> None:
    """Algorithm 8.4 and Fig. 8.9: a self-oscillation under way, its controller, changes of the heading."""
    star.bus.run_for(LEARN_S)
    star.ask("speed", 20.0, speed_m_s=UNDER_WAY_M_S, psi_rad=0.0)
    model = star.identify("yaw", 0.8, hysteresis_rad=math.radians(10.0), oscillations=5)
    star.tune(Tuning(law="heading", parameters={"yaw_w0_rad_s": 0.45}, models={"yaw": model}))
    for degrees in (0.0, 40.0, -10.0, 20.0):
        star.ask("speed", 30.0, speed_m_s=UNDER_WAY_M_S, psi_rad=math.radians(degrees))


def tuned(star: LoggedStar) -> None:
    """Algorithm 8.4 on PlaDyPos: turns by 90 degrees before and after."""
    for tuning in (False, True):
        if tuning:
            star.tune(Tuning(law="ipd", models={"yaw": star.identify("yaw", 0.7, oscillations=2)}))
        star.ask("hold", 25.0, x_m=2.5, y_m=1.875, psi_rad=0.0)
        star.ask("hold", 25.0, x_m=2.5, y_m=1.875, psi_rad=math.pi / 2.0)


# --- 8.2


def facing(star: LoggedStar) -> None:
    """Wait for the wall in the laser's picture."""

    def seen() -> bool:
        wall = star.bus.last(topics.NAVIGATION_WALL)
        return wall is not None and wall.status == "tracking"

    star.bus.run_until(seen, 10.0)


def ramp_and_step(star: LoggedStar) -> None:
    """Fig. 8.16: 20 s at 0.6 m, a ramp to 0.4 m in 20 s, 20 s, a step to 0.55 m."""
    facing(star)
    star.ask("distance", 20.0, distance_m=0.6)
    for k in range(1, 21):
        star.ask("distance", 1.0, distance_m=0.6 - 0.01 * k)
    star.bus.run_for(20.0)
    star.ask("distance", 30.0, distance_m=0.55)


def absences(star: LoggedStar) -> None:
    """Fig. 8.17: twice 5 s without dots, 20 s apart, as at 435 s and 455 s there."""
    facing(star)
    star.ask("distance", 60.0, distance_m=0.5)
    for _ in range(2):
        star.fault("laser_lost")
        star.bus.run_for(5.0)
        star.fault("laser_lost", active=False)
        star.bus.run_for(15.0)


# --- 8.3


def far(beside_m: float, seconds: float) -> Callable[[LoggedStar], None]:
    """Fig. 8.21, 8.23: so far beside the line, parallel to it."""

    def drive(star: LoggedStar) -> None:
        star.bus.run_for(LEARN_S)
        y_m = star.truth[-1].y_m - beside_m
        points = (WayPoint(x_m=12.0, y_m=y_m), WayPoint(x_m=197.0, y_m=y_m))
        star.ask("line", seconds, points=points, speed_m_s=1.0)

    return drive


def u_turn(star: LoggedStar) -> None:
    """Fig. 8.24 to 8.26: out, and back 25 m to starboard."""
    star.bus.run_for(LEARN_S)
    corners = ((10.0, 50.0), (170.0, 50.0), (170.0, 75.0), (10.0, 75.0))
    star.ask("path", 360.0, points=tuple(WayPoint(x_m=x, y_m=y) for x, y in corners), speed_m_s=1.0)


def steady(star: LoggedStar) -> None:
    """Fig. 8.27: a line, until it is steady and 60 s more."""
    star.bus.run_for(LEARN_S)
    points = (WayPoint(x_m=10.0, y_m=50.0), WayPoint(x_m=190.0, y_m=50.0))
    star.ask("line", 160.0, points=points, speed_m_s=1.0)


def _charlie(drive: Callable[[LoggedStar], None], y_m: float = 43.0, **controller: Any) -> Run:
    simulator = {**WIND, "x_m": 10.0, "y_m": y_m}
    return Run("charlie", drive, {"simulator": simulator, "estimator": WALKS, "controller": controller})


def _wall(drive: Callable[[LoggedStar], None], distance_m: float) -> Run:
    place = {"x_m": load_vessel("videoray").radius_m + distance_m, "psi_rad": 3.0}
    return Run("videoray", drive, {"simulator": place})


RUNS: dict[str, Run] = {
    "8.4": Run("automarine", dive(1.0, 40.0)),
    "8.6": Run(
        "falcon",
        turn,
        {"controller": {"heading_w0_rad_s": 1.5}},
        {"yaw": DegreeOfFreedom(7.897, 29.848, 0.0)},
    ),
    "8.7": Run(
        "falcon",
        dive(3.0, 15.0),
        {"controller": {"laws": {"ipd": {"w0_rad_s": 0.4}}}},  # its position comes once a second: too late for 0.8
        {"heave": DegreeOfFreedom(127.79, 205.75, 0.0)},
        w0_rad_s=0.8,
    ),
    "8.8": Run(
        "nonlinear_yaw",
        turn,
        {"controller": {"heading_w0_rad_s": 1.5}},
        {"yaw": DegreeOfFreedom(0.98, 0.0, 1.305)},
    ),
    "8.9": Run("charlie", headings, {"simulator": {**WIND, "x_m": 10.0, "y_m": 43.0}, "estimator": AGILE}),
    "algorithm-8.4": Run("pladypos", tuned, {"simulator": {"current_x_m_s": 0.04, "current_y_m_s": 0.03}}, heavy=True),
    "8.16": _wall(ramp_and_step, 0.6),
    "8.17": _wall(absences, 0.6),
    "8.21": _charlie(far(75.0, 185.0), 110.0, line="direct", approach_deg=45.0),
    "8.23": _charlie(far(70.0, 185.0), 110.0, line="indirect", approach_deg=45.0),
    "8.24": _charlie(u_turn, line="direct"),
    "8.25": _charlie(u_turn, line="indirect", heading="P-D", heading_w0_rad_s=0.2, line_w0_rad_s=0.211),
    "8.26": _charlie(u_turn, line="indirect", line_w0_rad_s=0.211),
    "8.27 fast": _charlie(steady, line="direct", line_w0_rad_s=0.5),
    "8.27 slow": _charlie(steady, line="direct", line_w0_rad_s=0.211),
}
"""By the number of the figure. Example 8.1 is Fig. 8.6, 8.2 is 8.7, 8.3 is 8.8; Tables 7.2, 7.4 and 7.6 identified."""
