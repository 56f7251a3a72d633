"""`starboard camera laser`: the laser distance module of thesis 3.4, offline on pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.errors import CliError

if TYPE_CHECKING:
    from camera_tracker.laser.ranging import LaserModule

app = typer.Typer(
    no_args_is_help=True, help="Distance to a wall from two laser dots (thesis 3.4).", rich_markup_mode=None
)

Calibration = Annotated[
    Path | None, typer.Option(help="What `calibrate` wrote. Default: the curves of thesis Table 3.1.")
]
Spacing = Annotated[float, typer.Option(min=1.0, help="Between the lasers.")]
Out = Annotated[Path, typer.Option(help="The file to write.")]


@app.command()
def measure(
    source: Annotated[str, typer.Argument(help="Picture, folder or video of the forward camera.")],
    calibration: Calibration = None,
    spacing_mm: Spacing = 100.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Print distance and angle to the wall in each picture, and which dot is lost."""
    from camera_tracker.laser.dots import DotTracker
    from camera_tracker.sources import SourceError, open_source

    tracker = DotTracker(_module(calibration, spacing_mm))
    rows: list[dict[str, Any]] = []
    try:
        pictures = open_source(source, Path())
        if pictures.live:
            pictures.close()
            raise CliError(f"{source}: give a picture, a folder or a video")
        for frame in iter(pictures.read, None):
            found = tracker.read(frame.image)
            rows.append(
                {
                    "index": frame.index,
                    "distance_m": found.distance_m,
                    "angle_rad": found.angle_rad,
                    "x_left_px": found.left and round(found.left.x_px, 3),
                    "x_right_px": found.right and round(found.right.x_px, 3),
                    "lost": found.lost,
                    "whole_picture": found.whole_picture,
                }
            )
        pictures.close()
    except SourceError as error:
        raise CliError(str(error)) from None
    if as_json:
        print(json.dumps({"source": source, "frames": rows}))
        return
    for row in rows:
        if row["lost"]:
            print(f"{row['index']:5d}  {row['lost']}")
        else:
            print(f"{row['index']:5d}  {row['distance_m']:.3f} m  {math.degrees(row['angle_rad']):+.1f} deg")


@app.command()
def calibrate(
    data: Annotated[Path, typer.Argument(help="CSV with the columns distance_m, x_left_px, x_right_px.")],
    centre_x_px: Annotated[float, typer.Option(help="Middle of the picture: half its width in px, less 0.5.")] = 319.5,
    spacing_mm: Spacing = 100.0,
    out: Out = Path("laser.json"),
) -> None:
    """Fit the curves (3.9) to the dots seen at known distances, the vessel square to the wall."""
    from camera_tracker.calibration import CalibrationError
    from camera_tracker.laser.ranging import LaserModule, fit_curve

    distance_m, left_px, right_px = _columns(data)
    fitted = []
    for name, x_px in (("left", centre_x_px - left_px), ("right", right_px - centre_x_px)):
        try:
            fitted.append(fit_curve(x_px, distance_m))
        except CalibrationError as error:
            raise CliError(f"{data}: {name} laser: {error}") from None
    (left, left_m), (right, right_m) = fitted
    rms_m = math.sqrt(0.5 * (left_m**2 + right_m**2))
    module = LaserModule(left=left, right=right, spacing_m=1e-3 * spacing_mm, centre_x_px=centre_x_px, rms_m=rms_m)
    try:
        out.write_text(module.model_dump_json(indent=1))
    except OSError as error:
        raise CliError(f"{out}: cannot be written: {error.strerror}") from None
    print(f"{out}: {len(distance_m)} distances, {1e3 * rms_m:.1f} mm RMS")


@app.command()
def render(
    out: Annotated[Path, typer.Argument(help="The picture (.png).")],
    distance_m: Annotated[float, typer.Option(help="To the wall.")] = 0.5,
    angle_deg: Annotated[float, typer.Option(min=-80.0, max=80.0, help="Of the wall.")] = 0.0,
    calibration: Calibration = None,
    spacing_mm: Spacing = 100.0,
) -> None:
    """Draw a wall with two dots, to try the other commands without lasers."""
    import cv2

    from camera_tracker.laser.wall import wall_picture

    try:
        picture = wall_picture(_module(calibration, spacing_mm), distance_m, math.radians(angle_deg))
    except ValueError as error:
        raise CliError(str(error)) from None
    try:
        written = cv2.imwrite(str(out), picture)
    except cv2.error:
        written = False
    if not written:
        raise CliError(f"{out}: cannot be written; give a name that ends in .png, in a folder of yours")


def _module(path: Path | None, spacing_mm: float) -> LaserModule:
    from camera_tracker.laser.ranging import laser_module

    return laser_module(path, 1e-3 * spacing_mm)


def _columns(path: Path) -> list[Any]:
    """Return distance_m, x_left_px, x_right_px as arrays; raise CliError with the line that is wrong."""
    import csv

    import numpy as np

    wanted = ("distance_m", "x_left_px", "x_right_px")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CliError(f"{path}: cannot be read: {error}") from None
    if not rows or any(name not in rows[0] for name in wanted):
        raise CliError(f"{path}: no columns {', '.join(wanted)} in its first line, or nothing below it")
    columns: list[list[float]] = [[], [], []]
    for number, row in enumerate(rows, 2):
        for column, name in zip(columns, wanted, strict=True):
            try:
                column.append(float(row[name]))
            except (TypeError, ValueError):
                raise CliError(f"{path}: line {number}: {name} is no number") from None
    return [np.array(column) for column in columns]
