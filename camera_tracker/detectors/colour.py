"""Coloured patches: thesis Algorithm 3.2, to a fraction of a pixel. Picture (and region) in, detections out.

Steps I-III are `colour_mask`, IV its morphology, V `measure_patch` and `pose_of_pair` / `pose_of_patch`.
Integer pixel coordinates are pixel centres. Angles in rad, from x towards y: clockwise as one sees the picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from camera_tracker.config import Colour
from camera_tracker.detectors.base import GOOD_QUALITY, Detection, Region, doubtful, upper_median, worst
from camera_tracker.sources import Image
from marine.frames import wrap_angle

Mask = NDArray[np.uint8]
Labels = NDArray[np.integer[Any]]

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
_FOREIGN = 0.16
"""Of the contrast: what lies so far beside the way from surroundings to patch is neither."""
_STRANGE = 0.04
_AREA_TOLERANCE = 0.06


class Blob(NamedTuple):
    """A connected piece of a mask: centroid, area and box, in px of the picture that was masked."""

    label: int
    x_px: float
    y_px: float
    area_px2: float
    box: Region


class Patch(NamedTuple):
    """A measured patch.

    contrast: grey levels between patch and surroundings. clipped: the edge of the picture, or what is ignored, cuts it.
    strange: area of what is neither the patch's colour nor its surroundings', as a part of the patch. bright: whether
    that is brighter than both.
    """

    x_px: float
    y_px: float
    area_px2: float
    moments: Mapping[str, float]
    """Central ones, as OpenCV names them."""
    contrast: float
    clipped: bool
    strange: float
    bright: bool

    def shape(self) -> Shape:
        """Return axis, elongation and skewness by the moments."""
        m, area = self.moments, self.area_px2
        xx, yy, xy = m["mu20"] / area, m["mu02"] / area, m["mu11"] / area
        axis_rad = 0.5 * math.atan2(2 * xy, xx - yy)
        spread = math.hypot(xx - yy, 2 * xy)
        large, small = 0.5 * (xx + yy + spread), max(0.5 * (xx + yy - spread), 1e-9)
        c, s = math.cos(axis_rad), math.sin(axis_rad)
        third = c**3 * m["mu30"] + 3 * c * c * s * m["mu21"] + 3 * c * s * s * m["mu12"] + s**3 * m["mu03"]
        skew = third / area / max(large, 1e-9) ** 1.5
        if skew < 0:  # the long tail, where the outline is thin, lies the other way
            axis_rad, skew = wrap_angle(axis_rad + math.pi), -skew
        return Shape(axis_rad, math.sqrt(large / small), skew)


class Shape(NamedTuple):
    """Of a patch. `axis_rad` is the direction of its long axis towards its thin end.

    elongation: ratio of the principal standard deviations, >= 1. skew: skewness along the axis, >= 0.
    """

    axis_rad: float
    elongation: float
    skew: float


def colour_mask(image: Image, colour: Colour) -> Mask:
    """Return 255 where a picture has the colour, 0 elsewhere: steps I to III."""
    if colour.space == "hsv":
        image = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)  # type: ignore[assignment]
        if colour.low[0] > colour.high[0]:
            upper = cv2.inRange(image, colour.low, (179, *colour.high[1:]))
            return _mask(cv2.bitwise_or(upper, cv2.inRange(image, (0, *colour.low[1:]), colour.high)))
    return _mask(cv2.inRange(image, colour.low, colour.high))


def clean(mask: Mask) -> Mask:
    """Remove secluded pixels and fill pinholes, step IV: each pixel becomes what most of its 3 x 3 are."""
    return _mask(cv2.threshold(cv2.blur(mask, (3, 3)), 127, 255, cv2.THRESH_BINARY)[1])


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
    (height, width), (rows, columns) = image.shape[:2], view.shape[:2]
    patches = []
    for blob in blobs[:8]:  # more than that is a background of this colour
        x0, y0, x1, y1 = blob.box
        cut = (
            x0 == 0 < region.x0,
            y0 == 0 < region.y0,
            x1 == columns < width - region.x0,
            y1 == rows < height - region.y0,
        )
        if any(cut):
            continue
        clipped = x0 == 0 or y0 == 0 or x1 == columns or y1 == rows
        patch = measure_patch(view, labels, blob, allowed, clipped=clipped, origin=(region.x0, region.y0))
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
    piece = cv2.compare(box.of(labels), blob.label, cv2.CMP_EQ)  # type: ignore[call-overload]  # a number will do
    around = cv2.blur(piece, (5, 5))
    core, near = around == around.max(), around > 10  # all of the 25 (of a tiny piece: most), at least two of them
    ring = cv2.dilate(near.view(np.uint8), _DISC).view(np.bool_) ^ near
    if allowed is not None:
        ignored = box.of(allowed) == 0
        clipped = clipped or bool((near & ignored).any())
        core, near, ring = (zone & ~ignored for zone in (core, near, ring))
    in_core, in_ring, in_edge = (zone.ravel().nonzero()[0] for zone in (core, ring, near ^ core))
    n, judged = len(in_core), len(in_core) + len(in_ring)
    if n in (0, judged):
        return None
    pixels = box.of(image).reshape(-1, 3).take(np.concatenate([in_core, in_ring, in_edge]), axis=0)
    colours = pixels.T.astype(np.float32, order="C")  # rows of one channel: faster than pixels
    inside = cv2.reduce(colours[:, :n], 1, cv2.REDUCE_AVG)
    surroundings = upper_median(colours[:, n:judged])[:, None]
    axes, contrast = _axes((inside - surroundings).ravel().tolist())
    if contrast < _MIN_CONTRAST:
        return None
    way, *beside = axes @ (colours - surroundings)
    foreign = cv2.magnitude(*beside)[:judged]
    strange = (foreign > max(5.5 * float(upper_median(foreign[:n])), _FOREIGN * contrast)).nonzero()[0]
    weight = core.astype(np.float32)
    weight.ravel()[in_edge] = np.minimum(np.maximum(way[judged:], -0.5), 1.5)
    moments = cv2.moments(weight)
    area = moments["m00"]
    if area <= 0:
        return None
    return Patch(
        x_px=moments["m10"] / area + box.x0 + origin[0],
        y_px=moments["m01"] / area + box.y0 + origin[1],
        area_px2=area,
        moments=moments,
        contrast=contrast,
        clipped=clipped,
        strange=strange.size / max(area, 1.0),
        bright=strange.size > 0 and float(colours.take(strange, axis=1).min(axis=0).mean()) > inside.min(),
    )


def _axes(way: Sequence[float]) -> tuple[NDArray[np.float32], float]:
    """Return the axes of a colour space (rows), and the length of the way from the surroundings' colour to the patch's.

    The first axis measures the way in parts of it, the others what lies beside it, in grey levels. Duff et al.,
    "Building an Orthonormal Basis, Revisited", JCGT 6 (2017).
    """
    length = max(math.hypot(*way), 1e-6)
    x, y, z = (v / length for v in way)
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    beside = (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)
    return np.array([(x / length, y / length, z / length), *beside], np.float32), length


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
        patches_px=((front.x_px, front.y_px), (rear.x_px, rear.y_px)),
    )


def pose_of_patch(patch: Patch, *, area_px2: float | None, heading_rad: float, plain: bool = True) -> Detection:
    """Return the pose of one patch: heading along its long axis to its thin end, ambiguous when both are alike."""
    shape = patch.shape()
    ambiguous = shape.skew < _MIN_SKEW or shape.elongation < _MIN_ELONGATION
    quality, reason = worst(_checks([patch], area_px2, plain=plain))
    return Detection(
        x_px=patch.x_px,
        y_px=patch.y_px,
        psi_rad=wrap_angle(shape.axis_rad + heading_rad),
        quality=quality,
        reason=reason,
        heading_ambiguous=ambiguous,
        extent_px=math.sqrt(patch.area_px2) * shape.elongation,
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
            off = abs(ratio - 1.0) > _AREA_TOLERANCE
            reason = f"a patch has {ratio:.0%} of the area it should have" if off else ""
            checks.append(doubtful(reason) if off and p.strange > 0.0 else (min(ratio, 1.0 / ratio), reason))
    return checks


def _mask(image: Any) -> Mask:
    return image  # type: ignore[no-any-return]
