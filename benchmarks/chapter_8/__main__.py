"""`python -m benchmarks.chapter_8`: run the star for each figure of thesis chapter 8, draw it from the recording."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.chapter_8.drawing import FIGURES, Drawing, Log
from benchmarks.chapter_8.runs import RUNS
from logs.reader import Recording
from services.cli.figure_parts import Figure
from services.cli.svg import write


def figure(drawing: Drawing, folder: Path) -> Figure:
    """Return a figure; its runs' recordings go into a folder."""
    return drawing.draw(*(Log(Recording(RUNS[run].record(folder / run.replace(" ", "-")))) for run in drawing.runs))


def main(
    names: Annotated[list[str] | None, typer.Argument(help="Numbers of figures; all without.")] = None,
    out: Annotated[Path, typer.Option(help="Folder to write NAME.svg into.")] = Path("figures"),
    recordings: Annotated[Path | None, typer.Option(help="Keep the recordings in this folder.")] = None,
    recording: Annotated[Path | None, typer.Option(help="Draw one figure from this recording: no run.")] = None,
    show_list: Annotated[bool, typer.Option("--list", help="Only list the figures.")] = False,
) -> None:
    """Run the star, record it, draw from the recording."""
    if unknown := set(names or ()) - FIGURES.keys():
        raise typer.BadParameter(f"no such figure: {', '.join(sorted(unknown))}; known: {', '.join(FIGURES)}")
    out.mkdir(parents=True, exist_ok=True)
    for name in names or FIGURES:
        drawing = FIGURES[name]
        if show_list:
            print(f"{name:<14} {drawing.title}")
            continue
        if recording is not None:
            made = drawing.draw(Log(Recording(recording)))
        else:
            with tempfile.TemporaryDirectory(prefix="sb-") as scratch:
                made = figure(drawing, (recordings or Path(scratch)))
        write(out / f"{name}.svg", made.charts, made.caption)
        print(f"{out / name}.svg: {made.caption}", flush=True)


if __name__ == "__main__":
    typer.run(main)
