"""What is asked of a USB camera: a picture whose brightness and sharpness do not change by themselves."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StringConstraints

from bus.config import Section


class CameraSettings(Section):
    """Section [camera_tracker.camera]. None leaves it to the camera; a value turns the automatic off."""

    exposure_ms: float | None = Field(
        None, gt=0, description="short enough that nothing blurs: 5 ms at 0.3 m/s is 1.5 mm"
    )
    gain: float | None = Field(None, description="in the camera's own units")
    focus: float | None = Field(None, description="in the camera's own units")
    white_balance_k: float | None = Field(None, gt=0, description="colour temperature in kelvin")
    pixel_format: Annotated[str, StringConstraints(min_length=4, max_length=4)] | None = Field(
        None, description="four letters: MJPG (fast), YUYV (not compressed)"
    )
    rate_hz: float | None = Field(None, gt=0)
    latency_ms: float = Field(0.0, description="from mid-exposure to the source's own stamp, taken off every stamp")
