"""The four corners of a sign at the panorama's own resolution: each side is the straight line on which brightness changes most,
near where the mask has it, and corners are where sides meet."""

import cv2
import numpy as np

from savmap.types import Floats, Panorama, ViewSpec
from savmap_signs.patches import Grey, Patch, patch_of, source_size

FINENESS = 2.0
MARGIN = 0.35
SIGMA_FOUND_PX, SIGMA_MASK_PX = 0.35, 4.0
COARSE_SHARE, COARSE_PX, FINE_PX = 0.16, (2.0, 6.0), 1.5
SAMPLES, PEAKS = 40, 4
LEAST_CHANGE = 1.0
LEAST_SHARE, ALMOST = 0.6, 0.75
CLOSE_PX = 1.0


def refined(panorama: Panorama, spec: ViewSpec, quad: Floats) -> tuple[Floats, Floats]:
    """Corners (4, 2) of a quadrilateral of a view, px, and their covariances (4, 2, 2): sides that are not found in the panorama
    stay where the mask has them, and are known less well. They are looked for widely, then near where they were found."""
    sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    wide = float(np.clip(COARSE_SHARE * sides.min(), *COARSE_PX))
    coarse, found = _measured(panorama, spec, quad, wide)
    if not any(found):
        return quad, np.tile(SIGMA_MASK_PX**2 * np.eye(2), (4, 1, 1))
    corners, again = _measured(panorama, spec, coarse, FINE_PX)
    sure = [one and other for one, other in zip(found, again, strict=True)]
    return corners, np.array([_covariance(corners, n, [_sigma(one) for one in sure]) for n in range(4)])


def _sigma(found: bool) -> float:
    return SIGMA_FOUND_PX if found else SIGMA_MASK_PX


def _measured(panorama: Panorama, spec: ViewSpec, quad: Floats, reach_px: float) -> tuple[Floats, list[bool]]:
    """Corners (4, 2) px, with sides looked for up to `reach_px` of the view to either side, and which sides were found."""
    size = source_size(quad, spec, panorama.height)
    patch = patch_of(panorama, spec, quad, size, MARGIN, FINENESS)
    view_px = FINENESS * size[0] / max(float(np.linalg.norm(quad[[1, 2]] - quad[[0, 3]], axis=1).mean()), 1.0)
    found = [_side(patch, number, reach_px * view_px) for number in range(4)]
    lines = [line for line, _ in found]
    corners = np.array([_meeting(lines[number - 1], lines[number]) for number in range(4)])
    return patch.to_view(corners), [sure for _, sure in found]


def _side(patch: Patch, number: int, reach: float) -> tuple[Floats, bool]:
    """A side's two ends (2, 2) px of the patch, and whether it was found; 0 above, 1 right, 2 below, 3 left."""
    left, top, right, bottom = patch.inner
    lying = number % 2 == 0
    image = patch.image if lying else np.ascontiguousarray(patch.image.T)
    ends = np.array([left, right] if lying else [top, bottom])
    expected = (top, right, bottom, left)[number]
    along = np.linspace(ends[0] + 0.08 * np.ptp(ends), ends[1] - 0.08 * np.ptp(ends), SAMPLES)
    outwards = (-1, 1, 1, -1)[number]
    line = _outermost(along, _changes(image, along, expected, reach), reach, outwards, patch.fineness * CLOSE_PX)
    slope, middle = line or (0.0, 0.0)
    heights = expected + middle + slope * (ends - along.mean())
    return np.column_stack([ends, heights] if lying else [heights, ends]), line is not None


def _changes(image: Grey, along: Floats, expected: float, reach: float) -> Floats:
    """Where brightness changes most across a side that lies at row `expected`: for the columns `along` (n,) the strongest few
    places (n, k), from `expected`; nan where there are fewer."""
    steps = np.arange(-1.6 * reach, 1.6 * reach + 0.01, 0.5)
    u = np.repeat(along[None], len(steps), axis=0).astype(np.float32)
    v = np.repeat((expected + steps)[:, None], len(along), axis=1).astype(np.float32)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    profile = cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    change = np.abs(np.gradient(profile, axis=0))
    before, at, after = change[:-2], change[1:-1], change[2:]
    peak = (at > before) & (at >= after) & (at > LEAST_CHANGE)
    bend = np.where(peak, before - 2 * at + after, -1.0)
    places = steps[1:-1, None] + 0.5 * np.clip(0.5 * (before - after) / np.minimum(bend, -1e-9), -1, 1)
    order = np.argsort(np.where(peak, -at, np.inf), axis=0)[:PEAKS]
    chosen = np.where(np.take_along_axis(peak, order, 0), np.take_along_axis(places, order, 0), np.nan).T
    return np.asarray(chosen, np.float64)


def _outermost(along: Floats, places: Floats, reach: float, outwards: int, close: float) -> tuple[float, float] | None:
    """Slope and height at the middle of the outermost of the lines that many columns' places (n, k) agree on nearly as well as on
    the best; lines far from where the mask has the side count less. A printed border has lines of its own further in."""
    off_middle = along - along.mean()
    first, last = np.arange(SAMPLES // 3), np.arange(SAMPLES - SAMPLES // 3, SAMPLES)
    a, b = (grid.ravel() for grid in np.meshgrid(first, last))
    pairs = places[a][:, :, None], places[b][:, None, :]
    grades = (pairs[1] - pairs[0]) / (along[b] - along[a])[:, None, None]
    heights, slopes = (pairs[0] - grades * off_middle[a][:, None, None]).ravel(), grades.ravel()
    known = np.isfinite(heights) & (np.abs(slopes) * np.ptp(along) < 2 * reach)
    slopes, heights = slopes[known], heights[known]
    if not len(slopes):
        return None
    filled = np.where(np.isfinite(places), places, np.inf)
    lines = heights[:, None] + slopes[:, None] * off_middle[None]
    off = np.abs(filled[None] - lines[..., None]).min(axis=-1)
    share = (off < close).mean(axis=1)
    score = np.clip(1 - off / close, 0, 1).mean(axis=1) * np.exp(-0.5 * (heights / reach) ** 2)
    good = (share >= LEAST_SHARE) & (score >= ALMOST * score.max())
    if not good.any():
        return None
    outer = (outwards * heights[good]).max()
    near = good & (outwards * heights > outer - close)
    best = int(np.where(near, score, -1.0).argmax())
    return _fitted(off_middle, filled, lines[best], close)


def _fitted(off_middle: Floats, places: Floats, line: Floats, close: float) -> tuple[float, float]:
    """Slope and height of the places (n, k) that lie close to a line (n,)."""
    nearest = np.abs(places - line[:, None]).argmin(axis=1)
    own = np.take_along_axis(places, nearest[:, None], 1)[:, 0]
    used = np.abs(own - line) < close
    slope, height = np.polyfit(off_middle[used], own[used], 1)
    return float(slope), float(height)


def _meeting(one: Floats, other: Floats) -> Floats:
    """Where two lines, through two points (2, 2) each, meet."""
    system = np.column_stack([one[1] - one[0], other[0] - other[1]])
    share = np.linalg.solve(system, other[0] - one[0])[0]
    point: Floats = one[0] + share * (one[1] - one[0])
    return point


def _covariance(corners: Floats, number: int, sigmas: list[float]) -> Floats:
    """Covariance (2, 2) of a corner between the sides before and after it, each known across itself."""
    information: Floats = np.zeros((2, 2))
    for side, far in ((number - 1, corners[number - 1]), (number, corners[(number + 1) % 4])):
        along = (far - corners[number]) / max(float(np.linalg.norm(far - corners[number])), 1e-9)
        normal = np.array([-along[1], along[0]])
        information += np.outer(normal, normal) / sigmas[side] ** 2
    covariance: Floats = np.asarray(np.linalg.inv(information + 1e-3 * np.eye(2)), np.float64)
    return covariance
