"""The cameras of this machine, from Linux' sysfs: nothing is opened."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import NamedTuple


class CameraDevice(NamedTuple):
    """A camera: its device, the name its maker gave it, and a link to it that survives re-plugging (or empty)."""

    device: str
    name: str
    stable: str


def cameras(root: Path = Path("/")) -> list[CameraDevice]:
    """Return the cameras, by number. A camera's second device carries metadata, not pictures: it is left out."""
    stable: dict[str, str] = {}
    with contextlib.suppress(OSError):
        stable = {str(link.resolve()): str(link) for link in sorted((root / "dev/v4l/by-id").iterdir())}
    found = []
    for entry in sorted((root / "sys/class/video4linux").glob("video*"), key=lambda p: int(p.name[5:])):
        with contextlib.suppress(OSError, ValueError):
            if int((entry / "index").read_text()) == 0:
                device = root / "dev" / entry.name
                name = (entry / "name").read_text().strip()
                found.append(CameraDevice(str(device), name, stable.get(str(device.resolve()), "")))
    return found
