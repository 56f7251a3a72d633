"""`starboard camera speeds`: velocities of a vessel from recorded poses."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from services.cli.errors import CliError


def speeds(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap), or what `starboard track --json` printed.")],
    name: Annotated[str | None, typer.Option(help="Which vessel, where there are several.")] = None,
    window: Annotated[int, typer.Option(min=3, help="Samples of the Savitzky-Golay filter.")] = 15,
    order: Annotated[int, typer.Option(min=1, help="Of its polynomial.")] = 2,
    causal: Annotated[bool, typer.Option("--causal", help="From past poses only, as it would be live.")] = False,
) -> None:
    """Print surge, sway and yaw rate as CSV: Savitzky-Golay and inverse kinematics (thesis Algorithm 3.2, Fig. 3.16).

    Poses in metres give m/s; those of `track --json`, px/s.
    """
    import numpy as np

    from marine.estimation.smoothing import recorded_velocities

    unit, poses = _recorded(file) if file.suffix == ".mcap" else _tracked(file)
    names = sorted({pose[0] for pose in poses})
    wanted = name if name is not None or len(names) != 1 else names[0]
    if wanted not in names:
        raise CliError(f"{file}: choose one with --name: {', '.join(names) or 'there are no poses'}")
    table = np.array([pose[1:] for pose in poses if pose[0] == wanted])
    try:
        nu = recorded_velocities(table[:, 0], table[:, 1:].T, window, order, causal=causal)
    except ValueError as error:
        raise CliError(f"{file}: {error}") from None
    writer = csv.writer(sys.stdout)
    writer.writerow(["stamp_s", f"surge_{unit}_s", f"sway_{unit}_s", "yaw_rad_s"])
    for stamp_s, row in zip(table[:, 0], nu.T, strict=True):
        if np.isfinite(row).all():
            writer.writerow([f"{stamp_s:.6f}", *(f"{value:.6g}" for value in row)])


Pose = tuple[str, float, float, float, float]
"""Name, stamp in s, x, y, psi."""


def _recorded(path: Path) -> tuple[str, list[Pose]]:
    from bus import topics
    from bus.messages import CameraPose
    from logs.container import RecordingError
    from logs.reader import Recording

    try:
        entries = [entry.message for entry in Recording(path).messages(topics.CAMERA_POSE)]
    except RecordingError as error:
        raise CliError(str(error)) from None
    found = [m for m in entries if isinstance(m, CameraPose)]
    poses = [
        (m.name, m.stamp_ns * 1e-9, m.x_m, m.y_m, m.psi_rad)
        for m in found
        if m.x_m is not None and m.y_m is not None and not m.heading_ambiguous
    ]
    return "m", poses


def _tracked(path: Path) -> tuple[str, list[Pose]]:
    try:
        frames: Any = json.loads(path.read_text(encoding="utf-8"))["frames"]
        poses = [
            (
                str(pose["name"]),
                float(frame["stamp_s"]),
                float(pose["x_px"]),
                float(pose["y_px"]),
                float(pose["psi_rad"]),
            )
            for frame in frames
            for pose in frame["poses"]
            if not pose.get("heading_ambiguous")
        ]
    except OSError as error:
        raise CliError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise CliError(f"{path}: neither a recording (.mcap) nor what `starboard track --json` prints") from None
    return "px", poses
