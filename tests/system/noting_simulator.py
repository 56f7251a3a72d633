"""The simulator with a notebook: what the firmware's end runs, and where the vessel is, whatever the bus does."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from services.simulator.service import Simulator

NOTING = 'simulation = true\nservices = { simulator = "tests.system.noting_simulator:NotingSimulator" }'


class Note(NamedTuple):
    """One line of the notebook."""

    stamp_s: float
    moving: bool
    x_m: float
    y_m: float
    psi_rad: float


class NotingSimulator(Simulator):
    """Simulate, and write one line a step beside the run directory."""

    def start(self, now_s: float) -> None:
        """Open the notebook."""
        super().start(now_s)
        self._notes = (self._run_dir.parent / "notes.txt").open("a", buffering=1)

    def step(self, now_s: float) -> None:
        """Note what the firmware runs and where the vessel truly is."""
        super().step(now_s)
        moving = any(self._firmware.commands(now_s).values())
        x, y, psi, *_ = self._world.state
        self._notes.write(f"{now_s!r} {int(moving)} {x!r} {y!r} {psi!r}\n")


def read_notes(folder: Path, since_s: float = 0.0) -> list[Note]:
    """Return the complete lines since a time."""
    text = (folder / "notes.txt").read_text()
    rows = (line.split() for line in text[: text.rfind("\n") + 1].splitlines())
    notes = [Note(float(r[0]), r[1] == "1", float(r[2]), float(r[3]), float(r[4])) for r in rows if len(r) == 5]
    return [n for n in notes if n.stamp_s >= since_s]
