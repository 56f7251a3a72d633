"""Figures of thesis 7.5: Charlie's 120 experiments in simulation. The thesis prints least squares only (Table 7.12)."""

from __future__ import annotations

import numpy as np

from marine.identification import charlie_campaign, comparison
from marine.identification.campaigns import Trial
from marine.identification.charlie_campaign import DAYS, SAMPLE_S, SPEEDS
from services.cli.figure_parts import Figure, bars, level, numbers, pairs_chart
from services.cli.svg import Chart

_SIMULATED = "Simulated with the vessels of Table 7.12 and wind that is chosen; the thesis' own runs are not printed."


def wind(_: int) -> Figure:
    """Fig. 7.18: wind of both days."""
    chart = Chart("wind", "time, s", "wind speed, m/s")
    said = []
    for day in DAYS:
        speed = charlie_campaign.wind(day, 1, seed=day.number)[:, 0]
        chart.line((SAMPLE_S * np.arange(len(speed))).tolist(), speed.tolist(), f"day {day.number}")
        said.append(
            f"day {day.number}: {day.wind_m_s:g} +- {day.gust_m_s:g} m/s to {np.degrees(day.gamma_rad):.0f} deg"
        )
    return Figure((chart,), f"Wind during one simulated experiment of each day ({', '.join(said)}). {_SIMULATED}")


def margins(_: int) -> Figure:
    """Fig. 7.19: how near each relay is to the condition for self-oscillations."""
    charts = []
    for number in (1, 2):
        chart = Chart(f"day {number}", "relay output C, degrees of rudder", "(x_a* + |x_0|)/X_m")
        for x_a in charlie_campaign.X_A_DEG:
            of_width = [
                t for s in comparison.charlie(number).settings for t in s.trials if abs(np.degrees(t.x_a) - x_a) < 0.5
            ]
            chart.points([float(np.degrees(t.C)) for t in of_width], [t.margin for t in of_width], f"x_a {x_a:g} deg")
        chart.line([8.0, 27.0], [1.0, 1.0], "condition (7.12)")
        charts.append(chart)
    valid = [sum(len(s.trials) for s in comparison.charlie(n).settings) for n in (1, 2)]
    caption = (
        f"Condition (7.12) of each simulated experiment: {valid[0]} and {valid[1]} of 60 are valid (thesis: 60, 48). "
        "C = 10 degrees comes nearest to failing, where the thesis lost most of its experiments. " + _SIMULATED
    )
    return Figure(tuple(charts), caption)


def experiment(_: int) -> Figure:
    """Fig. 7.20: heading and rudder of one experiment."""
    trial = _example()
    heading, rudder = Chart("heading", "time, s", "psi, degrees"), Chart("rudder", "time, s", "delta, degrees")
    heading.line(trial.t_s.tolist(), np.degrees(trial.eta).tolist())
    ends = [trial.t_s[0], trial.t_s[-1]], [np.degrees(trial.eta[0]), np.degrees(trial.eta[-1])]
    heading.points(*ends, "begin and end")
    rudder.line(np.repeat(trial.t_s, 2)[1:].tolist(), np.repeat(np.degrees(trial.tau), 2)[:-1].tolist())
    caption = (
        f"One simulated experiment, C 25 and x_a 10 degrees, n^2 = 36, day 1: five oscillations take "
        f"{trial.t_s[-1]:.0f} s (about 80 s in the thesis, 8.1.5). {_SIMULATED}"
    )
    return Figure((heading, rudder), caption)


def path(_: int) -> Figure:
    """Fig. 7.21: path during one experiment."""
    trial = _example()
    x, y = (np.cumsum(f(trial.eta)) * SAMPLE_S for f in (np.cos, np.sin))
    chart = Chart("path", "to starboard of the first course, m", "along it, m")
    chart.line(y.tolist(), x.tolist())
    chart.points([y[0], y[-1]], [x[0], x[-1]], "begin and end")
    return Figure((chart,), f"Path during the experiment of Fig. 7.20 at 1 m/s (chosen), without drift. {_SIMULATED}")


def decisions(number: int) -> Figure:
    """Fig. 7.22, 7.23: which model pairs decide for."""
    found = comparison.charlie(number).decisions
    share = 100.0 * found[0][1] / sum(found[0])
    caption = (
        f"Day {number}: {sum(found[0])} pairs of experiments with different relay outputs that decide for constant "
        f"drag (correct), linear drag (false) or not at all. Criterion 1 is right in {share:.0f} % (thesis: about 90 "
        "%). "
    )
    return Figure((pairs_chart(f"Charlie, day {number}", found, right=1),), caption + _SIMULATED)


def drag(number: int) -> Figure:
    """Fig. 7.24, 7.25: errors of drag against least squares."""
    errors = comparison.charlie(number).drag_percent
    limit = {1: 22.0, 2: 15.0}[number]
    chart = Chart(f"Charlie, day {number}", "experiment", "difference of drag (7.15), %")
    bars(chart, numbers(errors), errors, "self-oscillation", width=0.7)
    level(chart, len(errors), limit, f"largest in the thesis: {limit:g} %")
    caption = (
        f"Drag by Table 6.3 of each experiment of day {number} against the mean of least squares at its thrust; "
        f"largest {max(errors):.1f} %. {_SIMULATED}"
    )
    return Figure((chart,), caption)


def time_constant(number: int) -> Figure:
    """Fig. 7.27, 7.28: differences of time constants in samples."""
    samples = comparison.charlie(number).time_constant_samples
    chart = Chart(f"Charlie, day {number}", "experiment", "difference of T_L (7.9), samples")
    bars(chart, numbers(samples), samples, "self-oscillation", width=0.7)
    level(chart, len(samples), 3.0, "largest in the thesis: 3")
    caption = (
        f"Time constants of day {number} against least squares, in samples of {SAMPLE_S:g} s; largest "
        f"{max(samples):.2f}. "
    )
    return Figure((chart,), caption + _SIMULATED)


def drag_shares(_: int) -> Figure:
    """Fig. 7.26: shares of experiments by error of drag."""
    return _shares(
        "difference of drag, up to %", [5.0, 10.0, 15.0, 20.0, 25.0], "drag_percent", "Drag below 15 %", 15.0
    )


def time_constant_shares(_: int) -> Figure:
    """Fig. 7.29: shares of experiments by difference of time constants."""
    steps = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    return _shares("difference of T_L, up to samples", steps, "time_constant_samples", "T_L within 2 samples", 2.0)


def prediction(number: int) -> Figure:
    """Fig. 7.30, 7.31: sums of absolute errors against least squares."""
    chart = Chart(f"Charlie, day {number}", "experiment at its thrust", "J against least squares (7.16), %")
    every = comparison.charlie(number).prediction_errors
    for n_squared, errors in zip(SPEEDS, every, strict=True):
        chart.points(numbers(errors), [100.0 * x for x in errors], f"n^2 = {n_squared:g}")
    worse = sum(x > 0.0 for errors in every for x in errors)
    caption = (
        f"Mean absolute error of the rate of turn by the models of single experiments of day {number}, against that of "
        f"least squares at the same thrust: {worse} of {sum(map(len, every))} are somewhat worse, as in the thesis. "
    )
    return Figure((chart,), caption + _SIMULATED)


def _shares(label: str, limits: list[float], name: str, said: str, bound: float) -> Figure:
    chart = Chart("Charlie", label, "share of experiments, %")
    below = []
    for number in (1, 2):
        values = np.array(getattr(comparison.charlie(number), name))
        chart.line(limits, [100.0 * float(np.mean(values <= x)) for x in limits], f"day {number}")
        below.append(100.0 * float(np.mean(values <= bound)))
    caption = (
        f"Share of experiments by their difference from least squares. {said}: {below[0]:.0f} % on day 1, "
        f"{below[1]:.0f} % on day 2 (thesis: more than 90 %). {_SIMULATED}"
    )
    return Figure((chart,), caption)


def _example() -> Trial:
    trials = comparison.charlie(1).settings[2].trials
    return next(t for t in trials if abs(np.degrees(t.C) - 25.0) < 0.5 and abs(np.degrees(t.x_a) - 10.0) < 0.5)
