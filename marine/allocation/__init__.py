"""Control allocation: which command of each actuator gives a demanded wrench within the limits, thesis 2.2 and 8.1."""

from marine.allocation.attainable_set import AttainableSet
from marine.allocation.bounded import DEFAULT_PRIORITY, REGULARISATION, Allocation
from marine.allocation.geometry import Array, Wrench, allocation_matrix, axis_indices, rank
from marine.allocation.of_vessel import Answer, VesselAllocation, axis_limits, vessel_allocation
from marine.allocation.pseudo_inverse import scale_back, weighted_pseudo_inverse

__all__ = [
    "DEFAULT_PRIORITY",
    "REGULARISATION",
    "Allocation",
    "Answer",
    "Array",
    "AttainableSet",
    "VesselAllocation",
    "Wrench",
    "allocation_matrix",
    "axis_indices",
    "axis_limits",
    "rank",
    "scale_back",
    "vessel_allocation",
    "weighted_pseudo_inverse",
]
