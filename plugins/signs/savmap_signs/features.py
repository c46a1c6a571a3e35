"""Signs in a view: from the network's masks to four corners, measured at the panorama's own resolution.

A mask becomes a quadrilateral. The sign is rectified out of the panorama. Each side is the straight line across which
brightness changes most, near where the mask has it, and the corners are where the sides meet.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.plugin import touches_border
from savmap.types import Detection, Feature, FilmedPanorama, Floats, Panorama, View, ViewSpec

PARTS = ("upper left", "upper right", "lower right", "lower left")
Reader = Callable[[Panorama, ViewSpec, Floats], Mapping[str, float]]
Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Masks, in pixels of the view
LEAST_SIDE_PX = 5.0  # of a quadrilateral
LEAST_FILLED_SHARE = 0.8  # of a quadrilateral by its mask

# Sides, measured in the rectified sign
OVERSAMPLING, MARGIN_SHARE = 2.0, 0.35  # of the panorama's pixels; of the sign's shorter side
SIGMA_EDGE_PX, SIGMA_MASK_PX = 0.35, 4.0  # pixels of the view, of a side that is found and of one that is not
COARSE_SHARE, COARSE_PX, FINE_PX = (
    0.16,
    (2.0, 6.0),
    1.5,
)  # reach to either side: of the shortest side within limits; then
COLUMNS, PEAKS = 40, 4  # samples along a side; edges kept in each
LEAST_GRADIENT = 1.0  # grey levels per half pixel of the patch
LEAST_INLIER_SHARE, LEAST_SCORE_SHARE = 0.6, 0.75  # of the columns; of the best line's score
INLIER_PX = 1.0  # pixels of the panorama


def extract_features(
    view: View, detections: Sequence[Detection], panorama: Panorama | None, read: Reader | None
) -> list[Feature]:
    """Four points for each sign that the view shows whole, in the order of `PARTS`; the first carries what `read` says.

    Without a panorama the corners stay where the mask has them, and nothing is read.
    """
    return [
        feature
        for instance, detection in enumerate(detections)
        if (quad := quad_of_mask(detection.mask)) is not None
        for feature in _sign_features(view, detection, instance, quad, panorama, read)
    ]


def _sign_features(
    view: View, detection: Detection, instance: int, quad: Floats, panorama: Panorama | None, read: Reader | None
) -> list[Feature]:
    covariances = _mask_covariances()
    readings: Mapping[str, float] = {}
    if panorama is not None:
        quad, covariances = refine_corners(panorama, view.spec, quad)
        readings = read(panorama, view.spec, quad) if read else {}
    return [
        Feature(
            view.frame,
            view.spec.name,
            detection.label,
            part,
            instance,
            quad[number][None],
            covariances[number][None],
            score=detection.score,
            readings=readings if number == 0 else {},
        )
        for number, part in enumerate(PARTS)
    ]


def quad_of_mask(mask: Mask) -> Floats | None:
    """Corners (4, 2) px of a mask (h, w), clockwise from the upper left; None if the picture's border cuts the mask, if
    it is tiny, or if it is not a quadrilateral."""
    if touches_border(mask):
        return None
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=cv2.contourArea)
    corners = _hull_corners(np.asarray(cv2.convexHull(outline), np.int32))
    area = float(cv2.contourArea(corners.astype(np.float32)))
    if _side_lengths(corners).min() < LEAST_SIDE_PX or mask.sum() < LEAST_FILLED_SHARE * area:
        return None
    # from the centres of the outermost pixels to their outer borders
    return _clockwise(corners + 0.5 * np.sign(corners - corners.mean(axis=0)))


def _hull_corners(hull: NDArray[np.int32]) -> Floats:
    """Of its simplest approximation that has four corners (4, 2), else of the smallest rectangle around it."""
    perimeter = cv2.arcLength(hull, True)
    for share in np.arange(0.02, 0.12, 0.01):
        polygon = cv2.approxPolyDP(hull, share * perimeter, True)
        if len(polygon) == 4:
            return polygon.reshape(4, 2).astype(np.float64)
        if len(polygon) < 4:
            break
    return np.asarray(cv2.boxPoints(cv2.minAreaRect(hull)), np.float64)


def _clockwise(corners: Floats) -> Floats:
    """Corners (4, 2) clockwise as the picture shows them, from the upper left."""
    offsets = corners - corners.mean(axis=0)
    ordered = corners[np.argsort(np.arctan2(offsets[:, 1], offsets[:, 0]), kind="stable")]
    return np.roll(ordered, -int(np.argmin(ordered.sum(axis=1))), axis=0)


def _side_lengths(corners: Floats) -> Floats:
    """Lengths (4,) of the sides of corners (4, d): upper, right, lower, left."""
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1), np.float64)


@dataclass(frozen=True, eq=False)
class Patch:
    """A sign rectified: a grey picture (h, w) in which a quadrilateral of a view fills `inner` (left, top, right,
    bottom; px).

    view_from_patch (3, 3) is a homography; `scale` is pixels of the patch per pixel of the panorama.
    """

    image: Grey
    inner: tuple[float, float, float, float]
    view_from_patch: Floats
    scale: float

    def to_view(self, points: Floats) -> Floats:
        """Points (n, 2) of the patch in the view, px."""
        return _transformed(self.view_from_patch, points)


def _transformed(homography: Floats, points: Floats) -> Floats:
    """Points (n, 2) under a homography (3, 3)."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:], np.float64)


def size_in_panorama(quad: Floats, spec: ViewSpec, panorama_height: int) -> tuple[float, float]:
    """Approximate width and height, in pixels of the panorama, of a quadrilateral (4, 2) px of a view."""
    sides = _side_lengths(spec.rig_rays(quad)) * panorama_height / np.pi
    return float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())


def rectify(
    panorama: Panorama, spec: ViewSpec, quad: Floats, size: tuple[float, float], margin: float, scale: float
) -> Patch:
    """Rectify a quadrilateral (4, 2) px of a view whose `size` (width, height) is in pixels of the panorama.

    The patch is `scale` times as fine as the panorama, with a margin around the sign that is this share of its shorter
    side.
    """
    width, height = (max(round(scale * side), 8) for side in size)
    edge = round(margin * min(width, height))
    inner = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) + edge - 0.5
    view_from_patch = np.asarray(cv2.getPerspectiveTransform(inner, quad.astype(np.float32)), np.float64)
    rows, columns = np.mgrid[: height + 2 * edge, : width + 2 * edge]
    pixels = _transformed(view_from_patch, np.stack([columns.ravel(), rows.ravel()], axis=1))
    source = panorama_pixels_from_rays(spec.rig_rays(pixels), panorama.height)
    u, v = np.ascontiguousarray(source.T.reshape(2, *rows.shape), np.float32)
    image = cv2.remap(_grey(panorama), u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    box = (edge - 0.5, edge - 0.5, edge + width - 0.5, edge + height - 0.5)
    return Patch(np.asarray(image, np.uint8), box, view_from_patch, scale)


def _grey(panorama: Panorama) -> Grey:
    if isinstance(panorama, FilmedPanorama):
        return panorama.planes.luma
    return np.asarray(panorama.image[..., 1], np.uint8)


def refine_corners(panorama: Panorama, spec: ViewSpec, quad: Floats) -> tuple[Floats, Floats]:
    """Corners (4, 2) px of a quadrilateral of a view, measured in the panorama, and their covariances (4, 2, 2).

    Sides are searched for widely, then near where they were found. A side that is not found stays as the mask has it,
    with `SIGMA_MASK_PX`.
    """
    coarse_px = float(np.clip(COARSE_SHARE * _side_lengths(quad).min(), *COARSE_PX))
    coarse, coarse_measured = _measure_sides(panorama, spec, quad, coarse_px)
    if not coarse_measured.any():
        return quad, _mask_covariances()
    corners, fine_measured = _measure_sides(panorama, spec, coarse, FINE_PX)
    sigmas = np.where(coarse_measured & fine_measured, SIGMA_EDGE_PX, SIGMA_MASK_PX)
    return corners, np.array([_corner_covariance(corners, number, sigmas) for number in range(4)])


def _mask_covariances() -> Floats:
    return np.tile(SIGMA_MASK_PX**2 * np.eye(2), (4, 1, 1))


def _measure_sides(
    panorama: Panorama, spec: ViewSpec, quad: Floats, reach_px: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Corners (4, 2) px, with each side searched for up to `reach_px` of the view to either side, and which sides (4,)
    were found."""
    size = size_in_panorama(quad, spec, panorama.height)
    patch = rectify(panorama, spec, quad, size, MARGIN_SHARE, OVERSAMPLING)
    width_px = float(np.linalg.norm(quad[[1, 2]] - quad[[0, 3]], axis=1).mean())
    patch_px_per_view_px = OVERSAMPLING * size[0] / max(width_px, 1.0)
    sides = [_measure_side(patch, number, reach_px * patch_px_per_view_px) for number in range(4)]
    corners = np.array([_intersection(sides[number - 1][0], sides[number][0]) for number in range(4)])
    return patch.to_view(corners), np.array([measured for _, measured in sides])


def _measure_side(patch: Patch, number: int, reach: float) -> tuple[Floats, bool]:
    """Two points (2, 2) px of the patch on a side (0 upper, 1 right, 2 lower, 3 left), and whether the side was
    found."""
    left, top, right, bottom = patch.inner
    horizontal = number % 2 == 0
    image = patch.image if horizontal else np.ascontiguousarray(patch.image.T)
    ends = np.array([left, right] if horizontal else [top, bottom])
    expected = (top, right, bottom, left)[number]
    columns = np.linspace(ends[0] + 0.08 * np.ptp(ends), ends[1] - 0.08 * np.ptp(ends), COLUMNS)
    outwards = (-1, 1, 1, -1)[number]
    edges = _edge_candidates(image, columns, expected, reach)
    line = _outermost_line(columns, edges, reach, outwards, patch.scale * INLIER_PX)
    slope, middle = line or (0.0, 0.0)
    heights = expected + middle + slope * (ends - columns.mean())
    return np.column_stack([ends, heights] if horizontal else [heights, ends]), line is not None


def _edge_candidates(image: Grey, columns: Floats, expected: float, reach: float) -> Floats:
    """Where brightness changes most across a side that is expected at row `expected`: for each of the columns (n,) the
    `PEAKS` strongest places (n, k), relative to `expected`; nan where there are fewer."""
    steps = np.arange(-1.6 * reach, 1.6 * reach + 0.01, 0.5)
    u, v = np.meshgrid(columns.astype(np.float32), (expected + steps).astype(np.float32))
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    profile = cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    gradient = np.abs(np.gradient(profile, axis=0))
    before, at, after = gradient[:-2], gradient[1:-1], gradient[2:]
    is_peak = (at > before) & (at >= after) & (at > LEAST_GRADIENT)
    bend = np.where(is_peak, before - 2 * at + after, -1.0)
    places = steps[1:-1, None] + 0.5 * np.clip(0.5 * (before - after) / np.minimum(bend, -1e-9), -1, 1)
    strongest = np.argsort(np.where(is_peak, -at, np.inf), axis=0)[:PEAKS]
    chosen = np.take_along_axis(np.where(is_peak, places, np.nan), strongest, axis=0)
    return np.asarray(chosen.T, np.float64)


def _outermost_line(
    columns: Floats, edges: Floats, reach: float, outwards: int, tolerance: float
) -> tuple[float, float] | None:
    """Slope and height at the middle of the outermost of the lines on which the columns' edges (n, k) agree almost as
    well as on the best line; None if they agree on none. A printed border has lines of its own further inside, and
    lines far from where the mask has the side count less."""
    offsets = columns - columns.mean()
    slopes, heights = _line_hypotheses(columns, edges)
    plausible = np.isfinite(heights) & (np.abs(slopes) * np.ptp(columns) < 2 * reach)
    slopes, heights = slopes[plausible], heights[plausible]
    if not len(slopes):
        return None
    places = np.where(np.isfinite(edges), edges, np.inf)
    lines = heights[:, None] + slopes[:, None] * offsets[None]
    residuals = np.abs(places[None] - lines[..., None]).min(axis=-1)
    inliers = (residuals < tolerance).mean(axis=1)
    scores = np.clip(1 - residuals / tolerance, 0, 1).mean(axis=1) * np.exp(-0.5 * (heights / reach) ** 2)
    good = (inliers >= LEAST_INLIER_SHARE) & (scores >= LEAST_SCORE_SHARE * scores.max())
    if not good.any():
        return None
    outermost = (outwards * heights[good]).max()
    near = good & (outwards * heights > outermost - tolerance)
    return _fit_line(offsets, places, lines[int(np.where(near, scores, -1.0).argmax())], tolerance)


def _line_hypotheses(columns: Floats, edges: Floats) -> tuple[Floats, Floats]:
    """Slopes (m,), and heights (m,) at the middle, of the lines through an edge in the first third of the columns and
    one in the last; nan where a column has fewer edges."""
    third = len(columns) // 3
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(third), np.arange(len(columns) - third, len(columns))))
    starts, ends = edges[a][:, :, None], edges[b][:, None, :]
    slopes = (ends - starts) / (columns[b] - columns[a])[:, None, None]
    heights = starts - slopes * (columns - columns.mean())[a][:, None, None]
    return slopes.ravel(), heights.ravel()


def _fit_line(offsets: Floats, edges: Floats, line: Floats, tolerance: float) -> tuple[float, float]:
    """Slope and height at the middle, by least squares, of the edges (n, k) that lie within a tolerance of a line
    (n,)."""
    nearest = np.abs(edges - line[:, None]).argmin(axis=1)
    heights = np.take_along_axis(edges, nearest[:, None], 1)[:, 0]
    inliers = np.abs(heights - line) < tolerance
    slope, height = np.polyfit(offsets[inliers], heights[inliers], 1)
    return float(slope), float(height)


def _intersection(first: Floats, second: Floats) -> Floats:
    """The point (2,) where two lines meet, each given by two points (2, 2)."""
    system = np.column_stack([first[1] - first[0], second[0] - second[1]])
    share = np.linalg.solve(system, second[0] - first[0])[0]
    point: Floats = first[0] + share * (first[1] - first[0])
    return point


def _corner_covariance(corners: Floats, number: int, sigmas: Floats) -> Floats:
    """Covariance (2, 2) px^2 of a corner between two sides, each with a standard deviation (4,) px across itself."""
    information: Floats = np.zeros((2, 2))
    for side, neighbour in ((number - 1, corners[number - 1]), (number, corners[(number + 1) % 4])):
        along = (neighbour - corners[number]) / max(float(np.linalg.norm(neighbour - corners[number])), 1e-9)
        normal = np.array([-along[1], along[0]])
        information += np.outer(normal, normal) / sigmas[side] ** 2
    return np.asarray(np.linalg.inv(information + 1e-3 * np.eye(2)), np.float64)
