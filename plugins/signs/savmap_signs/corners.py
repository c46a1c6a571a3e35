"""The four corners of a sign at the panorama's own resolution: each side is the straight line on which brightness changes most,
near where the mask has it, and corners are where sides meet."""

import cv2
import numpy as np

from savmap.types import Floats, Panorama, ViewSpec
from savmap_signs.patches import Patch, patch_of, source_size

FINENESS = 2.0
MARGIN = 0.35
REACH_PX = 2.2
SIGMA_FOUND_PX, SIGMA_MASK_PX = 0.35, 1.5
LEAST_SHARE = 0.5
SAMPLES = 40
CLOSE_PX = 1.0
LEAST_CHANGE = 1.0


def refined(panorama: Panorama, spec: ViewSpec, quad: Floats) -> tuple[Floats, Floats]:
    """Corners (4, 2) of a quadrilateral of a view, px, and their covariances (4, 2, 2): sides that are not found in the panorama
    stay where the mask has them, and are known less well."""
    size = source_size(quad, spec, panorama.height)
    patch = patch_of(panorama, spec, quad, size, MARGIN, FINENESS)
    view_px = FINENESS * size[0] / max(float(np.linalg.norm(quad[[1, 2]] - quad[[0, 3]], axis=1).mean()), 1.0)
    found = [_side(patch, number, REACH_PX * view_px) for number in range(4)]
    lines = [line for line, _ in found]
    if not all(np.isfinite(line).all() for line in lines):
        return quad, np.tile(SIGMA_MASK_PX**2 * np.eye(2), (4, 1, 1))
    corners = patch.to_view(np.array([_meeting(lines[number - 1], lines[number]) for number in range(4)]))
    sigmas = [SIGMA_FOUND_PX if sure else SIGMA_MASK_PX for _, sure in found]
    return corners, np.array([_covariance(corners, number, sigmas) for number in range(4)])


def _side(patch: Patch, number: int, reach: float) -> tuple[Floats, bool]:
    """A side's two ends (2, 2) px of the patch, and whether it was found; 0 above, 1 right, 2 below, 3 left."""
    left, top, right, bottom = patch.inner
    lying = number % 2 == 0
    image = patch.image if lying else patch.image.T
    first, last = (left, right) if lying else (top, bottom)
    expected = (top, right, bottom, left)[number]
    along = np.linspace(first + 0.08 * (last - first), last - 0.08 * (last - first), SAMPLES)
    across, sure = _changes(np.ascontiguousarray(image), along, expected, reach)
    slope, middle, agreed = _fitted(along, across, sure, patch.fineness * CLOSE_PX)
    ends = np.array([first, last])
    if not agreed or abs(slope * (ends[1] - ends[0])) > 2 * reach:
        slope, middle = 0.0, expected
    heights = middle + slope * (ends - along.mean())
    line = np.column_stack([ends, heights] if lying else [heights, ends])
    return line, agreed


def _changes(image: np.ndarray, along: Floats, expected: float, reach: float) -> tuple[Floats, Floats]:
    """Where, across a side that lies at row `expected`, brightness changes most at the columns `along` (n,), and by how much."""
    steps = np.arange(-2.5 * reach, 2.5 * reach + 0.01, 0.5)
    columns = np.repeat(along[None], len(steps), axis=0).astype(np.float32)
    rows = np.repeat((expected + steps)[:, None], len(along), axis=1).astype(np.float32)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    profile = cv2.remap(smooth, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    change = np.abs(np.gradient(profile, axis=0))
    weighted = change * np.exp(-0.5 * (steps / reach) ** 2)[:, None]
    best = np.clip(weighted.argmax(axis=0), 1, len(steps) - 2)
    index = np.arange(len(along))
    before, at, after = (change[best + shift, index] for shift in (-1, 0, 1))
    bend = before - 2 * at + after
    shift = np.where(np.abs(bend) > 1e-9, 0.5 * (before - after) / np.where(bend == 0, 1.0, bend), 0.0)
    return expected + steps[best] + 0.5 * np.clip(shift, -1, 1), at


def _fitted(along: Floats, across: Floats, strength: Floats, close: float) -> tuple[float, float, bool]:
    """Slope, height at the middle, and whether most points agree on the line: the one that most do, by pairs, then fitted."""
    middle = along.mean()
    count = len(along)
    first, second = np.triu_indices(count, count // 3)
    slopes = (across[second] - across[first]) / (along[second] - along[first])
    heights = across[first] + slopes * (middle - along[first])
    off = np.abs(across[None] - heights[:, None] - slopes[:, None] * (along - middle)[None])
    score = (np.clip(1 - off / close, 0, 1) * np.minimum(strength, 4.0)).sum(axis=1)
    best = int(score.argmax())
    near = (off[best] < close) & (strength > LEAST_CHANGE)
    if near.sum() < LEAST_SHARE * count:
        return 0.0, 0.0, False
    slope, height = np.polyfit(along[near] - middle, across[near], 1)
    return float(slope), float(height), True


def _meeting(one: Floats, other: Floats) -> Floats:
    """Where two lines, through two points (2, 2) each, meet."""
    system = np.column_stack([one[1] - one[0], other[0] - other[1]])
    share = np.linalg.solve(system, other[0] - one[0])[0]
    point: Floats = one[0] + share * (one[1] - one[0])
    return point


def _covariance(corners: Floats, number: int, sigmas: list[float]) -> Floats:
    """Covariance (2, 2) of a corner between the sides before and after it, each known across itself."""
    information = np.zeros((2, 2))
    for side, far in ((number - 1, corners[number - 1]), (number, corners[(number + 1) % 4])):
        along = (far - corners[number]) / max(float(np.linalg.norm(far - corners[number])), 1e-9)
        normal = np.array([-along[1], along[0]])
        information += np.outer(normal, normal) / sigmas[side] ** 2
    covariance: Floats = np.asarray(np.linalg.inv(information + 1e-3 * np.eye(2)), np.float64)
    return covariance
