"""Self-oscillation models against a conventional reference, as thesis 7.3.3, 7.4.3 and 7.5.3 compare them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from marine.identification import campaigns
from marine.identification import paper_tables as printed
from marine.identification.campaigns import ALPHA_R, BETA_R, BETA_RR, Trial, Values
from marine.identification.charlie_campaign import SAMPLE_S, Setting, settings
from marine.identification.model_choice import CRITERIA, count
from marine.identification.validation import (
    drag_difference_percent,
    model_of,
    steady_state_difference,
    time_constant_difference,
    time_constant_difference_linear,
)
from marine.vessel import DegreeOfFreedom

Vehicle = Literal["VideoRay", "AutoMarine"]


@dataclass(frozen=True)
class Comparison:
    """Models of single experiments beside the reference model; drag of one form in both.

    label: where the numbers come from ("printed" or "simulated"); C: relay output of each experiment; values: all three
    parameters of each, for the choice of the model.
    """

    label: str
    reference: DegreeOfFreedom
    C: tuple[float, ...]
    values: tuple[Values, ...]

    @property
    def models(self) -> list[DegreeOfFreedom]:
        """The model of each experiment, with the reference's form of drag."""
        if self.reference.beta:
            return [DegreeOfFreedom(v["alpha"], v["beta"], 0.0) for v in self.values]
        return [DegreeOfFreedom(v["alpha"], 0.0, v["beta_quadratic"]) for v in self.values]

    @property
    def decisions(self) -> list[tuple[int, int, int]]:
        """Pairs that decide for linear drag, constant drag, not at all, for criteria 1 to 4 of 7.1."""
        experiments = list(zip(self.C, self.values, strict=True))
        return [count(experiments, criterion) for criterion in CRITERIA]

    @property
    def alpha_percent(self) -> list[float]:
        """Differences of inertia in % of the reference (Fig. 7.4, 7.12)."""
        return [drag_difference_percent(m.alpha, self.reference.alpha) for m in self.models]

    @property
    def drag_percent(self) -> list[float]:
        """Differences of drag in % of the reference, (7.15) (Fig. 7.5, 7.13, 7.24, 7.25)."""
        if self.reference.beta:
            return [drag_difference_percent(m.beta, self.reference.beta) for m in self.models]
        return [drag_difference_percent(m.beta_quadratic, self.reference.beta_quadratic) for m in self.models]

    @property
    def steady_state_rad_s(self) -> list[float]:
        """Differences of the final rate, (7.7), at the largest C used (Fig. 7.6, 7.14)."""
        beta = self.reference.beta_quadratic
        return [steady_state_difference(m.beta_quadratic, beta, max(self.C)) for m in self.models]

    @property
    def time_constant_s(self) -> list[float]:
        """Differences of T_L (7.9), or of T_N (7.11) at the smallest C used (Fig. 7.7, 7.15, 7.27, 7.28)."""
        r = self.reference
        if r.beta:
            one = (r.alpha, r.beta)
            return [time_constant_difference_linear((m.alpha, m.beta), one) for m in self.models]
        one = (r.alpha, r.beta_quadratic)
        return [time_constant_difference((m.alpha, m.beta_quadratic), one, min(self.C)) for m in self.models]


def of_trials(label: str, reference: DegreeOfFreedom, trials: Sequence[Trial]) -> Comparison:
    """Return the comparison of simulated experiments with a reference."""
    return Comparison(label, reference, tuple(t.C for t in trials), tuple(t.found for t in trials))


def of_table(reference: DegreeOfFreedom, rows: Sequence[printed.IsoRow]) -> Comparison:
    """Return the comparison of a printed table of experiments with a reference."""
    values = tuple(
        {"alpha": r.alpha * ALPHA_R, "beta": r.beta * BETA_R, "beta_quadratic": r.beta_quadratic * BETA_RR}
        for r in rows
    )
    return Comparison("printed", reference, tuple(1e-2 * r.C for r in rows), values)


@cache
def of_vehicle(vehicle: Vehicle) -> tuple[Comparison, Comparison]:
    """Return (printed, simulated): Tables 7.9 against 7.8 (least squares), or 7.11 against 7.10 (step responses).

    As in the thesis, the mean of VideoRay's least squares leaves out the smallest moment.
    """
    if vehicle == "VideoRay":
        trials = campaigns.videoray()
        squares = campaigns.least_squares_mean(trials, "linear", skip=min(t.C for t in trials))
        return of_table(campaigns.VIDEORAY, printed.TABLE_7_9), of_trials("simulated", squares, trials)
    steps = campaigns.automarine_steps()
    mean = DegreeOfFreedom(
        float(np.mean([s.alpha for s in steps])), 0.0, float(np.mean([s.beta_quadratic for s in steps]))
    )
    return of_table(campaigns.AUTOMARINE, printed.TABLE_7_11), of_trials("simulated", mean, campaigns.automarine())


@cache
def prediction_errors(vehicle: Vehicle) -> tuple[list[float], list[float]]:
    """Return (7.13), (7.14) of each simulated experiment against the reference (Fig. 7.8, 7.17).

    First of the models of Table 6.3, then of those by projection, which the thesis has not.
    """
    _, simulated = of_vehicle(vehicle)
    if vehicle == "VideoRay":
        trials, sets = campaigns.videoray(), campaigns.validations(campaigns.videoray(), printed.TABLE_7_9_DELAY_S)
    else:
        trials, sets = campaigns.automarine(), list(campaigns.automarine_validation())
    ours = [model_of(t.projected["linear"]) for t in trials]
    return (
        campaigns.relative_errors(simulated.models, simulated.reference, sets),
        campaigns.relative_errors(ours, simulated.reference, sets),
    )


@dataclass(frozen=True)
class CharlieDay:
    """One day of Charlie: a comparison with least squares (constant drag) for each thrust."""

    number: int
    settings: tuple[Setting, ...]
    comparisons: tuple[Comparison, ...]

    @property
    def decisions(self) -> list[tuple[int, int, int]]:
        """Decisions over all pairs of the day with different relay outputs (Fig. 7.22, 7.23)."""
        experiments = [pair for s in self.settings for pair in campaigns.experiments(s.trials)]
        return [count(experiments, criterion) for criterion in CRITERIA]

    @property
    def drag_percent(self) -> list[float]:
        """(7.15) of all experiments of the day."""
        return [x for c in self.comparisons for x in c.drag_percent]

    @property
    def time_constant_samples(self) -> list[float]:
        """(7.9) of all experiments of the day, in samples of 0.5 s."""
        return [x / SAMPLE_S for c in self.comparisons for x in c.time_constant_s]

    @property
    def prediction_errors(self) -> list[list[float]]:
        """(7.16) of the experiments at each thrust, on the records of that thrust (Fig. 7.30, 7.31)."""
        return [
            campaigns.relative_errors(c.models, c.reference, campaigns.validations(s.trials))
            for s, c in zip(self.settings, self.comparisons, strict=True)
        ]


@cache
def charlie(number: int) -> CharlieDay:
    """Return day 1 (windy) or day 2 of the simulated campaign."""
    of_day = tuple(s for s in settings() if s.day.number == number)
    comparisons = tuple(
        of_trials("simulated", campaigns.least_squares_mean(s.trials, "constant"), s.trials) for s in of_day
    )
    return CharlieDay(number, of_day, comparisons)
