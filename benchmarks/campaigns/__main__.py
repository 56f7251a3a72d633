"""`python -m benchmarks.campaigns`: the identification campaigns of PlaDyPos and VideoRay through the whole system."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from benchmarks.campaigns.jobs import Job, Run

_TOLD_EVERY_S = 20.0
"""Without a terminal there is a line so often instead of a bar."""


def main(
    out: Annotated[Path, typer.Option(help="Folder for report.html, report.json and campaigns.svg.")] = Path(
        "campaigns"
    ),
    seeds: Annotated[int, typer.Option(min=1, help="Of each kind of self-oscillation.")] = 50,
    only: Annotated[str, typer.Option(help='Only work whose name has this: "yaw", "seed", "step surge 0.1".')] = "",
    processes: Annotated[int, typer.Option(min=1, help="At the same time.")] = os.cpu_count() or 1,
) -> None:
    """Run every campaign, identify from the logs, write the report. Broken off, it goes on where it was."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core for each process
        os.environ.setdefault(variable, "1")
    from benchmarks.campaigns import figures, report
    from benchmarks.campaigns.jobs import jobs
    from benchmarks.result import machine
    from logs.recorder import git_revision

    out.mkdir(parents=True, exist_ok=True)
    store = out / "runs.jsonl"
    done = _read(store)
    work = [job for job in jobs(seeds) if only in job.name]
    if not work:
        raise typer.BadParameter(f"no work is called {only!r}", param_hint="--only")
    if done:
        print(f"{sum(job.name in done for job in work)} of {len(work)} were made before: {store}", file=sys.stderr)
    begin_s = time.monotonic()
    failures = _make([job for job in work if job.name not in done], done, store, processes)
    runs = [run for job in work for run in done.get(job.name, ())]
    about = {
        "seeds": seeds,
        "vessel_hours": round(sum(run.duration_s for run in runs) / 3600.0, 2),
        "minutes": round((time.monotonic() - begin_s) / 60.0, 1),
        "processes": processes,
        "cpu": machine()["cpu"],
        "revision": git_revision(),
    }
    document = report.document(runs, seeds, failures, about)
    (out / "report.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    (out / "report.html").write_text(report.page(runs, seeds, failures, about), encoding="utf-8")
    report.draw(out / "campaigns.svg", runs)
    if not failures and not only:
        store.unlink(missing_ok=True)  # all of it is in the report; the next call begins afresh
    goals = figures.goals(runs, seeds)
    for goal in goals:
        print(f"{report.verdict(goal):8} {goal.name}: {goal.reached:.3g} {goal.unit} (at most {goal.limit:g})")
    for name, why in failures.items():
        print(f"failed: {name}: {why}", file=sys.stderr)
    print(f"{out / 'report.html'}: {sum(goal.passed for goal in goals)} of {len(goals)} goals reached")
    if failures or (not only and not all(goal.passed for goal in goals)):
        raise typer.Exit(1)


def _make(work: list[Job], done: dict[str, list[Run]], store: Path, processes: int) -> dict[str, str]:
    """Do the work in processes of low priority, keep each piece as soon as it is there; return what failed, and why."""
    failures: dict[str, str] = {}
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    told_s = time.monotonic()
    with (
        TemporaryDirectory(prefix="campaigns-") as folder,
        Progress(
            *columns, console=Console(stderr=True), disable=not sys.stderr.isatty(), speed_estimate_period=600
        ) as bar,
        ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), os.nice, (10,)) as pool,
        store.open("a", encoding="utf-8") as file,
    ):
        task = bar.add_task("campaigns", total=sum(job.vessel_s for job in work))
        waiting: dict[Future[list[Run]], Job] = {
            pool.submit(job.make, *job.arguments, Path(folder)): job for job in work
        }
        try:
            while waiting:
                ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in ready:
                    job = waiting.pop(future)
                    bar.update(task, advance=job.vessel_s, description=job.name)
                    if (error := future.exception()) is not None:
                        failures[job.name] = f"{type(error).__name__}: {error}"
                        continue
                    done[job.name] = future.result()
                    runs = [json.loads(run.model_dump_json()) for run in done[job.name]]
                    file.write(json.dumps({"job": job.name, "runs": runs}) + "\n")
                    file.flush()
                if bar.disable and time.monotonic() - told_s > _TOLD_EVERY_S:
                    told_s = time.monotonic()
                    left_s = bar.tasks[task].time_remaining or 0.0
                    print(f"{bar.tasks[task].percentage:3.0f} %, some {left_s / 60:.0f} min left", file=sys.stderr)
        except KeyboardInterrupt:
            print(f"broken off: {len(done)} pieces are kept in {store}; the same command goes on", file=sys.stderr)
            pool.shutdown(cancel_futures=True)
            raise typer.Exit(130) from None
    return failures


def _read(store: Path) -> dict[str, list[Run]]:
    """Return the pieces that were made before; a half-written last line is left out."""
    from benchmarks.campaigns.jobs import Run

    done: dict[str, list[Run]] = {}
    for line in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
        try:
            entry = json.loads(line)
            done[entry["job"]] = [Run.model_validate(run) for run in entry["runs"]]
        except (ValueError, KeyError):
            continue
    return done


if __name__ == "__main__":
    typer.run(main)
