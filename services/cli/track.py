"""`starboard track`: the camera tracker without the star, on a picture, a folder, a video or a camera."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from camera_tracker.config import CameraTrackerConfig
    from camera_tracker.detectors.base import Detection
    from camera_tracker.metres import Metres
    from camera_tracker.sources import Frame, Image, Source

_POLL_S = 0.005
_NO_VEHICLE = (
    "no vehicle found in any frame: describe the colours of its patches in a [camera_tracker] section and give that "
    "file with --config (an example is config/overhead-video.toml)"
)


def track(  # noqa: PLR0917 - options, each by its name
    source: Annotated[
        str,
        typer.Argument(help="Picture, folder, video, /dev/video0 or a number, rtsp:// or http://, sim://[DIRECTORY]."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    config: Annotated[Path | None, typer.Option(help="TOML file with a [camera_tracker] section.")] = None,
    markers: Annotated[
        str | None, typer.Option(help="Find every square marker of a dictionary: 4x4_50, apriltag_36h11, ...")
    ] = None,
    show: Annotated[Path | None, typer.Option(help="Write a video (.mp4) with the poses drawn in.")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many frames; a camera has no end.")] = None,
) -> None:
    """Find vehicles by their markers in a recording or a camera; Ctrl-C ends a camera."""
    import cv2

    from camera_tracker.sources import SourceError, open_source
    from camera_tracker.tracking import Tracker
    from services.catalog import run_dir

    cv2.setNumThreads(1)
    tracker_config = _read_config(config, markers)
    tracker, metres = Tracker(tracker_config), _metres(tracker_config, config)
    names = [vehicle.name for vehicle in tracker_config.vehicles]
    results: list[dict[str, Any]] = []
    try:
        pictures = open_source(source, run_dir())
        total = frames or pictures.frames_total
        with _drawing(show, pictures) as draw, _progress(as_json, total) as advance:
            for frame in _frames(pictures, frames):
                _check_size(metres, frame.image)
                found = tracker.track(frame.image, frame.stamp_ns)
                poses = [_pose(name, pose, metres) for name, pose in found.items()]
                results.append({"index": frame.index, "stamp_s": frame.stamp_ns * 1e-9, "poses": poses})
                draw(frame.image, found)
                advance()
    except SourceError as error:
        raise CliError(str(error)) from None
    names += sorted({pose["name"] for result in results for pose in result["poses"]} - set(names), key=_by_number)
    vehicles = [_summary(name, results) for name in names]
    summary = {"frames": len(results), "skipped": pictures.skipped, "vehicles": vehicles}
    if as_json:
        print(json.dumps({"source": source, "frames": results, "summary": summary}))
    else:
        _print_summary(source, summary)
    if not any(vehicle["found"] for vehicle in vehicles):
        hint = _NO_VEHICLE if markers is None else f"no marker of {markers} found in any frame: is it that dictionary?"
        typer.echo(f"starboard: {hint}", err=True)


def _read_config(path: Path | None, markers: str | None) -> CameraTrackerConfig:
    from bus.config import ConfigError, parse, read_toml
    from camera_tracker.config import CameraTrackerConfig

    if markers is not None:
        if path is not None:
            raise CliError("--markers and --config: give one of them")
        return parse(CameraTrackerConfig, {"every_marker_of": markers}, Path("--markers"))
    if path is None:
        return CameraTrackerConfig().with_default_marker("vessel", None)
    tables = read_toml(path)
    if "camera_tracker" not in tables:
        raise ConfigError(f"{path}: no section [camera_tracker]")
    config = parse(CameraTrackerConfig, tables["camera_tracker"], path, "camera_tracker")
    return config.with_default_marker("vessel", config.scale_px_per_m)


def _metres(config: CameraTrackerConfig, path: Path | None) -> Metres | None:
    """Return what turns px into {E}, where the configuration has a calibration or a scale."""
    from camera_tracker.metres import Calibrated, StraightDown

    if config.calibration is not None and path is not None:
        return Calibrated(config, path.parent / config.calibration)
    return None if config.scale_px_per_m is None else StraightDown(config.scale_px_per_m, (0, 0))


def _check_size(metres: Metres | None, image: Image) -> None:
    """Raise CliError when a picture has another size than the camera was calibrated at."""
    width, height = image.shape[1::-1]
    if metres is not None and metres.size_px not in {(0, 0), (width, height)}:
        expected = " x ".join(str(v) for v in metres.size_px)
        raise CliError(f"the picture has {width} x {height} px, but the camera was calibrated at {expected} px")


def _frames(source: Source, limit: int | None) -> Iterator[Frame]:
    """Yield a recording's frames, or a camera's until Ctrl-C."""
    import time

    count = 0
    try:
        while limit is None or count < limit:
            frame = source.read()
            if frame is not None:
                count += 1
                yield frame
            elif source.live:
                time.sleep(_POLL_S)
            else:
                return
    except KeyboardInterrupt:
        if not source.live:
            raise
    finally:
        source.close()


def _by_number(name: str) -> tuple[int, str]:
    return (int(name) if name.isdecimal() else -1, name)


def _pose(name: str, found: Detection, metres: Metres | None) -> dict[str, Any]:
    pose = {
        "name": name,
        "x_px": round(found.x_px, 4),
        "y_px": round(found.y_px, 4),
        "psi_rad": round(found.psi_rad, 6),
        "quality": round(found.quality, 3),
    }
    if found.reason:
        pose["reason"] = found.reason
    if found.heading_ambiguous:
        pose["heading_ambiguous"] = True
    if found.corners_px:
        pose["corners_px"] = [[round(x, 3), round(y, 3)] for x, y in found.corners_px]
    return pose if metres is None else pose | metres.fields(name, found)


def _summary(name: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """Return in what fraction of the frames a vehicle was found, and its median steps from frame to frame."""
    import statistics

    poses = [next((pose for pose in result["poses"] if pose["name"] == name), None) for result in results]
    steps = [(a, b) for a, b in itertools.pairwise(poses) if a is not None and b is not None]
    moved = [math.hypot(b["x_px"] - a["x_px"], b["y_px"] - a["y_px"]) for a, b in steps]
    turned = [abs(math.degrees(math.remainder(b["psi_rad"] - a["psi_rad"], math.tau))) for a, b in steps]
    return {
        "name": name,
        "found": sum(pose is not None for pose in poses) / max(len(poses), 1),
        "median_step_px": statistics.median(moved) if moved else None,
        "median_step_deg": statistics.median(turned) if turned else None,
    }


def _print_summary(source: str, summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    console.print(f"{source}: {summary['frames']} frames", soft_wrap=True, highlight=False)
    table = Table("vehicle")
    for column in ("found", "median step px", "median step deg"):
        table.add_column(column, justify="right")
    for vehicle in summary["vehicles"]:
        steps = [vehicle["median_step_px"], vehicle["median_step_deg"]]
        table.add_row(vehicle["name"], f"{vehicle['found']:.1%}", *("-" if v is None else f"{v:.3f}" for v in steps))
    console.print(table)
    if summary["skipped"]:
        console.print(f"no pictures, left out: {', '.join(summary['skipped'])}")


@contextmanager
def _progress(quiet: bool, total: int | None) -> Iterator[Any]:
    """Show how far a long recording is; yields what to call after each frame."""
    if quiet or total == 1:
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("tracking", total=total)
        yield lambda: progress.advance(task)


@contextmanager
def _drawing(path: Path | None, source: Source) -> Iterator[Any]:
    """Write a video; yields what to call with each picture and its poses. Raises CliError when it cannot be written."""
    if path is None:
        yield lambda _image, _found: None
        return
    import cv2

    writers: list[cv2.VideoWriter] = []

    def draw(image: Image, found: dict[str, Detection]) -> None:
        if not writers:
            fourcc = cv2.VideoWriter.fourcc(*"mp4v")
            rate_hz = getattr(source, "rate_hz", 30.0 if source.live else 1.0)
            writers.append(cv2.VideoWriter(str(path), fourcc, rate_hz, (image.shape[1], image.shape[0])))
            if not writers[0].isOpened():
                raise CliError(f"{path}: this video cannot be written; give a name ending in .mp4 in a folder of yours")
        writers[0].write(_drawn(image, found))

    try:
        yield draw
    finally:
        for writer in writers:
            writer.release()


def _drawn(image: Image, found: dict[str, Detection]) -> Any:
    """Return a copy with position (circle), heading (blue line), as in thesis Fig. 3.15(b), region, quality and reason.

    The circle is green for a good pose and red for a doubtful one.
    """
    import cv2

    from camera_tracker.detectors.base import GOOD_QUALITY

    copy = image.copy()
    for name, pose in found.items():
        middle = (round(pose.x_px), round(pose.y_px))
        ahead = 1.5 * pose.extent_px
        tip = (round(pose.x_px + ahead * math.cos(pose.psi_rad)), round(pose.y_px + ahead * math.sin(pose.psi_rad)))
        colour = (0, 255, 0) if pose.quality >= GOOD_QUALITY else (0, 0, 255)
        if (region := pose.region) is not None:
            cv2.rectangle(copy, (region.x0, region.y0), (region.x1 - 1, region.y1 - 1), (200, 200, 200), 1)
        cv2.line(copy, middle, tip, (255, 80, 0), 2, cv2.LINE_AA)
        cv2.circle(copy, middle, 4, colour, 2, cv2.LINE_AA)
        text = f"{name} {pose.quality:.2f} {pose.reason}" + (" front?" if pose.heading_ambiguous else "")
        at = (middle[0] + 8, middle[1] - 8)
        cv2.putText(copy, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1)
    return copy
