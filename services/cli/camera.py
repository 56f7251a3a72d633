"""`starboard camera`: print markers and boards, calibrate the lens, find the camera's place, list cameras."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli import laser
from services.cli.errors import CliError
from services.cli.speeds import speeds

if TYPE_CHECKING:
    from camera_tracker.boards import Board
    from camera_tracker.calibration import Calibrated
    from camera_tracker.plane import CameraFile

app = typer.Typer(no_args_is_help=True, help="Print, calibrate and place cameras.", rich_markup_mode=None)
app.add_typer(laser.app, name="laser")
app.command("speeds")(speeds)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
Squares = Annotated[str, typer.Option(help="Columns x rows of squares of the board that print-board made.")]
Corners = Annotated[
    str | None, typer.Option("--chessboard", help="A plain chessboard instead: its columns x rows of inner corners.")
]
SquareMm = Annotated[float, typer.Option(min=1.0, help="Side of a square, measured on the print.")]
Paper = Annotated[str, typer.Option(help="a4, a3, a2 or letter.")]
CameraJson = Annotated[Path, typer.Argument(help="What `starboard camera calibrate` wrote; is extended.")]

_RULER_MM = 100.0
_HINT = "print at 100 % (actual size); the line is 100 mm long"


@app.command("list")
def list_cameras(as_json: Json = False) -> None:
    """List the cameras of this machine, with the name that stays when they are plugged in again."""
    from camera_tracker.devices import cameras

    found = cameras()
    if as_json:
        print(json.dumps([c._asdict() for c in found]))
        return
    for camera in found:
        print(f"{camera.device}  {camera.name}" + (f"  {camera.stable}" if camera.stable else ""))
    if not found:
        typer.echo("no camera: none is plugged in, or this machine passes none through (/dev/video*)", err=True)


@app.command("print-marker")
def print_marker(
    number: Annotated[int, typer.Argument(help="Number of the marker in its dictionary.")],
    size_mm: Annotated[float, typer.Option(min=5.0, help="Side of the black square.")] = 150.0,
    dictionary: Annotated[str, typer.Option(help="4x4_50, apriltag_36h11, ...")] = "4x4_50",
    paper: Paper = "a4",
    out: Annotated[Path | None, typer.Option(help="Default: marker-NUMBER.pdf.")] = None,
) -> None:
    """Write a square marker as PDF of true size; its x axis goes from left to right."""
    from camera_tracker.boards import marker_squares

    side = 1e-3 * size_mm
    text = f"marker {number} of {dictionary}, {size_mm:g} mm, x axis to the right; {_HINT}"
    try:
        squares = marker_squares(dictionary, number, 0.0, 0.0, side)
        _write_sheet(out or Path(f"marker-{number}.pdf"), squares, (side, side), text, paper)
    except ValueError as error:
        raise CliError(str(error)) from None


@app.command("print-board")
def print_board(
    squares: Squares = "9x6",
    square_mm: SquareMm = 30.0,
    paper: Paper = "a4",
    out: Annotated[Path, typer.Option(help="The PDF.")] = Path("board.pdf"),
) -> None:
    """Write a calibration board (ChArUco) as PDF of true size."""
    from camera_tracker.boards import Charuco

    columns, rows = _grid(squares)
    try:
        board = Charuco(columns, rows, 1e-3 * square_mm)
        size = (1e-3 * square_mm * columns, 1e-3 * square_mm * rows)
        _write_sheet(out, board.squares(), size, f"board {squares}, squares {square_mm:g} mm; {_HINT}", paper)
    except ValueError as error:
        raise CliError(str(error)) from None


def _write_sheet(path: Path, squares: Any, size: tuple[float, float], text: str, paper: str) -> None:
    from camera_tracker.sheet import sheet_pdf

    _write(path, sheet_pdf(squares, size, text, paper, _RULER_MM))
    print(f"{path}: {text}")


@app.command()
def grab(  # noqa: PLR0917 - a command's options
    source: Annotated[str, typer.Argument(help="/dev/video0 or a number, a stream's address, sim://.")],
    folder: Annotated[Path, typer.Argument(help="Where the pictures go.")],
    squares: Squares = "9x6",
    square_mm: SquareMm = 30.0,
    chessboard: Corners = None,
    count: Annotated[int, typer.Option(min=1, help="End after so many pictures.")] = 15,
) -> None:
    """Take a picture each time the board is held still in a new pose, and say where it is still missing."""
    from camera_tracker.grabbing import grab_views
    from camera_tracker.sources import SourceError, open_source
    from services.catalog import run_dir

    board = _board(squares, square_mm, chessboard)
    try:
        pictures = open_source(source, run_dir())
        folder.mkdir(parents=True, exist_ok=True)
        for taken, where in grab_views(pictures, board, folder, count):
            print(f"{taken}/{count}" + (f": still missing: {where}" if where else ": the whole picture is covered"))
    except SourceError as error:
        raise CliError(str(error)) from None
    except OSError as error:
        raise CliError(f"{folder}: cannot be written: {error.strerror}") from None


@app.command()
def picture(
    source: Annotated[str, typer.Argument(help="/dev/video0 or a number, a stream's address, sim://.")],
    file: Annotated[Path, typer.Argument(help="Where it goes: .png, .jpg.")],
    seconds: Annotated[float, typer.Option(min=0.0, help="Wait so long for the exposure to settle.")] = 1.0,
) -> None:
    """Take one picture, for `starboard camera place`."""
    import cv2

    from camera_tracker.grabbing import grab_picture
    from camera_tracker.sources import PICTURE_SUFFIXES, SourceError, open_source
    from services.catalog import run_dir

    if file.suffix.lower() not in PICTURE_SUFFIXES:
        raise CliError(f"{file}: call it .png or .jpg")
    try:
        image = grab_picture(open_source(source, run_dir()), seconds)
    except SourceError as error:
        raise CliError(str(error)) from None
    _write(file, cv2.imencode(file.suffix, image)[1].tobytes())
    print(f"{file}: {image.shape[1]} x {image.shape[0]} px")


@app.command()
def calibrate(  # noqa: PLR0917 - a command's options
    folder: Annotated[str, typer.Argument(help="Folder of pictures of the board.")],
    squares: Squares = "9x6",
    square_mm: SquareMm = 30.0,
    chessboard: Corners = None,
    out: Annotated[Path, typer.Option(help="The camera's file.")] = Path("camera.json"),
    as_json: Json = False,
) -> None:
    """Calibrate camera matrix and distortion from pictures of a board; bad sets are refused with the reason."""
    import cv2

    from camera_tracker.calibration import CalibrationError, calibrate, coverage
    from camera_tracker.plane import CameraFile

    cv2.setNumThreads(1)
    views, without, size = _views(folder, _board(squares, square_mm, chessboard))
    try:
        result = calibrate(views, size)
    except CalibrationError as error:
        unseen = f"; the board is not seen in {', '.join(without)}" if without else ""
        raise CliError(f"{folder}: {error}{unseen}") from None
    _write_camera(out, CameraFile(lens=result.lens, views_px=result.views_px))
    if as_json:
        lens = result.lens.model_dump(exclude={"covariance"})
        about = {"lens": lens, "views_px": result.views_px, "without_board": without, "advice": result.advice}
        print(json.dumps({"file": str(out), **about, "coverage": coverage(views, size).tolist()}))
    else:
        _print_calibration(out, result, without)


def _views(folder: str, board: Board) -> tuple[list[Any], list[str], tuple[int, int]]:
    """Return the views of a folder's pictures, the names of those without a board, and their size."""
    import cv2
    import numpy as np

    from camera_tracker.sources import PICTURE_SUFFIXES

    directory = Path(folder)
    if not directory.is_dir():
        raise CliError(f"{folder}: no such folder of pictures; take some with `starboard camera grab`")
    views, without, sizes = [], [], {}
    for path in sorted(p for p in directory.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES):
        # A turned picture is not what the sensor saw.
        image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if image is None:
            without.append(path.name)
            continue
        sizes[path.name] = image.shape[1::-1]
        view = board.view(path.name, np.asarray(image, np.uint8))
        if view is None:
            without.append(path.name)
        else:
            views.append(view)
    if not sizes:
        raise CliError(f"{folder}: no pictures in this folder")
    first = next(iter(sizes))
    for name, size in sizes.items():
        if size != sizes[first]:
            raise CliError(
                f"{folder}: {name} is {size[0]} x {size[1]} px, {first} {sizes[first][0]} x {sizes[first][1]} px"
            )
    return views, without, sizes[first]


def _print_calibration(out: Path, result: Calibrated, without: list[str]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table("picture")
    table.add_column("error px", justify="right")
    for name, error in result.views_px.items():
        table.add_row(name, f"{error:.3f}")
    for name in without:
        table.add_row(name, "no board")
    console.print(table)
    lens = result.lens
    std_px = lens.covariance[0][0] ** 0.5
    console.print(
        f"{out}: {lens.width_px} x {lens.height_px} px, focal length {lens.fx_px:.1f} px (+- {std_px:.1f}), "
        f"reprojection error {lens.rms_px:.3f} px",
        highlight=False,
        soft_wrap=True,
    )
    for line in result.advice:
        console.print(f"advice: {line}", highlight=False, soft_wrap=True)


@app.command()
def place(
    camera: CameraJson,
    picture: Annotated[Path, typer.Argument(help="A picture of the pool with the points.")],
    points: Annotated[
        Path, typer.Argument(help="TOML file: [[point]] with marker (or x_px, y_px), x_m, y_m, height_m.")
    ],
    as_json: Json = False,
) -> None:
    """Find where the camera hangs over the water, from markers or points at known places."""
    import cv2
    import numpy as np

    from camera_tracker.calibration import CalibrationError, read_json
    from camera_tracker.plane import CameraFile, place_camera
    from camera_tracker.references import ReferenceFile

    known: CameraFile = read_json(CameraFile, camera)
    references = ReferenceFile.read(points)
    image = cv2.imread(str(picture), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise CliError(f"{picture}: not a picture that can be read")
    if image.shape[1::-1] != (known.lens.width_px, known.lens.height_px):
        raise CliError(
            f"{picture}: {image.shape[1]} x {image.shape[0]} px, but the camera was calibrated at "
            f"{known.lens.width_px} x {known.lens.height_px} px"
        )
    seen, missing = references.seen(np.asarray(image, np.uint8))
    unseen = f"not seen: {', '.join(missing)}" if missing else ""
    try:
        found = place_camera(known.lens, seen, std_px=references.std_px, std_m=references.std_m)
    except CalibrationError as error:
        raise CliError(f"{picture}: {error}" + (f"; {unseen}" if unseen else "")) from None
    _write_camera(camera, known.model_copy(update={"placement": found}))
    x_m, y_m, z_m = found.camera_m.tolist()
    about = {"camera_x_m": x_m, "camera_y_m": y_m, "camera_height_m": -z_m, "rms_m": found.rms_m}
    if as_json:
        print(json.dumps({"file": str(camera), **about, "points": len(seen), "not_seen": missing}))
        return
    print(f"{camera}: the camera hangs {-z_m:.3f} m above the water, over x {x_m:.3f} m, y {y_m:.3f} m")
    print(f"{len(seen)} points fit within {1e3 * found.rms_m:.1f} mm RMS" + (f"; {unseen}" if unseen else ""))


def _write_camera(path: Path, content: CameraFile) -> None:
    _write(path, content.model_dump_json(indent=1).encode())


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise CliError(f"{path}: cannot be written: {error.strerror}") from None


def _board(squares: str, square_mm: float, chessboard: str | None) -> Board:
    from camera_tracker.boards import Charuco, Chessboard

    try:
        if chessboard is not None:
            return Chessboard(*_grid(chessboard), 1e-3 * square_mm)
        return Charuco(*_grid(squares), 1e-3 * square_mm)
    except ValueError as error:
        raise CliError(str(error)) from None


def _grid(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
        raise CliError(f"{text!r}: write columns x rows as in 9x6, at least 3 of each")
    return int(columns), int(rows)
