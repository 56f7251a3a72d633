"""Pictures of a calibration board from a running camera: one for each new pose in which the board is held still."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import cv2

from camera_tracker.boards import Board
from camera_tracker.collecting import Collection
from camera_tracker.sources import Image, Source, SourceError

_POLL_S = 0.005
_SILENCE_S = 10.0


def grab_picture(source: Source, settle_s: float) -> Image:
    """Return a live source's newest picture after a time, or the first after that; a recording's first, at once.

    Raises SourceError when the source fails, or gives no picture for `_SILENCE_S`.
    """
    begin_s, newest = time.monotonic(), None
    try:
        while newest is None or (source.live and time.monotonic() - begin_s < settle_s):
            newest = source.read() or newest
            if newest is None and not (source.live and time.monotonic() - begin_s < settle_s + _SILENCE_S):
                raise SourceError(f"{source.uri}: no picture" + (f" for {_SILENCE_S:.0f} s" if source.live else ""))
            time.sleep(_POLL_S)
    finally:
        source.close()
    return newest.image


def grab_views(source: Source, board: Board, folder: Path, count: int) -> Iterator[tuple[int, str]]:
    """Write pictures into a folder until there are `count`; yield after each how many, and which parts lack corners.

    Raises SourceError when the source fails, or changes the size of its pictures.
    """
    taken = Collection(board)
    try:
        while len(taken.views) < count:
            frame = source.read()
            if frame is None:
                if not source.live:
                    return
                time.sleep(_POLL_S)
                continue
            look = taken.look(f"board-{len(taken.views) + 1:02}.png", frame.image, frame.stamp_ns)
            if look.view is not None and look.still and look.adds:
                cv2.imwrite(str(folder / look.view.name), frame.image)
                taken.take(look.view)
                yield len(taken.views), ", ".join(taken.missing_parts())
    except ValueError as error:
        raise SourceError(f"{source.uri}: {error}") from None
    finally:
        source.close()
