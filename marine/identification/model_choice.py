"""Which form of drag a vessel has, from two self-oscillation experiments: thesis 7.1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

Choice = Literal["linear drag", "constant drag", "no decision"]
CRITERIA: tuple[Literal[1, 2, 3, 4], ...] = (1, 2, 3, 4)


def spread_percent(a: float, b: float) -> float:
    """Return sigma% of two estimates of one parameter, (7.1)."""
    return 100.0 * abs((a - b) / (a + b))


def choose(one: Mapping[str, float], other: Mapping[str, float], criterion: int = 2) -> Choice:
    """Return the form of drag whose estimates agree better, (7.2).

    one, other: `alpha`, `beta`, `beta_quadratic` of two experiments with different relays (`marine_parameters`).
    criterion: 1: lambda = 0; 2: lambda = sigma_alpha; 3, 4: that plus 5 or 10 %: more caution, fewer decisions.
    """
    sigma = {name: spread_percent(one[name], other[name]) for name in ("alpha", "beta", "beta_quadratic")}
    margin = {1: 0.0, 2: sigma["alpha"], 3: sigma["alpha"] + 5.0, 4: sigma["alpha"] + 10.0}[criterion]
    difference = sigma["beta"] - sigma["beta_quadratic"]
    if difference > margin:
        return "linear drag"
    return "constant drag" if difference < -margin else "no decision"


def count(experiments: Sequence[tuple[float, Mapping[str, float]]], criterion: int) -> tuple[int, int, int]:
    """Return how many pairs with different relay output decide for linear drag, constant drag, not at all (Fig. 7.3).

    experiments: (C, parameters) of each.
    """
    choices = [choose(a, b, criterion) for (C_a, a), (C_b, b) in combinations(experiments, 2) if C_a != C_b]
    return choices.count("linear drag"), choices.count("constant drag"), choices.count("no decision")
