"""Coloured patches: thesis Algorithm 3.2, to a fraction of a pixel. Picture (and region) in, detections out.

Steps I-III are `colour_mask`, IV its morphology, V `measure_patch` and `pose_of_pair` / `pose_of_patch`.
Integer pixel coordinates are pixel centres. Angles in rad, from x towards y: clockwise as one sees the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.config import Colour
from camera_tracker.detectors.base import GOOD_QUALITY, Detection, Region, doubtful, upper_median, worst
from camera_tracker.sources import Image
from marine.frames import wrap_angle

Mask = NDArray[np.uint8]
Labels = NDArray[np.integer[Any]]

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_SQUARE = np.ones((3, 3), np.uint8)
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
_SURROUNDINGS_PX = 4
"""A patch is compared with what lies so far around it."""
_GOOD_CONTRAST = 60.0
"""Grey levels between patch and surroundings from which noise no longer matters."""
_MIN_CONTRAST = 10.0
_MIN_SKEW = 0.1
"""|skewness| below which an outline is as good as symmetric; a triangle has 0.57."""
_MIN_ELONGATION = 1.15
_SPACING_TOLERANCE = 0.3
_SPACING_DOUBT = 0.15
"""Where sizes are known, a spacing that is off by this part of the tolerance (5 %) shows motion blur or a cover."""
_NARROW_LABELS = 4 * 65_535
_STRANGE = 0.04
_AREA_TOLERANCE = 0.06


@dataclass(frozen=True)
class Blob:
    """A connected piece of a mask: centroid, area and box, in px of the picture that was masked."""

    label: int
    x_px: float
    y_px: float
    area_px2: float
    box: Region


@dataclass(frozen=True)
class Patch:
    """A measured patch. `axis_rad` is the direction of its long axis towards its thin end.

    elongation: ratio of the principal standard deviations, >= 1. skew: skewness along the axis, >= 0.
    contrast: grey levels between patch and surroundings. clipped: the edge of the picture, or what is ignored, cuts it.
    """

    x_px: float
    y_px: float
    area_px2: float
    axis_rad: float
    elongation: float
    skew: float
    contrast: float = 0.0
    clipped: bool = False
    strange: float = 0.0
    """Area of what is neither the patch's colour nor its surroundings', as a part of the patch."""
    bright: bool = False
    """Whether that is brighter than both."""


def colour_mask(image: Image, colour: Colour) -> Mask:
    """Return 255 where a picture has the colour, 0 elsewhere: steps I to III."""
    if colour.space == "hsv":
        image = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)  # type: ignore[assignment]
        if colour.low[0] > colour.high[0]:
            upper = cv2.inRange(image, colour.low, (179, *colour.high[1:]))
            return _mask(cv2.bitwise_or(upper, cv2.inRange(image, (0, *colour.low[1:]), colour.high)))
    return _mask(cv2.inRange(image, colour.low, colour.high))


def clean(mask: Mask) -> Mask:
    """Remove secluded pixels and fill pinholes: step IV."""
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _CROSS)
    return _mask(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, _SQUARE))


def occupied(mask: Mask, margin_px: int = 0) -> Region | None:
    """Return the part of a mask that holds all it has, and a margin around that; None: it is empty.

    A mask is nearly empty: labelling all of it would cost ten times more than finding this.
    """
    x, y, width, height = cv2.boundingRect(mask)
    if not width:
        return None
    rows, columns = mask.shape
    x1, y1 = min(x + width + margin_px, columns), min(y + height + margin_px, rows)
    return Region(max(x - margin_px, 0), max(y - margin_px, 0), x1, y1)


def find_blobs(mask: Mask, min_area_px2: float) -> tuple[list[Blob], Labels]:
    """Return the connected pieces of a mask, largest first, and the picture of their labels."""
    narrow = mask.size < _NARROW_LABELS  # half the time of 32 bits; a piece and what parts it from others is 4 px
    _, labels, stats, centres = cv2.connectedComponentsWithStats(
        mask, connectivity=8, ltype=cv2.CV_16U if narrow else cv2.CV_32S
    )
    blobs = [
        Blob(label, x_px, y_px, float(area), Region(x, y, x + w, y + h))
        for label, ((x, y, w, h, area), (x_px, y_px)) in enumerate(zip(stats.tolist(), centres.tolist(), strict=True))
        if label > 0 and area >= min_area_px2
    ]
    return sorted(blobs, key=lambda blob: -blob.area_px2), labels  # type: ignore[return-value]


def find_patches(
    image: Image, region: Region, colour: Colour, min_area_px2: float, allowed: Mask | None = None
) -> list[Patch]:
    """Return the patches of a colour in a region at full resolution, in px of the whole picture, largest first.

    `allowed` (of the whole picture) is 0 where not to look. A patch that the region cuts off inside the picture is
    left out: whoever chose the region looked in the wrong place.
    """
    mask = colour_mask(region.of(image), colour)
    part = occupied(mask, _SURROUNDINGS_PX + 2)
    if part is None:
        return []
    mask = clean(part.of(mask))
    region = Region(region.x0 + part.x0, region.y0 + part.y0, region.x0 + part.x1, region.y0 + part.y1)
    view = region.of(image)
    if allowed is not None:
        mask = _mask(cv2.bitwise_and(mask, region.of(allowed)))
    blobs, labels = find_blobs(mask, min_area_px2)
    allowed = None if allowed is None else region.of(allowed)
    height, width = image.shape[:2]
    patches = []
    for blob in blobs[:8]:  # more than that is a background of this colour
        at_edge = (blob.box.x0 == 0, blob.box.y0 == 0, blob.box.x1 == view.shape[1], blob.box.y1 == view.shape[0])
        picture_edge = (region.x0 == 0, region.y0 == 0, region.x1 == width, region.y1 == height)
        if any(at and not edge for at, edge in zip(at_edge, picture_edge, strict=True)):
            continue
        patch = measure_patch(view, labels, blob, allowed, clipped=any(at_edge), origin=(region.x0, region.y0))
        if patch is not None:
            patches.append(patch)
    return patches


def measure_patch(
    image: Image, labels: Labels, blob: Blob, allowed: Mask | None, *, clipped: bool, origin: tuple[int, int]
) -> Patch | None:
    """Measure a blob to a fraction of a pixel; None when nothing distinguishes it from its surroundings.

    Each pixel near the edge counts by how far its colour is on the way from the surroundings to the patch, pixels well
    inside count 1, others (and where `allowed` is 0) 0: a symmetric blur keeps the centroid, noise enters only through
    the edge, and where the threshold lies does not matter. Hardly limited to 0..1: that would turn noise into area.
    `origin`: where in the picture `image` begins, px.
    """
    height, width = image.shape[:2]
    b = blob.box
    far = _SURROUNDINGS_PX
    box = Region(max(b.x0 - far, 0), max(b.y0 - far, 0), min(b.x1 + far, width), min(b.y1 + far, height))
    pixels = box.of(image)
    label = labels[box.y0 : box.y1, box.x0 : box.x1]
    piece = (label == blob.label).view(np.uint8)
    core = cv2.erode(piece, _DISC, borderType=cv2.BORDER_REPLICATE)
    near = cv2.dilate(piece, _DISC)
    ring = cv2.subtract(cv2.dilate(near, _DISC), near)
    if allowed is not None:
        ignored = box.of(allowed) == 0
        ring[ignored] = 0
        clipped = clipped or bool((near.view(np.bool_) & ignored).any())
        near[ignored] = 0
    in_core, in_ring = (np.flatnonzero(mask.view(np.bool_)) for mask in (core, ring))
    if not in_core.size or not in_ring.size:
        return None
    planes = np.ascontiguousarray(pixels.reshape(-1, 3).T)  # rows of one channel: several times faster than pixels
    surroundings = upper_median(planes.take(in_ring, axis=1)).astype(np.float32)
    inside = np.array(cv2.mean(pixels, mask=core)[:3], np.float32)
    contrast = math.dist(inside, surroundings)
    if contrast < _MIN_CONTRAST:
        return None
    way, foreign = _way_and_rest(planes, surroundings, inside)
    judged = np.concatenate([in_core, in_ring])
    limit = max(6.0 * float(upper_median(foreign.take(in_core))), 0.12 * contrast)
    strange = judged[foreign.take(judged) > limit]
    weight = np.minimum(np.maximum(way, -0.5, out=way), 1.5, out=way)
    weight[in_core] = 1.0
    moments = cv2.moments(cv2.copyTo(weight.reshape(core.shape), near))
    if moments["m00"] <= 0:
        return None
    return _patch(
        moments,
        (box.x0 + origin[0], box.y0 + origin[1]),
        contrast=contrast,
        clipped=clipped,
        strange=strange.size / max(moments["m00"], 1.0),
        bright=strange.size > 0 and float(planes.take(strange, axis=1).min(axis=0).mean()) > inside.min(),
    )


def _way_and_rest(
    planes: Image, surroundings: NDArray[np.float32], inside: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return how far each of n pixels, planes (3, n), is on the way from the surroundings' colour to the patch's,
    and how far beside that way, each (n,).
    """
    axis = inside - surroundings
    centred = planes - surroundings[:, None]
    way = (axis / (axis @ axis)) @ centred
    centred -= axis[:, None] * way
    return way, np.abs(centred, out=centred).max(axis=0)


def _patch(m: dict[str, float], origin: tuple[int, int], **judged: Any) -> Patch:
    """Turn the moments of a patch into centroid, axis, elongation and skewness."""
    area = m["m00"]
    xx, yy, xy = m["mu20"] / area, m["mu02"] / area, m["mu11"] / area
    axis_rad = 0.5 * math.atan2(2 * xy, xx - yy)
    spread = math.hypot(xx - yy, 2 * xy)
    large, small = 0.5 * (xx + yy + spread), max(0.5 * (xx + yy - spread), 1e-9)
    c, s = math.cos(axis_rad), math.sin(axis_rad)
    third = c**3 * m["mu30"] + 3 * c * c * s * m["mu21"] + 3 * c * s * s * m["mu12"] + s**3 * m["mu03"]
    skew = third / area / max(large, 1e-9) ** 1.5
    if skew < 0:  # the long tail, where the outline is thin, lies the other way
        axis_rad, skew = wrap_angle(axis_rad + math.pi), -skew
    return Patch(
        x_px=m["m10"] / area + origin[0],
        y_px=m["m01"] / area + origin[1],
        area_px2=area,
        axis_rad=axis_rad,
        elongation=math.sqrt(large / small),
        skew=skew,
        **judged,
    )


def spacing_error(distance_px: float, spacing_px: float | None, size_px: float) -> float | None:
    """Return how badly two patches fit together, 0 (well) to 1, or None when they cannot belong together.

    Without a known spacing near ones fit best, up to three times the patches' mean size.
    """
    if spacing_px is None:
        error = distance_px / (3.0 * size_px)
    else:
        error = abs(distance_px / spacing_px - 1.0) / _SPACING_TOLERANCE
    return error if error <= 1.0 else None


def pose_of_pair(
    front: Patch,
    rear: Patch,
    *,
    spacing_px: float | None,
    area_px2: float | None,
    heading_rad: float,
    plain: bool = True,
) -> Detection | None:
    """Return the pose of two patches, or None when they do not fit together: step V."""
    dx, dy = front.x_px - rear.x_px, front.y_px - rear.y_px
    distance = math.hypot(dx, dy)
    size = 0.5 * (math.sqrt(front.area_px2) + math.sqrt(rear.area_px2))
    error = spacing_error(distance, spacing_px, size)
    if error is None or distance < 1e-6:
        return None
    checks = _checks([front, rear], area_px2, plain=plain)
    if spacing_px is not None:
        apart = "the patches are not as far apart as they should be"
        checks.append((1.0 - error, apart) if area_px2 is None or error < _SPACING_DOUBT else doubtful(apart))
    quality, reason = worst(checks)
    return Detection(
        x_px=0.5 * (front.x_px + rear.x_px),
        y_px=0.5 * (front.y_px + rear.y_px),
        psi_rad=wrap_angle(math.atan2(dy, dx) + heading_rad),
        quality=quality,
        reason=reason,
        heading_ambiguous=False,
        extent_px=0.5 * distance + size,
        misfit=error,
    )


def pose_of_patch(patch: Patch, *, area_px2: float | None, heading_rad: float, plain: bool = True) -> Detection:
    """Return the pose of one patch: heading along its long axis to its thin end, ambiguous when both are alike."""
    ambiguous = patch.skew < _MIN_SKEW or patch.elongation < _MIN_ELONGATION
    quality, reason = worst(_checks([patch], area_px2, plain=plain))
    return Detection(
        x_px=patch.x_px,
        y_px=patch.y_px,
        psi_rad=wrap_angle(patch.axis_rad + heading_rad),
        quality=quality,
        reason=reason,
        heading_ambiguous=ambiguous,
        extent_px=math.sqrt(patch.area_px2) * patch.elongation,
    )


def _checks(patches: list[Patch], area_px2: float | None, *, plain: bool) -> list[tuple[float, str]]:
    """Return what speaks against patches; the limits are from benchmarks/tracker.py, where none errs by half a px."""
    checks = [(min(1.0, p.contrast / _GOOD_CONTRAST), "low contrast") for p in patches]
    checks += [doubtful("out of view: clipped at the edge of the picture") for p in patches if p.clipped]
    if plain:
        for p in patches:
            share = 1.5 - p.strange / _STRANGE
            reason = "glare" if p.bright else "partly covered"
            checks.append((min(1.0, share), reason) if share >= GOOD_QUALITY else doubtful(reason))
    if area_px2 is not None:
        for p in patches:
            ratio = p.area_px2 / area_px2
            checks.append((min(ratio, 1.0 / ratio), f"a patch has {ratio:.0%} of the area it should have"))
            if p.strange > 0.0 and abs(ratio - 1.0) > _AREA_TOLERANCE:
                checks.append(doubtful(f"a patch has {ratio:.0%} of the area it should have"))
    return checks


def _mask(image: Any) -> Mask:
    return image  # type: ignore[no-any-return]
