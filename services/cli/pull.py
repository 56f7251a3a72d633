"""`starboard experiment pull`: thruster mapping step by step, the vessel on a dynamometer (thesis 4.1)."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from services.cli.conversation import CLIENT
from services.cli.errors import CliError

if TYPE_CHECKING:
    from services.cli.experiment import BusPilot

STEADY_S = 3.0
PERIOD_S = 0.05


class Person:
    """Pushes through the joystick's topic, which the helm stops when it falls silent, and asks for the reading.

    simulated: the reading is what the simulator's thrusters push with (practice without a balance).
    """

    def __init__(self, pilot: BusPilot, axis: str, *, simulated: bool) -> None:
        from bus import topics

        self._pilot, self._axis, self._simulated = pilot, axis, simulated
        self._stick, self._over = 0.0, threading.Event()
        self._commands: dict[str, float] = {}
        self._truth: Any = None
        pilot.bus.subscribe(topics.ACTUATOR_COMMAND.key, self._command)
        pilot.bus.subscribe(topics.SIMULATION_TRUTH.key, self._true)
        self._thread = threading.Thread(target=self._hold, daemon=True)

    def __enter__(self) -> Person:
        self._pilot.order(mode="manual")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stick = 0.0
        self._over.set()
        self._thread.join()
        self._pilot.order(mode="stop")

    def push(self, share: float) -> Mapping[str, float]:
        """Push, wait until it is steady."""
        self._stick = share
        self._over.wait(STEADY_S)
        if not self._commands:
            raise CliError("no actuator is commanded: is the helm in mode manual? see `starboard status`")
        return dict(self._commands)

    def reading(self, share: float, commands: Mapping[str, float]) -> float | None:
        """Ask until a number, or nothing, is entered."""
        if self._simulated:
            if self._truth is None:
                raise CliError("there is no simulator: leave out --simulated and read the balance")
            return abs(float(getattr(self._truth, f"{self._axis}_n", None) or 0.0))
        said = ", ".join(f"{name} {value:g}" for name, value in commands.items())
        while True:
            answer = input(f"{100 * share:+.0f} % ({said}): pull in N (Enter leaves it out)? ").strip()
            try:
                return abs(float(answer.replace(",", "."))) if answer else None
            except ValueError:
                print("write a number, like 12.5")

    def _hold(self) -> None:
        from bus import topics
        from bus.messages import OperatorJoystick

        while not self._over.wait(PERIOD_S):
            stick = OperatorJoystick(
                stamp_ns=self._pilot.bus.clock.now_ns(),
                source="cli",
                client=CLIENT,
                **{self._axis: self._stick},
            )
            self._pilot.bus.publish(topics.OPERATOR_JOYSTICK, stick)

    def _command(self, sample: Any) -> None:
        from bus.messages import ActuatorCommand

        self._commands = ActuatorCommand.decode(sample.payload).commands

    def _true(self, sample: Any) -> None:
        from bus.messages import SimulationTruth

        self._truth = SimulationTruth.decode(sample.payload)


def pull(pilot: BusPilot, axis: str, levels: int, *, save: Path | None, simulated: bool, as_json: bool) -> None:
    """Lead through the readings, print the thrust curve with its deviations, write a vessel file with it."""
    from marine.identification.result import IdentificationError
    from services.catalog import load_settings
    from services.cli.system import running
    from services.identified_vessel import IdentifiedVesselError
    from services.pull_test import COMPONENTS, drive, fitted, pulling, write_thrusters
    from services.vessels import load_vessel

    if axis not in COMPONENTS:
        raise CliError(f"a rope cannot tell {axis}: --axis surge, sway or heave")
    system = running()
    vessel = load_settings(system.config if system else None).deployment().vessel_path
    if vessel is None:
        raise CliError("the running system has no vessel file")
    known = load_vessel(str(vessel))
    try:
        names = pulling(known, axis)
        if not as_json:
            print(
                f"Tie the vessel to the balance along {axis}: it pulls {2 * levels} times. Ctrl-C stops the thrusters."
            )
        with Person(pilot, axis, simulated=simulated) as person:
            pulls = drive(known, axis, levels, person)
        found, dead_zone = fitted(pulls)
        if save is not None:
            write_thrusters(vessel, save, set(names), found.identified, dead_zone)
    except (IdentificationError, IdentifiedVesselError) as error:
        raise CliError(str(error)) from None
    except OSError as error:
        raise CliError(f"{save}: cannot be written: {error.strerror}") from None
    parameters = [{"name": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in found.identified.parameters]
    if as_json:
        readings = [{"command": p.command, "thrust_n": p.thrust_n} for p in pulls]
        print(json.dumps({"model": found.identified.model, "parameters": parameters, "dead_zone": dead_zone,
                          "readings": readings, "vessel_file": str(save or "")}))  # fmt: skip
        return
    print(f"{len(pulls)} readings, per thruster of {', '.join(names)}: model {found.identified.model}")
    for p in found.identified.parameters:
        print(f"  {p.name:10} {p.value:12.6g} +- {p.std:.2g} {p.unit}")
    print(f"  unexplained {found.identified.residual_rms:.3g} N rms; dead zone {dead_zone:g}")
    if save is not None:
        print(f"vessel file: {save}")
