"""Pictures of a calibration board from a running camera: one for each new pose in which the board is held still."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from camera_tracker.boards import Board
from camera_tracker.calibration import View, missing_cells
from camera_tracker.sources import Source

STILL_PX = 1.5
"""A corner moves no more than this from one picture to the next while the board is held still."""
_NEW_POSE = 0.06
"""Mean movement of the board's corners since every picture taken, in widths of the picture."""
_POLL_S = 0.005


def grab_views(source: Source, board: Board, folder: Path, count: int) -> Iterator[tuple[int, str]]:
    """Write pictures into a folder until there are `count`; yield after each how many, and which parts lack corners.

    Raises SourceError when the source fails.
    """
    taken: list[View] = []
    before: View | None = None
    try:
        while len(taken) < count:
            frame = source.read()
            if frame is None:
                if not source.live:
                    return
                time.sleep(_POLL_S)
                continue
            view = board.view(f"board-{len(taken) + 1:02}.png", frame.image)
            still = view is not None and before is not None and _moved_px(view, before) < STILL_PX
            height, width = frame.image.shape[:2]
            if view is not None and still and all(_moved_px(view, v) > _NEW_POSE * width for v in taken):
                cv2.imwrite(str(folder / view.name), frame.image)
                taken.append(view)
                yield len(taken), ", ".join(missing_cells(taken, (width, height)))
            before = view
    finally:
        source.close()


def _moved_px(one: View, other: View) -> float:
    """Return how far the corners that both views show are from each other, mean in px; infinite without any."""
    places = dict(zip(map(tuple, other.board_m.round(6).tolist()), other.seen_px.reshape(-1, 2), strict=True))
    ours = zip(map(tuple, one.board_m.round(6).tolist()), one.seen_px.reshape(-1, 2), strict=True)
    apart = np.array([seen - places[place] for place, seen in ours if place in places])
    return float(np.hypot(apart[:, 0], apart[:, 1]).mean()) if len(apart) else float("inf")
