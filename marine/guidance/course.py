"""A path by its arc length: place, direction and curvature; straight legs with rounded corners, or a spline."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marine.frames import to_body
from marine.guidance.path import Path, Point

Array = NDArray[np.float64]

SPACING_M = 0.005
FEWEST, MOST = 200, 4000
"""Samples of a course: every SPACING_M, within these numbers."""
_PER_LEG = 200
_HALF_TURN = math.radians(179.0)
"""From here on a corner is a reversal: there is no arc to round it."""


class Course:
    """x, y in m, gamma in rad (continuous, not wrapped), kappa in 1/m: lists over s_m, evenly spaced from 0.

    ends_m: arc length at each way-point.
    """

    def __init__(self, s: Array, x: Array, y: Array, gamma: Array, kappa: Array, ends_m: list[float]) -> None:  # noqa: PLR0917
        self.length_m = float(s[-1])
        self.ends_m = ends_m
        self.kappa: Array = kappa
        self.step_m = self.length_m / (len(s) - 1)
        self._x, self._y = x, y
        self._rows: list[tuple[float, float, float, float]] = list(
            zip(x.tolist(), y.tolist(), gamma.tolist(), kappa.tolist(), strict=True)
        )

    @property
    def places(self) -> Array:
        """Places along the course, n x 2, m."""
        return np.column_stack([self._x, self._y])

    def at(self, s_m: float) -> tuple[float, float, float, float]:
        """Return (x, y, gamma, kappa) at an arc length, which is cut to the course."""
        place = max(0.0, min(1.0, s_m / self.length_m)) * (len(self._rows) - 1)
        i = min(int(place), len(self._rows) - 2)
        part = place - i
        x, y, gamma, kappa = (a + part * (b - a) for a, b in zip(self._rows[i], self._rows[i + 1], strict=True))
        return x, y, gamma, kappa

    def leg(self, s_m: float) -> int:
        """Return the leg at an arc length: from way-point leg to the next."""
        return min(sum(s_m >= end for end in self.ends_m[1:-1]), len(self.ends_m) - 2)

    def nearest(self, x_m: float, y_m: float, from_m: float, to_m: float) -> float:
        """Return the arc length of the point between two arc lengths that is nearest to a place."""
        first = max(0, int(from_m / self.step_m))
        last = min(len(self._rows), max(first + 1, math.ceil(to_m / self.step_m) + 1))
        distance2 = (self._x[first:last] - x_m) ** 2 + (self._y[first:last] - y_m) ** 2
        s = (first + int(distance2.argmin())) * self.step_m
        x, y, gamma, _ = self.at(s)
        ahead = to_body(x_m - x, y_m - y, gamma)[0]
        return max(from_m, min(to_m, s + max(-self.step_m, min(self.step_m, ahead))))


def straight(points: Sequence[Point], corner_m: float) -> Course:
    """Return straight legs whose corners are rounded by arcs that miss them by corner_m at most.

    An arc takes half of the shorter leg at most; a reversal stays a corner of infinite curvature. Raise ValueError for
    what `Path` refuses.
    """
    path = Path(points, 0.0)
    gammas = [path.lines[0].gamma_rad]
    for line in path.lines[1:]:
        gammas.append(gammas[-1] + math.remainder(line.gamma_rad - gammas[-1], math.tau))
    pieces: list[tuple[float, float, float, float, float]] = []  # length, x, y, gamma at the beginning, kappa
    ends, s, cut = [0.0], 0.0, 0.0
    for i, (line, length) in enumerate(zip(path.lines, path.lengths, strict=True)):
        turn = gammas[i + 1] - gammas[i] if i + 1 < len(gammas) else 0.0
        radius, tangent = _arc(turn, corner_m, 0.5 * min(length, path.lengths[i + 1])) if turn else (0.0, 0.0)
        x, y = line.at(cut)
        pieces.append((length - cut - tangent, x, y, gammas[i], 0.0))
        s += pieces[-1][0]
        if turn:
            arc = radius * abs(turn)
            x, y = line.at(length - tangent)
            pieces.append((max(arc, 1e-9), x, y, gammas[i], turn / max(arc, 1e-9)))
            s += pieces[-1][0]
        ends.append(s - (0.5 * pieces[-1][0] if turn else 0.0))
        cut = tangent
    return _sampled(pieces, s, ends)


def spline(points: Sequence[Point]) -> Course:
    """Return the natural cubic spline through way-points, its parameter the length of the chords.

    Raise ValueError for what `Path` refuses, and for a spline that crosses itself or turns back on its track.
    """
    Path(points, 0.0)
    P = np.array(points)
    h = np.hypot(*np.diff(P, axis=0).T)
    t = np.concatenate([[0.0], np.cumsum(h)])
    M = _second_derivatives(P, h)
    k = np.repeat(np.arange(len(h)), _PER_LEG)
    part = np.concatenate([np.tile(np.arange(_PER_LEG) / _PER_LEG, len(h)), [1.0]])
    k = np.append(k, len(h) - 1)
    step, a, b = h[k, None], 1.0 - part[:, None], part[:, None]
    place = a * P[k] + b * P[k + 1] + ((a**3 - a) * M[k] + (b**3 - b) * M[k + 1]) * step**2 / 6.0
    d1 = (P[k + 1] - P[k]) / step + ((3.0 * b**2 - 1.0) * M[k + 1] - (3.0 * a**2 - 1.0) * M[k]) * step / 6.0
    d2 = a * M[k] + b * M[k + 1]
    if bool(np.any((d1[2:] * d1[:-2]).sum(axis=1) <= 0.0)):  # by a right angle and more within 1/100 of a leg
        raise ValueError("the smooth path turns back on its own track: move a way-point aside, or take straight legs")
    speed = np.hypot(d1[:, 0], d1[:, 1])
    kappa = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
    gamma = np.unwrap(np.arctan2(d1[:, 1], d1[:, 0]))
    parameter = t[k] + part * h[k]
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(parameter))])
    s = np.linspace(0.0, way[-1], _count(float(way[-1])))
    x, y, gamma, kappa = (np.interp(s, way, values) for values in (place[:, 0], place[:, 1], gamma, kappa))
    if _crosses(x, y):
        raise ValueError("the smooth path crosses itself: move its way-points apart, or take straight legs")
    return Course(s, x, y, gamma, kappa, np.append(way[::_PER_LEG][: len(h)], way[-1]).tolist())


def _second_derivatives(P: Array, h: Array) -> Array:
    """Return the second derivatives at the knots, zero at both ends: the tridiagonal system of cubic splines."""
    n = len(P)
    A, right = np.eye(n), np.zeros((n, 2))
    slopes = np.diff(P, axis=0) / h[:, None]
    for i in range(1, n - 1):
        A[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = 6.0 * (slopes[i] - slopes[i - 1])
    return np.asarray(np.linalg.solve(A, right), dtype=np.float64)


def _arc(turn: float, corner_m: float, most_m: float) -> tuple[float, float]:
    """Return (radius, tangent length) of the arc that rounds a corner."""
    if abs(turn) > _HALF_TURN:
        return 0.0, 0.0
    half = 0.5 * abs(turn)
    radius = corner_m * math.cos(half) / (1.0 - math.cos(half))
    tangent = min(most_m, radius * math.tan(half))
    return tangent / math.tan(half), tangent


def _sampled(pieces: list[tuple[float, float, float, float, float]], length: float, ends: list[float]) -> Course:
    begins = np.cumsum([0.0, *(piece[0] for piece in pieces[:-1])])
    s = np.linspace(0.0, length, _count(length))
    which = np.searchsorted(begins, s, side="right") - 1
    _, x0, y0, gamma0, kappa = (np.array(column)[which] for column in zip(*pieces, strict=True))
    along = s - begins[which]
    gamma = gamma0 + kappa * along
    bent = np.where(np.abs(kappa) > 1e-12, kappa, 1.0)
    straight_on = np.abs(kappa) <= 1e-12
    x = x0 + np.where(straight_on, along * np.cos(gamma0), (np.sin(gamma) - np.sin(gamma0)) / bent)
    y = y0 + np.where(straight_on, along * np.sin(gamma0), (np.cos(gamma0) - np.cos(gamma)) / bent)
    sharpest = np.zeros(len(s))  # of all pieces in a sample's reach: an arc may be shorter than a sample
    for begin, piece in zip(begins, pieces, strict=True):
        near = slice(max(0, int(begin / length * (len(s) - 1))), int((begin + piece[0]) / length * (len(s) - 1)) + 2)
        sharpest[near] = np.where(np.abs(sharpest[near]) >= abs(piece[4]), sharpest[near], piece[4])
    return Course(s, x, y, gamma, sharpest, ends)


def _count(length_m: float) -> int:
    return max(FEWEST, min(MOST, round(length_m / SPACING_M))) + 1


def _crosses(x: Array, y: Array) -> bool:
    """Whether a curve meets itself, seen at 300 points of it."""
    every = max(1, len(x) // 300)
    P = np.column_stack([np.append(x[::every], x[-1]), np.append(y[::every], y[-1])])
    P = P[np.append(True, np.hypot(*np.diff(P, axis=0).T) > 1e-9)]
    A, d = P[:-1], np.diff(P, axis=0)

    def side(i: int, points: Array) -> Array:
        return np.asarray(d[i, 0] * (points[:, 1] - A[i, 1]) - d[i, 1] * (points[:, 0] - A[i, 0]))

    for i in range(len(d) - 2):
        others = slice(i + 2, len(d))
        first, second = side(i, A[others]), side(i, A[others] + d[others])
        back = A[i] - A[others], A[i] + d[i] - A[others]
        third, fourth = (d[others][:, 0] * b[:, 1] - d[others][:, 1] * b[:, 0] for b in back)
        if bool(np.any((first * second < 0.0) & (third * fourth < 0.0))):
            return True
    return False
