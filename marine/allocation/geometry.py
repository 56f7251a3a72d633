"""The allocation matrix from where actuators sit and where they push, thesis 2.2 (corrected: see docs/errata.md).

The yaw row printed in pladypos (2) and Table 2.2(c) is singular, so no matrix is typed in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marine.vessel import AXES, Actuator, Axis, BilinearThrust, Thruster

Array = NDArray[np.float64]
Wrench = tuple[float, float, float, float, float, float]


def allocation_matrix(actuators: Sequence[Actuator]) -> Array:
    """Return B, 6 x n, of tau = B t: what one newton of each actuator gives on [X Y Z K M N].

    In the plane column i is [cos g, sin g, x sin g - y cos g] for thrust at angle g. The torque of a propeller about
    its own axis is in it as Q_nn / T_nn of thesis (2.4), with the sign of its spin (Fig. 2.4).
    """
    B = np.array([a.column for a in actuators], dtype=float).reshape(-1, len(AXES)).T
    for i, actuator in enumerate(actuators):
        if isinstance(actuator, Thruster) and isinstance(actuator.characteristic, BilinearThrust):
            propeller = actuator.characteristic
            B[3:, i] += propeller.spin * propeller.q_nn / propeller.t_nn * B[:3, i]
    return B


def axis_indices(axes: Sequence[Axis]) -> tuple[int, ...]:
    """Return the rows of the allocation matrix that belong to components of the wrench."""
    return tuple(AXES.index(axis) for axis in axes)


def rank(B: Array) -> int:
    """Return how many degrees of freedom the columns of B can control independently; rows relative to their size."""
    sizes = np.abs(B).max(axis=1, initial=0.0)
    rows = B[sizes > 1e-9 * sizes.max(initial=0.0)] if B.size else B
    if not rows.size:
        return 0
    return int(np.linalg.matrix_rank(rows / np.abs(rows).max(axis=1, keepdims=True), tol=1e-9))
