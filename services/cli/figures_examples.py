"""Figures of the thesis' simulation examples: 6.1, 6.3 and 7.1 to 7.3."""

from __future__ import annotations

import numpy as np

from marine.identification import chapter_6
from marine.identification import paper_tables as printed
from marine.identification.model_choice import spread_percent
from marine.identification.paper_check import tables
from services.cli.figure_parts import Figure, bars, level
from services.cli.svg import Chart


def example_6_1() -> Figure:
    """Nyquist curves of the process and of what two experiments say of it."""
    a, b, oscillations = chapter_6.second_order()
    chart = Chart("Example 6.1: second-order process", "Re G", "Im G")
    omega = np.geomspace(0.05, 20.0, 200)
    true_b, true_a = chapter_6.SECOND_ORDER
    for label, top, bottom in (("process", true_b, true_a), ("from two experiments", b, a)):
        G = np.polyval(list(top)[::-1], 1j * omega) / np.polyval(list(bottom)[::-1], 1j * omega)
        chart.line(G.real.tolist(), G.imag.tolist(), label)
    at = 1j * np.array([o.omega for o in oscillations])
    G = np.polyval(list(true_b)[::-1], at) / np.polyval(list(true_a)[::-1], at)
    chart.points(G.real.tolist(), G.imag.tolist(), "the two oscillations")
    errors = ", ".join(
        f"{name} {100.0 * (found / true - 1.0):+.1f} %"
        for name, found, true in (("b0", b[0], true_b[0]), ("a1", a[1], true_a[1]), ("a2", a[2], true_a[2]))
    )
    caption = (
        "Matrix algorithm (6.16)-(6.19), n = 2, m = 0, on two simulated relay experiments, against the process itself. "
        f"The thesis gives no numbers for it: process and relays are chosen. Errors: {errors}."
    )
    return Figure((chart,), caption)


def figure_6_3() -> Figure:
    """Errors of K and T over the width of the relay, sampled at 0.1 s and at 0.01 s."""
    charts = []
    for dt_s, part in ((0.1, "a"), (0.01, "b")):
        for k, name in enumerate(("K", "T")):
            chart = Chart(f"6.3 {part}: {name}, sampled at {dt_s:g} s", "hysteresis x_a", f"error of {name}, %")
            rows = chapter_6.width_errors(dt_s)
            chart.points([w.x_a for w in rows], [w.as_set[k] for w in rows], "x_a as set")
            chart.points([w.switched for w in rows], [w.modified[k] for w in rows], "x_a* as switched (6.5)")
            charts.append(chart)
    caption = (
        "Simulated 50/(s (0.3 s + 1)) of Example 6.3: errors of the gain K and the time constant T by Table 6.3 with "
        "the hysteresis that was set, against those with the value at which the relay really switched (6.5)."
    )
    return Figure(tuple(charts), caption)


def example_7_1() -> Figure:
    """Falcon, yaw: constant drag dominates."""
    return _example(0, "Falcon yaw")


def example_7_2() -> Figure:
    """Falcon, heave: constant drag dominates."""
    return _example(1, "Falcon heave")


def example_7_3() -> Figure:
    """A yaw with linear drag only."""
    return _example(2, "yaw with linear drag")


def _example(index: int, vessel: str) -> Figure:
    example = printed.EXAMPLES[index]
    simulated = next(t for t in tables() if t.name == f"7.{int(example.table[2:]) - 1}")
    one, other = ((r.alpha, r.beta, r.beta_quadratic) for r in example.runs)
    chart = Chart(
        f"Example 7.{index + 1}: {vessel}", "1 alpha, 2 constant drag, 3 linear drag", "spread of two runs, %"
    )
    sigma = [example.sigma_factor * spread_percent(a, b) for a, b in zip(one, other, strict=True)]
    bars(chart, [0.85, 1.85, 2.85], sigma, f"from the parameters of Table {example.table}")
    bars(chart, [1.15, 2.15, 3.15], example.sigma_percent, "printed")
    curve = Chart("the oscillations", "X_m, degrees" if example.angle else "X_m, m", "omega, rad/s")
    ours, theirs = [r.ours for r in simulated.rows], [r.theirs for r in simulated.rows]
    curve.points([o[0] for o in ours], [o[1] for o in ours], "simulated")
    curve.points([o[0] for o in theirs], [o[1] for o in theirs], "printed")
    level(chart, 3.0, 0.0, "")
    better = "linear" if sigma[2] < sigma[1] else "constant"
    caption = (
        f"Two relay experiments on a simulated {vessel} (Table {simulated.name}): spread (7.1) of the three "
        f"parameters, ours against printed, and the oscillations themselves. The smaller spread decides for {better} "
        "drag."
    )
    return Figure((chart, curve), caption)
