"""A whole system as real processes under `starboard up`, for system tests and benchmarks."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self, TypeVar

from bus.clock import CLOCK
from bus.messages import HelmAnswer, Message, OperatorRequest
from bus.security import client_settings
from bus.service import RawSample
from bus.topics import HELM_ANSWER, HELM_STATE, OPERATOR_REQUEST, Topic
from bus.zenoh_bus import ZenohBus

ROOT = Path(__file__).parent.parent
M = TypeVar("M", bound=Message)


def free_port() -> int:
    """Return a TCP port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def secure(config: Path) -> Path:
    """Run `starboard secure init` for a configuration file and return the folder that it names."""
    folder = config.parent / "keys"
    subprocess.run(
        [sys.executable, "-m", "services.cli.main", "secure", "init", str(folder), "--config", str(config)],
        cwd=ROOT, check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return folder


def wait_for(condition: Callable[[], Any], timeout_s: float, what: str) -> Any:
    """Return the first true value of a condition; raise TimeoutError that says what was waited for."""
    end_s = time.monotonic() + timeout_s
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > end_s:
            raise TimeoutError(f"{what}: not within {timeout_s} s")
        time.sleep(0.01)


class RunningStar:
    """`starboard up` with a configuration and a run directory of its own.

    `sections` are lines of TOML besides [system], [hub] and [ui]; `system` further lines of [system]; `secured`: with
    TLS, passwords and access rules; `router`: address of one that runs already, instead of hub and standby; `arguments`
    further ones of `starboard up`.
    """

    def __init__(
        self,
        sections: str = "",
        system: str = "simulation = true",
        vessel: str = "pladypos",
        *,
        secured: bool = False,
        router: str = "",
        arguments: tuple[str, ...] = (),
    ) -> None:
        self._arguments = arguments
        self._folder = tempfile.TemporaryDirectory(prefix="sb-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None)
        self.folder = Path(self._folder.name)
        self.run_dir = self.folder / "run"
        self.recordings = self.folder / "recordings"
        self.hub, self.standby = (f"{'tls' if secured else 'tcp'}/127.0.0.1:{free_port()}" for _ in range(2))
        own_hubs = f'[hub]\nlisten = ["{self.hub}"]\nstandby = "{self.standby}"\n'
        if router:
            self.hub = self.standby = router
        self.page_port = free_port()
        self.config = self.folder / "config.toml"
        self.config.write_text(
            f'[system]\nvessel = "{vessel}"\nrecordings = "{self.recordings}"\n{system}\n'
            + (f'[hub]\nrouter = "{router}"\n' if router else own_hubs)
            + (f'security = "{self.folder}/keys"\n' if secured else "")
            + f"[ui]\nport = {self.page_port}\n{sections}\n"
        )
        self._secured = client_settings(secure(self.config), "operator") if secured else None
        self.vessel = Path(vessel).stem
        self.environment = os.environ | {"STARBOARD_RUN_DIR": str(self.run_dir), "PYTHONUNBUFFERED": "1"}
        self.output = self.folder / "up.txt"
        self._process: subprocess.Popen[bytes] | None = None
        self._bus: ZenohBus | None = None
        self._latest: dict[str, RawSample] = {}

    def __enter__(self) -> Self:
        with self.output.open("wb") as out:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "services.cli.main", "up", str(self.config), *self._arguments],
                cwd=ROOT, env=self.environment, stdout=out, stderr=subprocess.STDOUT,
            )  # fmt: skip
        try:
            self._bus = ZenohBus.connect(self.vessel, (self.hub, self.standby), 60.0, self._secured)
            self._bus.subscribe("**", self._hear)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._bus is not None:
            self._bus.close()
            CLOCK.forget()  # the next star's time may run otherwise
        if self._process is not None and self._process.poll() is None:
            self.interrupt()
        self._folder.cleanup()

    @property
    def bus(self) -> ZenohBus:
        """A client of the running hub."""
        assert self._bus is not None
        return self._bus

    @property
    def page(self) -> str:
        """Address of the operator's page, once it is served: it is one of the late processes."""

        def served() -> bool:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.page_port), 1.0):
                return True
            return False

        wait_for(served, 30.0, "the operator's page")
        return f"http://127.0.0.1:{self.page_port}/"

    @property
    def log(self) -> str:
        """What `starboard up` printed so far."""
        return self.output.read_text(errors="replace")

    def interrupt(self, timeout_s: float = 15.0) -> float:
        """Press Ctrl-C and wait for the end; return how long it took in s."""
        assert self._process is not None
        begin_s = time.monotonic()
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise
        return time.monotonic() - begin_s

    def _hear(self, sample: RawSample) -> None:
        self._latest[sample.key] = sample

    def last(self, topic: Topic[M]) -> M | None:
        """Return the newest message of a topic that this client heard; None before the first, or if it is malformed."""
        sample = self._latest.get(topic.key)
        with contextlib.suppress(ValueError):
            return None if sample is None else topic.message.decode(sample.payload)
        return None

    def wait(self, topic: Topic[M], condition: Callable[[M], bool], timeout_s: float, what: str) -> M:
        """Wait until the newest message of a topic meets a condition, and return it."""

        def met() -> M | None:
            message = self.last(topic)
            return message if message is not None and condition(message) else None

        try:
            found: M = wait_for(met, timeout_s, what)
        except TimeoutError as error:
            raise TimeoutError(f"{error}; last: {self.last(topic)}\n{self.log[-3000:]}") from None
        return found

    def request(self, timeout_s: float = 5.0, **fields: Any) -> HelmAnswer:
        """Ask the helm, once it is there, and return its answer."""
        self.wait(HELM_STATE, lambda _: True, 20.0, "the helm")
        values = {"request_id": f"{time.monotonic_ns()}", "client": "test", "attended": False, "lease_s": 600.0}
        header = {"stamp_ns": self.bus.clock.now_ns(), "source": "test"}
        request = OperatorRequest.model_validate(values | header | fields)
        self.bus.publish(OPERATOR_REQUEST, request)
        return self.wait(HELM_ANSWER, lambda a: a.request_id == request.request_id, timeout_s, "the helm's answer")

    def hold(self, x_m: float, y_m: float, psi_rad: float, timeout_s: float = 20.0) -> None:
        """Ask for hold until it is granted: at the start the first pose may still be missing."""

        def granted() -> bool:
            try:
                return self.request(mode="hold", x_m=x_m, y_m=y_m, psi_rad=psi_rad, timeout_s=0.5).accepted
            except TimeoutError:  # the helm may not listen yet
                return False

        wait_for(granted, timeout_s, "hold granted")

    def states(self) -> dict[str, dict[str, Any]]:
        """Return what the supervisor last wrote of each service, by name."""
        with contextlib.suppress(OSError, ValueError):
            return {s["name"]: s for s in json.loads((self.run_dir / "services.json").read_text())}
        return {}

    def pid(self, name: str) -> int:
        """Return the process id of a running service."""

        def running() -> int:
            state = self.states().get(name, {})
            return int(state.get("pid", 0)) if state.get("state") == "running" else 0

        return int(wait_for(running, 20.0, f"{name} runs"))

    def cli(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a `starboard` command against this system."""
        return subprocess.run(
            [sys.executable, "-m", "services.cli.main", *arguments],
            cwd=ROOT, env=self.environment, capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip


@contextlib.contextmanager
def stopped(pid: int) -> Iterator[None]:
    """Hold a process with SIGSTOP for the length of the block."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
