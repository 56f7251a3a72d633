"""What the tracker is told: the picture source, the colours, and the vehicles as pairs of coloured patches."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from bus.config import Section
from camera_tracker import marker
from camera_tracker.settings import CameraSettings

Channel = Annotated[int, Field(ge=0, le=255)]

SOURCES = (
    "/dev/video0 or a number, rtsp:// or http:// stream, bus://camera/image, video, folder, picture, sim://[DIRECTORY]"
)

DICTIONARIES = {
    **{f"{n}x{n}_{count}": count for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "aruco_original": 1024,
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
    "aruco_mip_36h12": 250,
}
"""Dictionaries of square markers, as OpenCV calls them without DICT_ and in lower case: how many markers each has."""


def _known_dictionary(name: str) -> str:
    if name not in DICTIONARIES:
        raise ValueError(f"no such dictionary: {name}; known: {', '.join(DICTIONARIES)}")
    return name


Dictionary = Annotated[str, AfterValidator(_known_dictionary)]


class Colour(Section):
    """A colour as a box of channel values. In "bgr" it is thesis (3.10): one channel high, the others low.

    In "hsv" (OpenCV: hue 0..179 in steps of 2 degrees) a low hue above the high one runs over red: 170 ... 10.
    """

    space: Literal["bgr", "hsv"] = "bgr"
    low: tuple[Channel, Channel, Channel]
    high: tuple[Channel, Channel, Channel]


class Vehicle(Section):
    """A vehicle by its marker: two patches, one patch (thesis Algorithm 3.2), or a square marker of a dictionary.

    Of two patches the position is the middle, and the heading goes from `rear` to `front`; of one it goes along the
    long axis to the thin end; of a square marker from left to right as printed; plus `heading_deg`.
    """

    name: str = Field(max_length=64)
    front: str | None = Field(None, description="colour of the patch, of the front one if there are two")
    rear: str | None = Field(None, description="colour of the rear patch")
    spacing_px: float | None = Field(None, gt=0, description="distance between the patches; a pair off by 30 % is none")
    area_px2: float | None = Field(None, gt=0, description="size of each patch; other sizes lower the quality")
    dictionary: Dictionary | None = Field(None, description="of a square marker: 4x4_50, apriltag_36h11, ...")
    marker: int | None = Field(None, ge=0, description="number of the square marker in its dictionary")
    heading_deg: float = Field(0.0, description="from the marker's axis to the vehicle's x axis, clockwise")
    height_m: float | None = Field(None, description="of the marker above the water; None: marker_height_m")
    plain: bool = Field(True, description="a third colour in or beside a patch lowers the quality: glare, or a cover")
    goes_ahead: bool = Field(False, description="one patch with two like ends: its direction of travel shows the front")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.front is None) == (self.dictionary is None):
            raise ValueError(f"vehicle {self.name}: give either front (a colour) or dictionary and marker")
        if (self.dictionary is None) != (self.marker is None):
            raise ValueError(f"vehicle {self.name}: dictionary and marker belong together")
        if self.dictionary is not None and (self.marker or 0) >= DICTIONARIES[self.dictionary]:
            raise ValueError(f"vehicle {self.name}: {self.dictionary} has no marker {self.marker}")
        return self


class Rectangle(Section):
    """A part of the picture, in px."""

    x: int = Field(ge=0)
    y: int = Field(ge=0)
    width: int = Field(gt=0)
    height: int = Field(gt=0)


class CameraTrackerConfig(Section):
    """Section [camera_tracker]. Without vehicles it looks for the marker of docs/camera-tracker.md."""

    source: str = Field("sim://", description=SOURCES)
    scale_px_per_m: float | None = Field(None, gt=0, description="None: the vessel file's")
    calibration: Path | None = Field(None, description="file of `starboard camera`; replaces scale_px_per_m")
    marker_height_m: float = Field(0.0, description="of the markers above the water; used with a calibration")
    marker_height_std_m: float = Field(0.005, ge=0, description="how surely it is known")
    position_noise_px: float = Field(0.1, gt=0, description="of a good pose; used with a calibration")
    heading_noise_rad: float = Field(0.002, gt=0, description="of a good pose; used with a calibration")
    camera: CameraSettings = Field(CameraSettings(), description="what is asked of a USB camera")
    image_rate_hz: float = Field(5.0, ge=0, le=60, description="of camera/image; 0: none")
    colours: dict[str, Colour] = Field(default_factory=dict)
    vehicles: tuple[Vehicle, ...] = ()
    every_marker_of: Dictionary | None = Field(None, description="take each marker of a dictionary for a vehicle")
    ignore: tuple[Rectangle, ...] = ()
    min_area_px2: float = Field(20.0, gt=0, description="smaller patches are noise")

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        for vehicle in self.vehicles:
            for colour in {vehicle.front, vehicle.rear} - {None, *self.colours}:
                known = ", ".join(self.colours) or "there are none"
                raise ValueError(f"vehicle {vehicle.name}: no such colour in colours: {colour} ({known})")
        if self.calibration is not None and self.scale_px_per_m is not None:
            raise ValueError("calibration and scale_px_per_m: give one of them")
        names = [vehicle.name for vehicle in self.vehicles]
        if len(set(names)) < len(names):
            raise ValueError("two vehicles have the same name")
        return self

    def with_default_marker(self, name: str, scale_px_per_m: float | None) -> CameraTrackerConfig:
        """Return the configuration with our marker on a vessel called `name`, unless it has vehicles of its own.

        With a scale the marker's size is known, too, and pairs of patches that do not have it are refused.
        """
        if self.vehicles or self.every_marker_of is not None:
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
