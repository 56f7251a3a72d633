"""What can go wrong with the cameras: kept by whoever plays the camera, from the orders on simulation/fault."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bus.messages import SimulationFault


@dataclass(frozen=True)
class CameraFaults:
    """Picture moved by so many pixels, black, lost (part of the frames, 0..1), or of a board before the lens.

    laser_lost: the forward camera sees no dots.
    """

    shift_px: tuple[float, float] = (0.0, 0.0)
    black: bool = False
    dropout: float = 0.0
    board: bool = False
    laser_lost: bool = False

    def after(self, order: SimulationFault) -> CameraFaults:
        """Return the faults after an order; one that does not concern the camera changes nothing."""
        match order.kind:
            case "camera_shift":
                return replace(self, shift_px=(order.x_px, order.y_px) if order.active else (0.0, 0.0))
            case "camera_black":
                return replace(self, black=order.active)
            case "dropout":
                return replace(self, dropout=order.fraction if order.active else 0.0)
            case "board" | "laser_lost" as kind:
                return replace(self, **{kind: order.active})  # type: ignore[arg-type]  # mypy takes it for any field
            case "clear":
                return CameraFaults()
        return self
