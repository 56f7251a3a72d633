"""The set of all wrenches within the limits of the actuators: a zonotope, as half-spaces and as polygons to draw."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from marine.allocation.geometry import Array

_NEGLIGIBLE = 1e-9
Polygon = list[tuple[float, float]]


class AttainableSet:
    """{B t : lower <= t <= upper} as normals @ tau <= offsets, for tau in the column space of B.

    Each facet of a zonotope is spanned by rank - 1 of its generators (the columns of B): its normal is what is
    perpendicular to them.
    """

    def __init__(self, B: Array, lower: Array, upper: Array) -> None:
        """B: m x n, tau = B t; lower <= 0 <= upper, n. Raise ValueError when no actuator acts."""
        self._B, self._lower, self._upper = B, lower, upper
        reach = np.abs(B) @ np.maximum(upper, -lower)
        if not np.any(reach > 0.0):
            raise ValueError("no actuator acts on any of the axes")
        self.reach = reach
        """Sum of what the actuators could do on each axis, m."""
        inverse = np.divide(1.0, reach, out=np.zeros(len(reach)), where=reach > 0.0)
        generators = inverse[:, None] * B
        left, sizes, _ = np.linalg.svd(generators)
        self.rank = int(np.sum(sizes > _NEGLIGIBLE * sizes[0]))
        """Dimension of the set."""
        basis = left[:, : self.rank]
        normals = _facet_normals(basis.T @ generators)
        self.normals: Array = normals @ basis.T * inverse
        """Outward normals of the facets, f x m."""
        pushes = self.normals @ B
        self.offsets: Array = np.where(pushes > 0.0, pushes * upper, pushes * lower).sum(axis=1)
        """normals @ tau <= offsets, f; never negative."""
        self._outside: Array = left[:, self.rank :].T * inverse  # times tau: zero in the column space

    def contains(self, tau: Array, tolerance: float = _NEGLIGIBLE) -> bool:
        """Return whether a wrench (m; N, Nm) can be had; tolerance relative to the reach."""
        sizes = np.linalg.norm(self.normals * self.reach, axis=1)
        inside = bool(np.all(self.normals @ tau <= self.offsets + tolerance * sizes))
        return inside and bool(np.all(np.abs(self._outside @ tau) <= tolerance))

    def scaled(self, tau: Sequence[float] | Array) -> float:
        """Return the largest factor in 0..1 with which a wrench can be had; what no actuator can do is left out."""
        pushes = self.normals @ tau
        over = pushes > self.offsets
        return float((self.offsets[over] / pushes[over]).min()) if over.any() else 1.0

    def section(self, first: int, second: int) -> Polygon:
        """Return the corners of the set on two axes (rows of B), zeros on all others, in order around the origin."""
        plane = [first, second]
        corners = _square(2.0 * max(self.reach[plane].max(), _NEGLIGIBLE))
        walls = [(*normal, offset) for normal, offset in zip(self.normals[:, plane], self.offsets, strict=True)]
        for row in self._outside[:, plane]:
            if np.abs(row).max() * self.reach.max() > _NEGLIGIBLE:
                walls += [(*row, 0.0), (*-row, 0.0)]
        for a, b, offset in walls:
            size = float(np.hypot(a, b))
            if size > 0.0:
                corners = _clip(corners, a / size, b / size, offset / size)
        return _without_repeats(corners)

    def shadow(self, first: int, second: int) -> Polygon:
        """Return the corners of the set's projection on two axes: the others may be whatever they become."""
        plane = self._B[[first, second]]
        corners = [
            tuple((plane @ np.where(normal @ plane > 0.0, self._upper, self._lower)).tolist())
            for normal in _around(plane)
        ]
        return _without_repeats(corners)


def _facet_normals(generators: Array) -> Array:
    """Return unit normals, both ways, of all hyperplanes through rank - 1 of the columns (rank x n)."""
    rank, n = generators.shape
    if rank == 1:
        return np.array([[1.0], [-1.0]])
    lengths = np.linalg.norm(generators, axis=0)
    unit = (generators / np.where(lengths > 0.0, lengths, 1.0)).T
    choices = np.array(list(itertools.combinations(range(n), rank - 1)))
    _, sizes, right = np.linalg.svd(unit[choices])
    normals = right[sizes[:, -1] > 1e-7, -1, :]
    largest = normals[np.arange(len(normals)), np.abs(normals).argmax(axis=1)]
    _, first = np.unique(np.round(normals * np.sign(largest)[:, None], 9), axis=0, return_index=True)
    return np.vstack([normals[first], -normals[first]])


def _around(plane: Array) -> Array:
    """Return one direction strictly inside the normal cone of every corner of a zonogon with these columns (2 x n)."""
    angles = np.arctan2(plane[1], plane[0])[np.abs(plane).max(axis=0) > 0.0]
    edges = np.unique(np.round(np.concatenate([angles, angles + np.pi]) + np.pi / 2.0, 9) % (2.0 * np.pi))
    middles = (edges + np.roll(edges, -1) + np.where(np.arange(len(edges)) == len(edges) - 1, 2.0 * np.pi, 0.0)) / 2.0
    return np.column_stack([np.cos(middles), np.sin(middles)])


def _square(half: float) -> Polygon:
    return [(half, -half), (half, half), (-half, half), (-half, -half)]


def _clip(corners: Polygon, a: float, b: float, offset: float) -> Polygon:
    """Return the part of a convex polygon with a x + b y <= offset (Sutherland and Hodgman)."""
    kept: Polygon = []
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        before, after = a * x0 + b * y0 - offset, a * x1 + b * y1 - offset
        if before <= 0.0:
            kept.append((x0, y0))
        if (before < 0.0 < after) or (after < 0.0 < before):
            part = before / (before - after)
            kept.append((x0 + part * (x1 - x0), y0 + part * (y1 - y0)))
    return kept


def _without_repeats(corners: Polygon) -> Polygon:
    size = max((max(abs(x), abs(y)) for x, y in corners), default=0.0)
    kept: Polygon = []
    for x, y in corners:
        if not kept or max(abs(x - kept[-1][0]), abs(y - kept[-1][1])) > 1e-7 * size:
            kept.append((x, y))
    if len(kept) > 1 and max(abs(kept[0][0] - kept[-1][0]), abs(kept[0][1] - kept[-1][1])) <= 1e-7 * size:
        kept.pop()
    return kept
