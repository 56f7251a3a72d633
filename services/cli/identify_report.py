"""What `starboard identify` shows: lines for the terminal, one JSON document, a self-contained HTML report."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from services.cli.errors import CliError

if TYPE_CHECKING:
    from marine.identification.record import Record
    from marine.identification.result import IdentificationError, Identified

_TWO_SIDED_95 = 1.96
_SHOWN = 800


def document(found: Identified, told: str, error: float) -> dict[str, Any]:
    """Return a result as JSON; `mean_absolute_error` is (7.3) of the simulated against the measured velocity."""
    return {
        "method": found.method,
        "model": found.model,
        "data": told,
        "parameters": [
            {"name": p.name, "value": p.value, "std": p.std if math.isfinite(p.std) else None, "unit": p.unit}
            for p in found.parameters
        ],
        "mean_absolute_error": error,
        "residual_rms": found.residual_rms if math.isfinite(found.residual_rms) else None,
        "residual_unit": found.residual_unit,
        "warnings": list(found.warnings),
        "citation": found.citation,
    }


def lines(found: Identified, told: str, error: float) -> list[str]:
    """Return a result as text."""
    unit = "m/s" if found.parameters[0].unit == "kg" else "rad/s"
    out = [told, f"{found.method}, {found.model}, {found.citation}"]
    for p in found.parameters:
        std = f"+- {p.std:.2g}" if math.isfinite(p.std) else ""
        out.append(f"  {p.name:15} {p.value:12.6g} {std:>10} {p.unit}")
    out.append(f"  simulated against measured velocity: mean absolute error {error:.3g} {unit}")
    return out + [f"  warning: {w}" for w in found.warnings]


def model_error(record: Record, found: Identified) -> float:
    """Return the mean absolute error of the simulated velocity, (7.3)."""
    from marine.identification.record import response, velocity
    from marine.identification.validation import mean_absolute_error

    return mean_absolute_error(response(record, found)[1], velocity(record))


def write_report(
    path: Path,
    record: Record,
    found: Identified,
    compared: list[tuple[str, Identified | IdentificationError]],
    told: str,
) -> None:
    """Write the report; raise CliError when the file cannot be written."""
    try:
        path.write_text(_html(record, found, compared, told), encoding="utf-8")
    except OSError as error:
        raise CliError(f"{path}: cannot be written: {error.strerror}") from None


def _html(
    record: Record, found: Identified, compared: list[tuple[str, Identified | IdentificationError]], told: str
) -> str:
    rows = "".join(
        f"<tr><td>{escape(p.name)}<td>{p.value:.6g}<td>{_interval(p.value, p.std)}<td>{escape(p.unit)}"
        for p in found.parameters
    )
    warnings = "".join(f"<li>{escape(w)}" for w in found.warnings)
    return (
        "<!doctype html><html lang=en><meta charset=utf-8><title>Identification</title><style>"
        "body{font:15px system-ui,sans-serif;margin:2em auto;max-width:960px}td,th{padding:.2em 1em;text-align:left;"
        "border-bottom:1px solid #ddd}table{border-collapse:collapse}li{color:#a33}</style>"
        f"<h1>{escape(found.method)}: {escape(found.model)}</h1><p>{escape(told)}<p>{escape(found.citation)}"
        f"<table><tr><th>parameter<th>value<th>95 % interval<th>unit{rows}</table><ul>{warnings}</ul>"
        f"{_charts(record, found)}"
        "<h2>Methods on the same data</h2><p>Error: mean absolute difference of simulated and measured velocity (7.3)."
        f"<table><tr><th>method<th>alpha<th>beta<th>beta_quadratic<th>delta<th>error{_comparison(record, compared)}"
        "</table></html>"
    )


def _interval(value: float, std: float) -> str:
    if not math.isfinite(std):
        return "one experiment cannot tell"
    return f"{value - _TWO_SIDED_95 * std:.6g} ... {value + _TWO_SIDED_95 * std:.6g}"


def _comparison(record: Record, compared: list[tuple[str, Identified | IdentificationError]]) -> str:
    from marine.identification.result import Identified

    rows = []
    for name, one in compared:
        if isinstance(one, Identified):
            values = {p.name: f"{p.value:.5g}" for p in one.parameters}
            cells = [values.get(n, "") for n in ("alpha", "beta", "beta_quadratic", "delta")]
            rows.append(f"<tr><td>{escape(one.method)}<td>{'<td>'.join(cells)}<td>{model_error(record, one):.3g}")
        else:
            rows.append(f"<tr><td>{escape(name)}<td colspan=5>{escape(str(one))}")
    return "".join(rows)


def _charts(record: Record, found: Identified) -> str:
    from marine.identification.record import response, velocity
    from services.cli.svg import Chart

    eta, nu = response(record, found)
    length, force = ("rad", "Nm") if record.axis == "angular" else ("m", "N")
    shown = slice(None, None, max(1, len(record.t_s) // _SHOWN))
    t = record.t_s[shown].tolist()
    measured = velocity(record)
    charts = [
        Chart("Response", "time, s", f"eta, {length}"),
        Chart("Velocity", "time, s", f"nu, {length}/s"),
        Chart("Residual", "time, s", f"measured less simulated, {length}/s"),
        Chart("Force", "time, s", f"tau, {force}"),
    ]
    charts[0].line(t, record.eta[shown].tolist(), "measured")
    charts[0].line(t, eta[shown].tolist(), "simulated")
    charts[1].line(t, measured[shown].tolist(), "measured")
    charts[1].line(t, nu[shown].tolist(), "simulated")
    charts[2].line(t, (measured - nu)[shown].tolist())
    charts[3].line(t, record.tau[shown].tolist(), "delivered")
    frame = '<svg xmlns="http://www.w3.org/2000/svg" width="460" height="360" font-family="sans-serif" font-size="12">'
    return "".join(f"{frame}{chart.svg()}</svg>" for chart in charts)
