"""Tables of the papers, re-typed: what `marine.identification.paper_check` computes again.

Source of all: N. Miskovic, "Use of self-oscillations in guidance and control of marine vessels", PhD thesis, Zagreb
2010 (`thesis`). Units are the thesis' own: C and N in 1e-2 Nm, angles in degrees, omega in rad/s, alpha_r in 1e-4 Nm
s^2/deg, beta_r in 1e-4 Nm s/deg, beta_rr in 1e-6 Nm s^2/deg^2. Corrections of the scan (shifted labels of groups,
swapped headers, a shifted last row): see docs/errata.md.
"""

from __future__ import annotations

from typing import NamedTuple


class IsoRow(NamedTuple):
    """One self-oscillation experiment in yaw: relay and oscillation, then what the thesis made of them."""

    C: float
    x_a: float
    """x_a*: hysteresis at which the relay really switched."""
    X_m: float
    omega: float
    x_0: float
    alpha: float
    beta: float
    beta_quadratic: float


TABLE_7_9 = (
    IsoRow(2.21, 10.29, 20.60, 1.47, 2.00, 4.26, 6.75, 26.17),
    IsoRow(3.96, 11.00, 26.17, 1.64, 1.17, 5.16, 8.10, 22.20),
    IsoRow(3.96, 16.84, 29.78, 1.52, 2.22, 4.52, 8.77, 22.89),
    IsoRow(3.96, 21.20, 35.25, 1.35, 1.25, 4.75, 8.38, 20.69),
    IsoRow(3.96, 41.07, 53.00, 0.95, 3.86, 4.87, 8.79, 20.52),
    IsoRow(8.34, 6.58, 26.36, 2.34, 3.80, 5.46, 11.27, 21.53),
    IsoRow(8.34, 12.21, 30.69, 1.95, 1.62, 6.29, 12.69, 24.92),
    IsoRow(8.34, 17.73, 36.57, 1.86, 2.86, 5.35, 12.01, 20.84),
    IsoRow(8.34, 22.37, 41.08, 1.71, 2.62, 5.38, 12.01, 20.21),
    IsoRow(8.34, 31.29, 47.17, 1.47, 1.50, 5.43, 13.02, 22.10),
    IsoRow(12.71, 22.42, 44.09, 1.91, 1.55, 6.09, 15.20, 21.21),
    IsoRow(17.09, 12.00, 38.67, 2.60, 2.33, 5.57, 16.03, 18.78),
    IsoRow(17.09, 17.83, 44.40, 2.38, 4.40, 5.38, 15.92, 17.72),
    IsoRow(17.09, 22.50, 47.33, 2.21, 2.67, 5.59, 16.77, 18.93),
    IsoRow(17.09, 34.00, 60.33, 1.79, 2.67, 6.46, 16.45, 17.94),
)
"""VideoRay, yaw. Reproduced with the delay correction (6.31) at T_d = 0.2 s."""

TABLE_7_9_DELAY_S = 0.2
TABLE_7_9_SIGMA_PERCENT = (11.46, 28.08, 11.22)
"""Spread of alpha_r, beta_r, beta_rr over the 15 rows."""

TABLE_7_11 = (
    IsoRow(3.40, 13.0, 23.8, 1.42, 0.0, 7.60, 7.01, 24.54),
    IsoRow(4.27, 11.2, 23.0, 1.68, 0.0, 7.32, 6.85, 20.90),
    IsoRow(4.27, 14.6, 27.0, 1.52, 0.0, 7.36, 7.18, 20.64),
    IsoRow(4.27, 16.8, 28.4, 1.45, 0.0, 7.30, 7.79, 22.22),
    IsoRow(4.27, 18.8, 31.2, 1.35, 0.0, 7.59, 7.76, 21.63),
    IsoRow(4.27, 20.4, 32.8, 1.31, 0.0, 7.58, 7.88, 21.62),
    IsoRow(4.27, 23.0, 34.6, 1.30, 0.0, 6.97, 8.05, 21.12),
    IsoRow(4.27, 25.0, 37.0, 1.21, 0.0, 7.37, 8.19, 21.50),
    IsoRow(4.27, 27.6, 39.4, 1.17, 0.0, 7.17, 8.25, 21.04),
    IsoRow(4.27, 28.4, 40.2, 1.13, 0.0, 7.55, 8.49, 22.09),
    IsoRow(4.27, 30.2, 41.8, 1.11, 0.0, 7.35, 8.50, 21.65),
    IsoRow(4.27, 32.8, 43.8, 1.07, 0.0, 7.21, 8.70, 21.91),
    IsoRow(4.27, 35.4, 47.0, 1.00, 0.0, 7.61, 8.71, 21.83),
    IsoRow(5.15, 12.8, 26.0, 1.78, 0.0, 6.89, 6.95, 17.65),
    IsoRow(5.15, 14.8, 28.4, 1.63, 0.0, 7.43, 7.39, 18.83),
    IsoRow(5.15, 17.6, 30.0, 1.52, 0.0, 7.61, 8.40, 21.64),
    IsoRow(5.15, 18.6, 30.2, 1.53, 0.0, 7.35, 8.76, 22.42),
    IsoRow(5.15, 20.4, 31.8, 1.45, 0.0, 7.54, 9.13, 23.37),
    IsoRow(5.15, 23.2, 34.6, 1.36, 0.0, 7.60, 9.34, 23.38),
    IsoRow(5.15, 25.0, 37.2, 1.25, 0.0, 8.39, 9.50, 24.13),
    IsoRow(5.15, 26.6, 40.2, 1.19, 0.0, 8.70, 9.10, 22.49),
    IsoRow(6.46, 14.8, 30.8, 1.59, 0.0, 9.21, 8.05, 19.30),
    IsoRow(6.46, 15.6, 32.6, 1.58, 0.0, 8.89, 7.65, 17.51),
    IsoRow(6.46, 16.8, 33.4, 1.55, 0.0, 8.89, 8.00, 18.24),
    IsoRow(6.46, 18.8, 34.8, 1.50, 0.0, 8.89, 8.54, 19.32),
    IsoRow(6.46, 21.0, 37.0, 1.43, 0.0, 8.89, 8.79, 19.52),
    IsoRow(6.46, 22.6, 37.6, 1.38, 0.0, 9.21, 9.54, 21.70),
    IsoRow(6.46, 24.4, 38.4, 1.34, 0.0, 9.18, 10.14, 23.16),
    IsoRow(6.46, 27.4, 42.2, 1.26, 0.0, 9.39, 10.07, 22.37),
    IsoRow(6.46, 29.0, 43.0, 1.24, 0.0, 9.16, 10.39, 22.92),
    IsoRow(6.46, 30.6, 44.6, 1.20, 0.0, 9.33, 10.55, 23.25),
    IsoRow(6.46, 33.8, 47.2, 1.14, 0.0, 9.39, 10.96, 24.04),
)
"""AutoMarine, yaw; no delay; the bias x_0 is not printed."""

TABLE_7_11_MEAN = (8.06, 8.58, 21.50)
TABLE_7_11_SIGMA_PERCENT = (10.66, 12.53, 8.55)
"""Mean and spread of alpha_r, beta_r, beta_rr over the 32 rows."""


class StepRow(NamedTuple):
    """One step response in yaw of AutoMarine, observed by compass (Type 1)."""

    N: float
    k_ss: float
    """Slope of the steady state, deg/s."""
    eps_v: float
    """Velocity error (4.48), deg; the thesis prints its absolute value."""
    beta: float
    beta_quadratic: float
    alpha: float


TABLE_7_10 = (
    StepRow(-5.15, -49.38, 27.93, 10.42, 21.11, 8.51),
    StepRow(-4.71, -44.93, 18.46, 10.48, 23.33, 6.21),
    StepRow(-4.27, -40.73, 18.12, 10.49, 25.75, 6.73),
    StepRow(-3.83, -39.71, 23.06, 9.66, 24.32, 8.09),
    StepRow(-3.40, -39.26, 23.28, 8.65, 22.04, 7.40),
    StepRow(-2.96, -35.72, 19.63, 8.29, 23.19, 6.57),
    StepRow(-2.52, -32.53, 20.85, 7.75, 23.83, 7.17),
    StepRow(-2.08, -28.29, 15.68, 7.37, 26.05, 5.89),
    StepRow(-1.65, -28.13, 22.87, 5.86, 20.82, 6.87),
    StepRow(-1.21, -27.49, 36.94, 4.40, 16.01, 8.53),
    StepRow(-0.77, -18.62, 29.38, 4.15, 22.26, 9.44),
    StepRow(-0.34, -10.96, 18.86, 3.05, 27.87, 7.58),
    StepRow(0.34, 13.32, 27.89, 2.51, 18.87, 7.59),
    StepRow(0.77, 19.96, 29.61, 3.87, 19.39, 8.28),
    StepRow(1.21, 23.72, 23.15, 5.10, 21.50, 7.18),
    StepRow(1.65, 27.71, 21.90, 5.95, 21.46, 6.78),
    StepRow(2.08, 28.38, 21.57, 7.35, 25.89, 8.05),
    StepRow(2.52, 31.35, 20.16, 8.05, 25.67, 7.46),
    StepRow(2.96, 37.64, 22.75, 7.86, 20.89, 6.86),
    StepRow(3.40, 38.99, 19.14, 8.71, 22.35, 6.17),
    StepRow(3.83, 41.77, 19.53, 9.18, 21.98, 6.19),
    StepRow(4.27, 41.84, 17.23, 10.21, 24.41, 6.07),
    StepRow(4.71, 46.18, 15.22, 10.20, 22.08, 4.85),
    StepRow(5.15, 50.54, 20.88, 10.18, 20.15, 6.07),
)
TABLE_7_10_MEAN = (7.11, 7.49, 22.55)
TABLE_7_10_SIGMA_PERCENT = (14.75, 34.00, 11.84)
"""Mean and spread of alpha_r, beta_r, beta_rr over the 24 rows."""


class Example(NamedTuple):
    """A simulated vessel of 7.1 with its two self-oscillation experiments."""

    table: str
    alpha: float
    beta: float
    beta_quadratic: float
    delta: float
    angle: bool
    """X_m and x_a are printed in degrees (the formulas take radians), otherwise in m."""
    runs: tuple[IsoRow, IsoRow]
    sigma_percent: tuple[float, float, float]
    sigma_factor: float
    """What the printed sigmas are times (7.1): see docs/errata.md."""


EXAMPLES = (
    Example(
        "7.2",
        80.0,
        300.0,
        10.0,
        0.0,
        True,
        (
            IsoRow(300.0, 10.0, 14.0, 3.722, 0.0, 78.97, 298.48, 385.66),
            IsoRow(300.0, 20.0, 24.4, 2.547, 0.0, 79.29, 288.3, 312.97),
        ),
        (0.29, 2.45, 14.71),
        2.0**0.5,
    ),
    Example(
        "7.4",
        130.0,
        200.0,
        20.0,
        10.0,
        False,
        (
            IsoRow(200.0, 0.5, 0.664, 1.405, 0.0, 127.79, 205.75, 259.94),
            IsoRow(100.0, 0.5, 0.594, 0.935, 0.0, 132.28, 192.86, 408.81),
        ),
        (1.73, 3.23, 22.26),
        1.0,
    ),
    Example(
        "7.6",
        1.018,
        0.0,
        1.257,
        0.0,
        True,
        (
            IsoRow(1.0, 20.0, 35.12, 1.32, 0.0, 0.98, 0.896, 1.305),
            IsoRow(0.8, 20.0, 35.32, 1.18, 0.0, 0.984, 0.795, 1.292),
        ),
        (0.2, 5.97, 0.5),
        1.0,
    ),
)
"""Tables 7.1 and 7.2 (Falcon, yaw), 7.3 and 7.4 (Falcon, heave), 7.5 and 7.6 (a yaw with linear drag)."""


class LeastSquaresTable(NamedTuple):
    """Least squares of VideoRay's yaw: rows of groups of equal N, group means, their mean and spread."""

    alpha: tuple[tuple[float, ...], ...]
    drag: tuple[tuple[float, ...], ...]
    alpha_means: tuple[float, ...]
    drag_means: tuple[float, ...]
    alpha_mean: float
    """Without the first group (marked with a dagger: quantisation is too coarse for its small moment)."""
    alpha_sigma_percent: float
    drag_mean: float
    drag_sigma_percent: float
    """Over all groups, in parts of `drag_mean`."""
    drag_mean_skips_first: bool


TABLE_7_7 = LeastSquaresTable(
    ((3.36,), (3.44, 3.17, 3.34, 2.07), (5.06, 5.87, 4.52, 5.36, 5.69), (7.27,), (7.26, 6.72, 7.41, 7.81)),
    (
        (8.66,),
        (12.93, 11.99, 11.76, 10.92),
        (18.29, 18.40, 16.77, 16.91, 16.82),
        (18.98,),
        (20.33, 20.11, 19.99, 20.01),
    ),
    (3.36, 3.01, 5.30, 7.27, 7.30),
    (8.66, 11.90, 17.44, 18.98, 20.11),
    5.72,
    35.60,
    15.42,
    31.91,
    False,
)
TABLE_7_8 = LeastSquaresTable(
    ((3.17,), (3.25, 3.21, 3.19, 2.30), (4.95, 5.57, 4.18, 4.78, 4.87), (6.53,), (6.56, 6.15, 6.66, 7.17)),
    (
        (23.53,),
        (31.12, 26.01, 27.20, 21.18),
        (28.61, 33.43, 25.62, 28.59, 28.58),
        (26.31,),
        (22.72, 22.22, 21.62, 22.04),
    ),
    (3.17, 2.99, 4.87, 6.53, 6.63),
    (23.53, 26.38, 28.97, 26.31, 22.15),
    5.26,
    32.60,
    25.95,
    10.29,
    True,
)


class CharlieRow(NamedTuple):
    """Least squares of Charlie's yaw at one thrust setting; N is the rudder angle in rad; drag made positive."""

    day: int
    n_squared: float
    alpha_linear: float
    beta: float
    error_linear: float
    """Mean absolute error of the yaw rate, 1e-3 rad/s."""
    alpha_nonlinear: float
    beta_quadratic: float
    error_nonlinear: float


TABLE_7_12 = (
    CharlieRow(1, 16.0, 11.09, 3.42, 16.02, 11.95, 35.58, 19.02),
    CharlieRow(1, 25.0, 8.55, 2.56, 16.54, 8.95, 22.14, 23.88),
    CharlieRow(1, 36.0, 7.51, 2.39, 17.30, 7.79, 20.08, 22.92),
    CharlieRow(1, 49.0, 7.89, 2.67, 17.10, 8.35, 24.41, 22.78),
    CharlieRow(1, 64.0, 7.92, 2.66, 17.48, 8.44, 22.89, 24.63),
    CharlieRow(2, 16.0, 10.50, 3.24, 11.40, 11.01, 34.28, 14.71),
    CharlieRow(2, 25.0, 8.96, 2.71, 13.96, 9.32, 23.47, 20.63),
    CharlieRow(2, 36.0, 8.89, 2.54, 21.36, 9.03, 21.01, 29.81),
    CharlieRow(2, 49.0, 10.42, 2.82, 23.15, 10.84, 24.53, 34.33),
    CharlieRow(2, 64.0, 9.47, 2.98, 19.14, 9.90, 24.10, 29.46),
)

TABLE_7_13 = ((20.0, 5.0), (15.0, 5.0), (10.0, 5.0), (30.0, 10.0))
"""Relays for the heading closed loop of Charlie, (C, x_a) in degrees; the oscillations are only drawn."""

DECISIONS_VIDEORAY = ((74, 9, 0), (63, 4, 16), (49, 0, 34), (30, 0, 53))
DECISIONS_AUTOMARINE = ((219, 128, 0), (73, 34, 240), (15, 3, 329), (3, 1, 343))
"""Pairs of Tables 7.9, 7.11 that decide for linear drag, for constant drag, not at all, by criteria 1 to 4 of 7.1."""
