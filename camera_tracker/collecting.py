"""Views of a board while they are taken: which are worth taking, and where the board should be held next.

Pure: pictures and their stamps in. `starboard camera grab` and the page's calibration both work with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from camera_tracker.boards import Board
from camera_tracker.calibration import MIN_TILT_DEG, View, camera_matrix, missing_cells, of_cell
from camera_tracker.sources import Image

ENOUGH_VIEWS = 15
TILTS = ("left", "right", "top", "bottom", "flat")
"""Which edge of the board is nearer to the camera, as the picture shows it."""
VIEWS_A_TILT = 2
STILL_WIDTHS_S = 0.04
"""The board is held still while its corners move no more than so many widths of the picture in a second: an exposure
of 10 ms then blurs a picture of 800 px by a third of a px."""
_NEW_POSE = 0.06
"""Mean movement of the board's corners since every view taken, in widths of the picture, that is a new pose anyway."""
_OTHER_POSE = 0.02
"""The same, of a pose that shows a part or a tilt that is still wanted."""
_CELL_CORNERS = 4
_TYPICAL_FOCAL = 0.9
"""Of the picture's width (58 degrees): good enough to tell how a board is tilted before the lens is known."""
_SHORTEST_S = 1.0 / 30.0


@dataclass(frozen=True)
class Look:
    """What one picture shows of the board. still: it moves too slowly to blur. adds: it shows what is wanted."""

    view: View | None
    still: bool = False
    adds: bool = False


class Collection:
    """The views taken so far. A picture of another size than the first raises ValueError."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.views: list[View] = []
        self.tilts: list[str] = []
        """Of each view, one of `TILTS`."""
        self.size_px = (0, 0)
        self._last: tuple[View, int] | None = None

    def look(self, name: str, image: Image, stamp_ns: int) -> Look:
        """Find the board in the next picture (capture time stamp_ns); `name` is the view's, should it be taken."""
        height, width = image.shape[:2]
        if self.views and (width, height) != self.size_px:
            before = " x ".join(str(v) for v in self.size_px)
            raise ValueError(f"the pictures have {width} x {height} px now, those before {before} px")
        self.size_px = (width, height)
        view = self.board.view(name, image)
        last, self._last = self._last, None if view is None else (view, stamp_ns)
        if view is None:
            return Look(None)
        seconds = _SHORTEST_S if last is None else max((stamp_ns - last[1]) * 1e-9, _SHORTEST_S)
        still = last is not None and moved_px(view, last[0]) < STILL_WIDTHS_S * width * seconds
        return Look(view, still, self._adds(view))

    def take(self, view: View) -> None:
        """Keep a view."""
        self.views.append(view)
        self.tilts.append(tilt_of(view, self.size_px))

    def undo(self) -> None:
        """Forget the last view; IndexError when there is none."""
        self.views.pop()
        self.tilts.pop()

    def is_taken(self, view: View) -> bool:
        """Tell whether the board was taken in this very pose already."""
        return any(moved_px(view, v) < _OTHER_POSE * self.size_px[0] for v in self.views)

    def missing_parts(self) -> list[str]:
        """Return the parts of the picture with few or no corners."""
        return missing_cells(self.views, self.size_px)

    def missing_tilts(self) -> list[str]:
        """Return the tilts of which there are fewer than `VIEWS_A_TILT` views."""
        return [tilt for tilt in TILTS if self.tilts.count(tilt) < VIEWS_A_TILT]

    def hint(self, look: Look) -> str:
        """Return what to do next, one line."""
        if look.view is None:
            return "show the board, all of it in the light"
        if look.adds and not look.still:
            return "hold it still"
        if self.views and (parts := self.missing_parts()):
            return f"hold the board so that it covers the picture's {parts[0]}"
        if self.views and (tilts := self.missing_tilts()):
            nearer = f"with its {tilts[0]} edge nearer to the camera, by 20 to 40 deg"
            return "hold it flat before the camera" if tilts[0] == "flat" else f"tilt it {nearer}"
        if len(self.views) < ENOUGH_VIEWS:
            return f"show it in another pose: {len(self.views)} of {ENOUGH_VIEWS} views"
        return "that is enough: solve"

    def _adds(self, view: View) -> bool:
        width = self.size_px[0]
        nearest_px = min((moved_px(view, v) for v in self.views), default=math.inf)
        if nearest_px < _OTHER_POSE * width:
            return False
        if nearest_px > _NEW_POSE * width:
            return True
        cells = of_cell(view, self.size_px)
        return tilt_of(view, self.size_px) in self.missing_tilts() or any(
            cells.count(part) >= _CELL_CORNERS for part in self.missing_parts()
        )


def moved_px(one: View, other: View) -> float:
    """Return how far the corners that both views show are from each other, mean in px; infinite without any."""
    places = dict(zip(map(tuple, other.board_m.round(6).tolist()), other.seen_px.reshape(-1, 2), strict=True))
    ours = zip(map(tuple, one.board_m.round(6).tolist()), one.seen_px.reshape(-1, 2), strict=True)
    apart = np.array([seen - places[place] for place, seen in ours if place in places])
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean()) if len(apart) else math.inf


def tilt_of(view: View, size_px: tuple[int, int]) -> str:
    """Return which of `TILTS` a view has: the edge of the picture towards which the board comes nearer."""
    width, height = size_px
    lens = camera_matrix(np.array([_TYPICAL_FOCAL * width] * 2 + [0.5 * (width - 1), 0.5 * (height - 1)]))
    found, turn, _ = cv2.solvePnP(view.board_m, view.seen_px, lens, None, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        return "flat"
    x, y, z = (float(v) for v in np.asarray(cv2.Rodrigues(turn)[0])[:, 2])
    if math.degrees(math.atan2(math.hypot(x, y), abs(z))) < MIN_TILT_DEG:
        return "flat"
    x, y = math.copysign(x, x * z), math.copysign(y, y * z)
    if abs(x) > abs(y):
        return "right" if x > 0 else "left"
    return "bottom" if y > 0 else "top"
