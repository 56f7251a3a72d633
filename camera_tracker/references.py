"""The points that a tape measure knows: a TOML file of marker numbers or pixels and their places in {E}."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from bus.config import Section, parse, read_toml
from camera_tracker.config import Dictionary
from camera_tracker.detectors.base import GOOD_QUALITY
from camera_tracker.detectors.square import SquareDetector
from camera_tracker.plane import Reference
from camera_tracker.sources import Image


class Point(Section):
    """A point at a known place: the middle of a printed marker, or a point of the picture."""

    marker: int | None = Field(None, ge=0)
    x_px: float | None = None
    y_px: float | None = None
    x_m: float
    y_m: float
    height_m: float = Field(0.0, description="above the water")

    @model_validator(mode="after")
    def _seen_somehow(self) -> Self:
        if (self.marker is None) == (self.x_px is None) or (self.x_px is None) != (self.y_px is None):
            raise ValueError("give either marker, or x_px and y_px")
        return self

    @property
    def name(self) -> str:
        """How a message calls the point."""
        return f"marker {self.marker}" if self.marker is not None else f"the point at {self.x_px}, {self.y_px} px"


class ReferenceFile(Section):
    """All of the file."""

    dictionary: Dictionary = "4x4_50"
    std_m: float = Field(0.003, gt=0, description="standard deviation of the tape measure")
    std_px: float = Field(0.2, gt=0, description="standard deviation of a point in the picture")
    point: tuple[Point, ...] = Field(min_length=1)

    @classmethod
    def read(cls, path: Path) -> ReferenceFile:
        """Return the content of a file; raise ConfigError with file, key and reason."""
        return parse(cls, read_toml(path), path)

    def seen(self, image: Image) -> tuple[list[Reference], list[str]]:
        """Return the points that a picture shows, and the names of the markers that it does not."""
        detector = SquareDetector(self.dictionary, {})
        found = {d_name: d for d_name, d in detector.search(image, ()).items() if d.quality >= GOOD_QUALITY}
        seen, missing = [], []
        for point in self.point:
            x_px, y_px = point.x_px, point.y_px
            if point.marker is not None:
                detection = found.get(str(point.marker))
                x_px, y_px = (detection.x_px, detection.y_px) if detection else (None, None)
            if x_px is None or y_px is None or not math.isfinite(x_px + y_px):
                missing.append(point.name)
            else:
                seen.append(Reference(point.name, point.x_m, point.y_m, point.height_m, x_px, y_px))
        return seen, missing
