"""Draw what a vessel can do on each pair of its axes (`starboard vessels NAME --plot FILE.svg`)."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from services.cli.errors import CliError
from services.cli.svg import Chart, write

if TYPE_CHECKING:
    from marine.vessel import Vessel

_LABELS = ("X, N", "Y, N", "Z, N", "K, Nm", "M, Nm", "N, Nm")


def draw_attainable(vessel: Vessel, path: Path, failed: Collection[str] = ()) -> None:
    """Draw the set of wrenches of a vessel's actuators; raise CliError when there is none or it cannot be written."""
    from marine.allocation.of_vessel import FixedActuators

    try:
        fixed = FixedActuators(vessel, failed=failed)
    except ValueError as error:
        raise CliError(f"{vessel.name}: {error}") from None
    if len(fixed.actuators) < len(vessel.actuators):
        raise CliError(f"{vessel.name}: what a rudder can do depends on speed and propeller; no such plot")
    attainable, axes = fixed.allocation.attainable, fixed.axes
    charts = []
    for (i, first), (j, second) in itertools.combinations(enumerate(axes), 2):
        chart = Chart(vessel.name, _LABELS[first], _LABELS[second])
        chart.area(attainable.shadow(i, j), "whatever the others become")
        chart.area(attainable.section(i, j), "zero on the others")
        charts.append(chart)
    if not charts:
        raise CliError(f"{vessel.name}: only one axis is controlled; nothing to draw")
    write(path, charts)
