"""What the tracker is told: the picture source, the colours, and the vehicles as pairs of coloured patches."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bus.config import Section
from camera_tracker import marker

Channel = Annotated[int, Field(ge=0, le=255)]


class Colour(Section):
    """A colour as a box of channel values. In "bgr" it is thesis (3.10): one channel high, the others low.

    In "hsv" (OpenCV: hue 0..179 in steps of 2 degrees) a low hue above the high one runs over red: 170 ... 10.
    """

    space: Literal["bgr", "hsv"] = "bgr"
    low: tuple[Channel, Channel, Channel]
    high: tuple[Channel, Channel, Channel]


class Vehicle(Section):
    """A vehicle by its marker: two patches, or one asymmetric patch (thesis Algorithm 3.2) that is wider behind.

    The position is the middle between the patches, the heading goes from `rear` to `front`, plus `heading_deg`.
    """

    name: str = Field(max_length=64)
    front: str = Field(description="colour of the patch, of the front one if there are two")
    rear: str | None = Field(None, description="colour of the rear patch")
    spacing_px: float | None = Field(None, gt=0, description="distance between the patches; a pair off by 30 % is none")
    area_px2: float | None = Field(None, gt=0, description="size of each patch; other sizes lower the quality")
    heading_deg: float = Field(0.0, description="from the line rear - front to the vehicle's x axis, clockwise")


class Rectangle(Section):
    """A part of the picture, in px."""

    x: int = Field(ge=0)
    y: int = Field(ge=0)
    width: int = Field(gt=0)
    height: int = Field(gt=0)


class CameraTrackerConfig(Section):
    """Section [camera_tracker]. Without vehicles it looks for the marker of docs/camera-tracker.md."""

    source: str = Field("sim://", description="/dev/video0 or a number, video, folder, picture, sim://[DIRECTORY]")
    scale_px_per_m: float | None = Field(None, gt=0, description="None: the vessel file's")
    image_rate_hz: float = Field(5.0, ge=0, le=60, description="of camera/image; 0: none")
    colours: dict[str, Colour] = Field(default_factory=dict)
    vehicles: tuple[Vehicle, ...] = ()
    ignore: tuple[Rectangle, ...] = ()
    min_area_px2: float = Field(20.0, gt=0, description="smaller patches are noise")

    @model_validator(mode="after")
    def _known_colours(self) -> Self:
        for vehicle in self.vehicles:
            for colour in {vehicle.front, vehicle.rear} - {None, *self.colours}:
                known = ", ".join(self.colours) or "there are none"
                raise ValueError(f"vehicle {vehicle.name}: no such colour in colours: {colour} ({known})")
        names = [vehicle.name for vehicle in self.vehicles]
        if len(set(names)) < len(names):
            raise ValueError("two vehicles have the same name")
        return self

    def with_default_marker(self, name: str, scale_px_per_m: float | None) -> CameraTrackerConfig:
        """Return the configuration with our marker on a vessel called `name`, unless it has vehicles of its own.

        With a scale the marker's size is known, too, and pairs of patches that do not have it are refused.
        """
        if self.vehicles:
            return self
        vehicle = Vehicle(name=name, front="yellow", rear="red")
        if scale_px_per_m is not None:
            area_m2 = marker.PATCH_LENGTH_M * marker.PATCH_WIDTH_M
            size = {"spacing_px": marker.SPACING_M * scale_px_per_m, "area_px2": area_m2 * scale_px_per_m**2}
            vehicle = vehicle.model_copy(update=size)
        return self.model_copy(update={"colours": {**DEFAULT_COLOURS, **self.colours}, "vehicles": (vehicle,)})


DEFAULT_COLOURS = {
    "red": Colour(low=(0, 0, 110), high=(90, 80, 255)),
    "yellow": Colour(low=(0, 120, 120), high=(120, 255, 255)),
}
"""R and not B and not G (thesis (3.10)), and R and G and not B."""
