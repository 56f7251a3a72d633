"""Data for `starboard identify`: an experiment in a recording, or columns of a CSV file, as a record of one axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from services.cli.errors import CliError

if TYPE_CHECKING:
    from bus.messages import ExperimentResult
    from logs.reader import Recording
    from marine.identification.record import Record
    from marine.identification.result import FloatArray

AxisName = Literal["surge", "sway", "heave", "yaw"]
_SIGNALS = ("time", "eta", "tau")
_MISSED = 4.2
"""Sample times that a log's sensor may be silent: three samples in a row are lost now and then."""


@dataclass(frozen=True)
class Source:
    """What the user says about the data. begin_s, end_s: from the beginning of the file."""

    axis: AxisName | None
    run: int | None
    begin_s: float | None
    end_s: float | None
    sample_s: float | None
    delay_s: float
    columns: str
    degrees: bool
    flip: str


def load(path: Path, source: Source) -> tuple[Record, str]:
    """Return the record and one line that says what was read; raise CliError with what is wrong."""
    from marine.identification.result import IdentificationError

    try:
        record, told = (_from_csv if path.suffix == ".csv" else _from_log)(path, source)
    except IdentificationError as error:
        raise CliError(f"{path}: {error}") from None
    units = "rad, Nm" if record.axis == "angular" else "m, N"
    sampling = f"{len(record.t_s)} samples at {1.0 / record.dt_s:.4g} Hz over {record.t_s[-1]:.1f} s; {units}"
    return record, f"{told}; {sampling}; delay {record.delay_s:g} s{'; turned: ' + source.flip if source.flip else ''}"


def _from_log(path: Path, source: Source) -> tuple[Record, str]:
    import numpy as np

    from bus import topics
    from bus.clock import NS
    from bus.messages import AXIS_FIELDS
    from logs.reader import Recording, RecordingError
    from marine.identification.record import LONGEST_GAP_S, on_grid

    try:
        recording = Recording(path)
        runs = [e.message for e in recording.messages(topics.EXPERIMENT_RESULT)] if _has(recording) else []
        camera = topics.CAMERA_POSE.key in recording.topics
        forces = recording.series(topics.ACTUATOR_DELIVERED, *AXIS_FIELDS.values())
    except RecordingError as error:
        raise CliError(str(error)) from None
    except KeyError as error:
        raise CliError(f"{path}: {error.args[0]}") from None
    if source.begin_s is not None or source.end_s is not None:
        if source.axis is None:
            raise CliError("say which axis: --axis surge, sway, heave or yaw")
        axis, sensor = source.axis, None
        begin_s = recording.start_ns / NS + (source.begin_s or 0.0)
        end_s = recording.start_ns / NS + (source.end_s or recording.duration_s)
        told = f"{path.name}, {axis} from {begin_s - recording.start_ns / NS:.1f} s"
    else:
        chosen = _chosen(path, runs, source)
        axis, sensor = chosen.plan.axis, chosen.plan.sensor
        begin_s, end_s = chosen.began_ns / NS, chosen.ended_ns / NS
        told = f"{path.name}, {chosen.plan.name} on {axis}, {runs.index(chosen) + 1} of {len(runs)}"
    try:
        t, eta = _motion(recording, axis, begin_s, camera=camera, laser=sensor == "laser")
    except KeyError as error:
        raise CliError(f"{path}: {error.args[0]}") from None
    signs = _signs(source.flip)
    record = on_grid(
        t,
        signs["eta"] * eta,
        forces["stamp_s"],
        signs["tau"] * forces[AXIS_FIELDS[axis]],
        axis="angular" if axis == "yaw" else "linear",
        begin_s=begin_s,
        end_s=end_s,
        sample_s=source.sample_s,
        delay_s=source.delay_s,
        longest_gap_s=max(LONGEST_GAP_S, _MISSED * float(np.median(np.diff(t)))),
    )
    return record, told


def _motion(
    recording: Recording, axis: AxisName, begin_s: float, *, camera: bool, laser: bool
) -> tuple[FloatArray, FloatArray]:
    """Return times and depth, heading or way along the heading at begin_s, from the sensor that measured it.

    That is the depth sensor, the laser module, the camera, or compass and position. Raises KeyError where none did.
    """
    import numpy as np

    from bus import topics
    from marine.identification.record import along

    if axis == "heave":
        depth = recording.series(topics.SENSOR_DEPTH, "z_m")
        return depth["stamp_s"], depth["z_m"]
    if laser:
        wall = recording.series(topics.SENSOR_LASER, "distance_m", "angle_rad")
        square = wall["distance_m"].astype(float) * np.cos(wall["angle_rad"].astype(float))
        seen = np.isfinite(square)
        return wall["stamp_s"][seen], -square[seen]
    heading = recording.series(topics.CAMERA_POSE if camera else topics.SENSOR_COMPASS, "psi_rad")
    if axis == "yaw":
        return heading["stamp_s"], heading["psi_rad"]
    place = recording.series(topics.CAMERA_POSE if camera else topics.SENSOR_POSITION, "x_m", "y_m")
    t, x, y = place["stamp_s"], place["x_m"], place["y_m"]
    first = min(int((t < begin_s).sum()), len(t) - 1)
    psi_rad = float(heading["psi_rad"][int(np.argmin(np.abs(heading["stamp_s"] - t[first])))])
    return t, along(x - x[first], y - y[first], psi_rad, sway=axis == "sway")


def _has(recording: Recording) -> bool:
    return "experiment/result" in recording.topics


def _chosen(path: Path, runs: list[ExperimentResult], source: Source) -> ExperimentResult:
    if source.run is not None:
        if not 1 <= source.run <= len(runs):
            raise CliError(f"{path}: there is no experiment {source.run}: it has {len(runs)}")
        return runs[source.run - 1]
    wanted = [r for r in runs if source.axis in (None, r.plan.axis)]
    if not wanted:
        raise CliError(
            f"{path}: no experiment{' on ' + source.axis if source.axis else ''} in it: give --begin-s and --end-s"
        )
    return wanted[-1]


def _from_csv(path: Path, source: Source) -> tuple[Record, str]:
    import numpy as np

    from marine.identification.checks import sampled
    from marine.identification.record import Record, on_grid

    if source.axis is None:
        raise CliError("say which axis the columns are of: --axis surge, sway, heave or yaw")
    names = _mapping(source.columns)
    t, eta, tau = (_column(path, names[signal]) for signal in _SIGNALS)
    signs, angular = _signs(source.flip), source.axis == "yaw"
    eta, tau = signs["eta"] * eta, signs["tau"] * tau
    if angular:
        eta = np.unwrap(np.radians(eta) if source.degrees else eta)
    begin_s, end_s = source.begin_s, source.end_s
    keep = (t >= (-math.inf if begin_s is None else begin_s)) & (t <= (math.inf if end_s is None else end_s))
    t, eta, tau = t[keep], eta[keep], tau[keep]
    axis: Literal["angular", "linear"] = "angular" if angular else "linear"
    told = f"{path.name}, columns {', '.join(names[s] for s in _SIGNALS)}"
    if source.sample_s is not None:
        record = on_grid(
            t, eta, t, tau, axis=axis, begin_s=float(t[0]), end_s=float(t[-1]),
            sample_s=source.sample_s, delay_s=source.delay_s,
        )  # fmt: skip
        return record, told + f", resampled to {source.sample_s:g} s"
    sampled(t, axis, eta=eta)
    if not np.isfinite(tau).all():
        raise CliError(f"{path}: {names['tau']} is not a number at sample {int(np.argmin(np.isfinite(tau)))}: cut it")
    return Record(t - t[0], eta, tau, axis, source.delay_s), told


def _mapping(columns: str) -> dict[str, str]:
    names = {signal: signal for signal in _SIGNALS}
    for part in filter(None, columns.split(",")):
        signal, _, name = part.partition("=")
        if signal not in names or not name:
            raise CliError(f"--columns: {part!r}: write time=COLUMN,eta=COLUMN,tau=COLUMN")
        names[signal] = name
    return names


def _signs(flip: str) -> dict[str, float]:
    unknown = [name for name in flip.split(",") if name not in ("", "eta", "tau")]
    if unknown:
        raise CliError(f"--flip: {unknown[0]!r}: eta, tau or both can be turned")
    return {name: -1.0 if name in flip.split(",") else 1.0 for name in ("eta", "tau")}


def _column(path: Path, name: str) -> FloatArray:
    """Return a column of a CSV file with a header; raise CliError with line and reason."""
    import csv

    import numpy as np

    values: list[float] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file)
            if name not in (table.fieldnames or ()):
                known = ", ".join(table.fieldnames or ["none"])
                raise CliError(f"{path}: no column {name!r}; there are {known}: map them with --columns")
            for row in table:
                try:
                    values.append(float(row[name]))
                except (TypeError, ValueError):
                    raise CliError(f"{path}: line {table.line_num}: {name} is no number") from None
    except OSError as error:
        raise CliError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise CliError(f"{path}: no CSV file") from None
    if not values:
        raise CliError(f"{path}: no measurement in it")
    return np.array(values)
