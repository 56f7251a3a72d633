"""Allocation without limits, and the usual makeshift with them; thesis 8.1 (corrected: see docs/errata.md)."""

from __future__ import annotations

import numpy as np

from marine.allocation.geometry import Array


def weighted_pseudo_inverse(B: Array, cost: Array) -> Array:
    """Return P, n x m, of t = P tau: the smallest sum of cost_i t_i^2 that gives the wrench; the inverse of a square B.

    B: m x n, tau = B t. For a wide B that is W^-1 B^T (B W^-1 B^T)^-1, corrected from (Phi^T Phi)^-1 Phi^T of thesis
    8.1, and the least squares answer where B has less than full rank. cost: n, positive; raise ValueError otherwise.
    """
    if np.any(cost <= 0.0):
        raise ValueError("the cost of a thrust must be positive")
    root = 1.0 / np.sqrt(cost)
    return np.asarray(root[:, None] * np.linalg.pinv(B * root))


def scale_back(thrusts: Array, lower: Array, upper: Array) -> Array:
    """Return all thrusts made smaller by one factor until every limit is kept: the wrench keeps its direction.

    Simple, but it gives away what another distribution of the same wrench could still do: see `AttainableSet.scaled`.
    """
    limit = np.where(thrusts >= 0.0, upper, lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.where(thrusts != 0.0, limit / thrusts, np.inf)
    return np.asarray(thrusts * min(1.0, float(factors.min())))
