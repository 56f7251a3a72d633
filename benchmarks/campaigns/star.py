"""The whole star in one process, with rendered pictures, radio protocol and recorder; a pilot for campaigns on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from bus import topics
from bus.config import Deployment
from bus.messages import ExperimentPlan, ExperimentResult, ExperimentStatus
from bus.service import Input, Service
from camera_tracker.service import CameraTracker
from logs.recorder import Recorder
from services.campaign import CampaignFile, Place, at_rest
from services.experiment import Experiments
from services.simulator.service import Simulator
from services.simulator.stand_in import PoseStandIn
from services.vessels import vessel_path
from tests.star import SERVICES, Star

POLL_S = 1.0 / 60.0
"""The platform at the far end of loop:// takes up a command at the simulator's next step: the radio's known delay."""
PICTURE_RATE_HZ = 0.2
"""Pictures in the log: enough to see that they are pictures."""
LONGEST_RUN_S = 400.0


class WokenTracker(CameraTracker):
    """The camera tracker, woken by each frame: on MemoryBus no descriptor does that. It reads the pixels only."""

    frame = Input(topics.SIMULATION_TRUTH, wakes=True)


class WokenSimulator(Simulator):
    """The simulator, woken by each command as by its port on a real machine."""

    command = Input(topics.ACTUATOR_COMMAND, wakes=True)


class RenderedStar(Star):
    """A star whose poses come from pictures, and whose every message is in a log.

    Pictures are taken at the simulator's steps, and so every command comes between two of them, POLL_S late.
    """

    poll_s = POLL_S
    kinds: ClassVar[tuple[type[Service], ...]] = (
        Recorder,
        *(WokenTracker if kind is PoseStandIn else kind for kind in SERVICES),
        Experiments,
    )

    def __init__(self, folder: Path, *, seed: int, vessel: str = "pladypos", **more: Any) -> None:
        simulator = {"pictures": True, "current_x_m_s": 0.0, "current_std_m_s": 0.0, **more.pop("simulator", {})}
        super().__init__(
            vessel=vessel,
            deployment=Deployment(run_dir=folder, recordings_dir=folder, vessel_path=vessel_path(vessel)),
            simulator={"seed": seed, **simulator},
            sensors={"seed": seed},
            camera_tracker={"source": f"sim://{folder / 'camera'}", "image_rate_hz": PICTURE_RATE_HZ},
            experiment={"delay_s": self.poll_s, "save": False},
            **more,
        )
        self.bus.run_until(self._tracked, 10.0)

    def _tracked(self) -> bool:
        state = self.bus.last(topics.NAVIGATION_STATE)
        return state is not None and state.status == "tracking"

    def finish(self) -> Path:
        """End the recording and return it."""
        status = self.bus.last(topics.RECORDER_STATUS)
        assert status is not None
        assert status.state == "recording", status.error
        self.bus.stop("recorder")
        self.bus.stop("simulator")
        return Path(status.file)


class InstrumentStar(RenderedStar):
    """A star with instruments instead of a camera: they sample when they will, and a command counts at once."""

    poll_s = 0.0
    kinds: ClassVar[tuple[type[Service], ...]] = (
        *(kind for kind in RenderedStar.kinds if kind is not Simulator),
        WokenSimulator,  # after the link, which must have written by then
    )


class MemoryPilot:
    """A campaign's hands on a star in memory."""

    def __init__(self, star: Star) -> None:
        self.star = star
        self.runs = 0

    def rest_at(self, place: Place, campaign: CampaignFile) -> None:
        """Hold the place and wait for calm; raise TimeoutError when it does not come."""
        bus = self.star.bus
        self.star.hold(place.x_m, place.y_m, place.psi_rad)
        since_s = bus.now_s

        def calm() -> bool:
            nonlocal since_s
            state = bus.last(topics.NAVIGATION_STATE)
            if state is None or not at_rest(state, place, campaign):
                since_s = bus.now_s
            return bus.now_s - since_s >= campaign.calm_s

        bus.run_until(calm, campaign.patience_s)

    def run(self, plan: ExperimentPlan) -> tuple[ExperimentStatus, ExperimentResult | None]:
        """Run an experiment to its end; RuntimeError with the helm's reason when it refuses."""
        self.runs += 1
        bus = self.star.bus
        answer = self.star.request("experiment", experiment=plan)
        if not answer.accepted:
            raise RuntimeError(answer.reason)

        def ended() -> bool:
            status = bus.last(topics.EXPERIMENT_STATUS)
            return status is not None and status.run == answer.request_id and status.state in ("done", "failed")

        bus.run_until(ended, LONGEST_RUN_S)
        status, result = bus.last(topics.EXPERIMENT_STATUS), bus.last(topics.EXPERIMENT_RESULT)
        assert status is not None
        return status, result if result is not None and result.run == answer.request_id else None
