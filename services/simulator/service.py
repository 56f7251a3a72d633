"""The simulator as a process: the world behind the camera and the serial port, and nothing of the control chain."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from pydantic import Field

from bus import topics
from bus.clock import NS
from bus.config import ConfigError, Deployment, Section
from bus.messages import SimulationFault, SimulationTruth
from bus.service import Input, Output, Service
from marine.environment import Waves, Wind
from marine.vessel import AsvModel, SixDofModel, Vessel
from platform_link.drivers import Driver, open_far_end
from platform_link.firmware import Firmware
from services.simulator.actuators import DEAD, Failure
from services.simulator.faults import CameraFaults
from services.simulator.saved import Saved, load, save
from services.simulator.world import Current, Surroundings, World

if TYPE_CHECKING:  # OpenCV is only needed for pictures
    from camera_tracker.sources import FrameWriter
    from services.simulator.camera import Renderer
    from services.simulator.laser import ForwardCamera

SAVE_PERIOD_S = 0.2


class SimulatorConfig(Section):
    """Section [simulator]."""

    seed: int = 1
    pictures: bool = Field(True, description="render the camera; false: only simulation/truth")
    laser_pictures: bool = Field(True, description="render the forward camera of a vessel with a laser module")
    link: str = Field("pty://", description="the platform's port; pty:// alone: `platform` in the run directory")
    x_m: float | None = Field(None, description="where the vessel starts; none: in the middle of the pool")
    y_m: float | None = None
    psi_rad: float = 0.0
    current_x_m_s: float = 0.05
    current_y_m_s: float = 0.0
    current_std_m_s: float = Field(0.005, ge=0, description="of the slowly varying part, each axis")
    current_correlation_s: float = Field(30.0, gt=0)
    wind_x_m_s: float = Field(0.0, description="mean wind in {E}: where it blows to")
    wind_y_m_s: float = 0.0
    gust_std_m_s: float = Field(0.0, ge=0, description="of the gusts, each axis")
    gust_correlation_s: float = Field(5.0, gt=0)
    wind_drag_area_m2: float = Field(0.0, ge=0, description="C_D A of what stands above the water; 0: no wind acts")
    wind_lever_m: float = Field(0.0, description="how far ahead of the origin of {B} the wind takes hold")
    wave_height_m: float = Field(0.0, ge=0, description="significant height")
    wave_period_s: float = Field(3.0, gt=0, description="of the spectrum's peak")
    wave_towards_rad: float = 0.0
    wave_gamma: float = Field(3.3, ge=1, le=7, description="peak enhancement of JONSWAP; 1: Pierson-Moskowitz")
    depth_m: float = Field(10.0, gt=0, description="of the water")
    picture_noise_std: float = Field(6.0, ge=0, description="of each channel of each pixel, in grey levels")
    picture_blur_px: float = Field(1.0, gt=0)
    state_file: bool = Field(True, description="keep the state in a file, so that a killed simulator resumes")

    @property
    def around(self) -> Surroundings:
        """What moves around the vessel."""
        return Surroundings(
            Current(self.current_x_m_s, self.current_y_m_s, self.current_std_m_s, self.current_correlation_s),
            Wind(
                self.wind_x_m_s,
                self.wind_y_m_s,
                self.gust_std_m_s,
                self.gust_correlation_s,
                self.wind_drag_area_m2,
                self.wind_lever_m,
            ),
            Waves(self.wave_height_m, self.wave_period_s, self.wave_towards_rad, self.wave_gamma)
            if self.wave_height_m
            else None,
            self.depth_m,
        )


class Simulator(Service):
    """Simulate vessel, pool, camera and platform.

    The vessel is `services.simulator.world`; the platform's firmware (`platform_link.firmware`) sits at the far end of
    a pseudo-terminal; pictures go by shared memory (`sim://`). A picture is taken at the step nearest to its time and
    stamped with the time it shows.
    """

    name = "simulator"
    rate_hz = 60.0

    fault = Input(topics.SIMULATION_FAULT, wakes=True, queue=64)
    truth = Output(topics.SIMULATION_TRUTH)

    def __init__(self, config: SimulatorConfig, vessel: Vessel, deployment: Deployment) -> None:
        self._config = config
        self._vessel = vessel
        self._run_dir = deployment.run_dir
        self._state_path = deployment.run_dir / "simulator.json"
        if config.wind_drag_area_m2 and isinstance(vessel.dynamics, AsvModel):
            raise ConfigError(f"simulator: wind_drag_area_m2: the model of {vessel.name} knows no forces in N")
        self._camera = CameraFaults()
        self._flips = 0
        self._random = random.Random(config.seed + 1)
        self._firmware = Firmware([a.name for a in vessel.actuators])
        self._frame_ns = round(NS / vessel.camera.rate_hz)
        self._early_ns = round(NS / self.rate_hz / 2)
        self._next_frame_ns = 0
        self._prepared = False
        self._keeps_state = config.state_file
        self._save_s = 0.0
        self._save_error = ""
        self._world: World
        self._port: Driver
        self._renderer: Renderer | None = None
        self._frames: FrameWriter | None = None
        self._forward: ForwardCamera | None = None
        self.refused_orders = 0
        """Orders on simulation/fault that could not be followed."""

    def start(self, now_s: float) -> None:
        """Make the world and the far ends of camera and port; take up the state of a killed simulator."""
        config, now_ns = self._config, round(now_s * NS)
        pool = self._vessel.pool
        x_m = 0.5 * pool.length_x_m if config.x_m is None else config.x_m
        y_m = 0.5 * pool.length_y_m if config.y_m is None else config.y_m
        start = (x_m, y_m, config.psi_rad, 0.0, 0.0, 0.0)
        self._world = World(self._vessel, config.around, config.seed, start, now_ns)
        if config.state_file and (saved := load(self._state_path, now_ns)):
            self._camera = saved.restore(self._world)
            self.log.info("resumed where the simulator before was killed")
        link = f"pty://{self._run_dir.absolute() / 'platform'}" if config.link == "pty://" else config.link
        self._port = open_far_end(link)
        if config.pictures and self._vessel.sensor("camera"):
            from camera_tracker.sources import FrameWriter
            from services.simulator.camera import Renderer

            camera = self._vessel.camera
            self._renderer = Renderer(self._vessel, config.seed, config.picture_noise_std, config.picture_blur_px)
            self._frames = FrameWriter(self._run_dir / "camera", camera.width_px, camera.height_px)
        if config.laser_pictures and (laser := self._vessel.sensor("laser")):
            from services.simulator.laser import ForwardCamera

            self._forward = ForwardCamera(self._vessel, laser, config.seed, self._run_dir / "laser")
        self._next_frame_ns = now_ns

    def files(self) -> tuple[int, ...]:
        """Return the pseudo-terminal: commands are answered at once."""
        fd = self._port.fileno()
        return () if fd is None else (fd,)

    def step(self, now_s: float) -> None:
        """Let the world go on to now, talk over the port, take a picture when it is time."""
        now_ns = round(now_s * NS)
        self._world.advance(now_ns)
        for order in self.fault.take():
            self._obey(order)
        self._talk(now_s)
        commands = self._firmware.commands(now_s)
        self._world.command(commands)
        if now_ns + self._early_ns >= self._next_frame_ns:
            self._next_frame_ns = max(self._next_frame_ns + self._frame_ns, now_ns + self._early_ns)
            self._look(now_ns, now_s)
            self._tell(commands)
        elif self._renderer is not None and self._frames is not None and not self._prepared:
            self._prepared = True  # the next picture, while nobody waits for it
            self._renderer.prepare(self._camera.shift_px, self._frames.blank())
        if self._keeps_state and now_s - self._save_s >= SAVE_PERIOD_S:
            self._save_s = now_s
            self._save(now_ns)

    def stop(self, now_s: float) -> None:
        """Close the far ends. After a proper end the next simulator starts afresh."""
        self._port.close()
        for frames in (self._frames, self._forward):
            if frames is not None:
                frames.close()
        if self._keeps_state:
            self._state_path.unlink(missing_ok=True)

    def _save(self, now_ns: int) -> None:
        try:
            save(self._state_path, Saved.of(now_ns, self._world, self._camera))
            self._save_error = ""
        except OSError as error:
            if not self._save_error:
                self.log.warning("%s: %s; after a kill the vessel starts afresh", self._state_path, error.strerror)
            self._save_error = str(error)

    def _talk(self, now_s: float) -> None:
        data = self._port.read()
        answer = (data and self._firmware.feed(data, now_s)) or self._firmware.poll(now_s)
        if answer:
            if self._flips:
                self._flips -= 1
                answer = with_flipped_bit(answer)
            self._port.write(answer)

    def _look(self, now_ns: int, now_s: float) -> None:
        x, y, psi, _, _, _ = self._world.state
        if self._forward is not None:
            self._forward.look(now_ns, x, y, psi, lost=self._camera.laser_lost)
        if self._renderer is not None and self._frames is not None:
            lost = self._random.random() < self._camera.dropout
            if not lost:
                faults = self._camera
                board_at_s = now_s if faults.board else None
                image = self._renderer.render(
                    x, y, psi, shift_px=faults.shift_px, black=faults.black, board_at_s=board_at_s
                )
                self._frames.write(image, now_ns)
                self._prepared = False

    def _tell(self, commands: dict[str, float]) -> None:
        world = self._world
        x, y, psi, u, v, r = world.state
        current_x, current_y = world.current_m_s
        X, Y, _, _, _, N = world.actuators.wrench
        self.truth.publish(
            SimulationTruth(
                x_m=x,
                y_m=y,
                psi_rad=psi,
                surge_m_s=u,
                sway_m_s=v,
                yaw_rad_s=r,
                current_x_m_s=current_x,
                current_y_m_s=current_y,
                surge_n=X,
                sway_n=Y,
                yaw_nm=N,
                commands=commands,
                **self._upright(),
            )
        )

    def _upright(self) -> dict[str, float]:
        """Return what the truth says of a vessel that dives or heels."""
        z, phi, theta, w, _, _ = self._world.upright
        if isinstance(self._vessel.dynamics, SixDofModel):
            return {"z_m": z, "heave_m_s": w, "phi_rad": phi, "theta_rad": theta}
        return {"z_m": z, "heave_m_s": w} if self._vessel.model.heave else {}

    def _obey(self, order: SimulationFault) -> None:
        self._camera = self._camera.after(order)
        configured = (self._config.current_x_m_s, self._config.current_y_m_s)
        match order.kind:
            case "flip_byte":
                self._flips = self._flips + 1 if order.active else 0
            case "thruster_dead" | "thruster_weak" | "thruster_stuck":
                self._break_thruster(order)
            case "current":
                self._world.constant_current_m_s = (order.x_m_s, order.y_m_s) if order.active else configured
            case "displace" if order.active:
                self._world.displace(order.x_m, order.y_m, order.psi_rad)
            case "clear":
                self._flips = 0
                self._world.actuators.fail({})
                self._world.constant_current_m_s = configured

    def _break_thruster(self, order: SimulationFault) -> None:
        known = [a.name for a in self._vessel.actuators]
        if order.thruster not in known:
            self.refused_orders += 1
            self.log.warning("fault: no actuator is called %r; known: %s", order.thruster, ", ".join(known))
            return
        actuators = self._world.actuators
        failures = {name: failure for name, failure in actuators.failures.items() if name != order.thruster}
        if order.active:
            match order.kind:
                case "thruster_weak":
                    failures[order.thruster] = Failure(kept=1.0 - order.fraction)
                case "thruster_stuck":
                    failures[order.thruster] = Failure(stuck_at=actuators.values[order.thruster])
                case _:
                    failures[order.thruster] = DEAD
        actuators.fail(failures)


def with_flipped_bit(data: bytes) -> bytes:
    """Return bytes with one bit changed in the middle; no byte becomes zero, which separates frames."""
    at = len(data) // 2
    mask = 1 if data[at] != 1 else 2
    return data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]
