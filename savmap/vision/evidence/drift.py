"""How far the outlines of expected objects lie beside what a network sees of these: the camera's path is only roughly known where they are expected.

All objects of a view move together, so that none is taken for what stands beside it.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.types import Floats
from savmap.vision.evidence.expected import Outlined, Singles, within_picture
from savmap.vision.networks.segmenter import Segmentation

REACH = 0.02
"""The largest drift, as a share of the view's width."""
COARSE_PX, FINE_PX, BLUR_PX = 2.0, 0.5, 2.0
LEAST_PX = 2.0
"""A smaller drift does not matter: objects are detected beside their outlines, too."""
LEAST_GAIN = 1.1
"""So many times as much must be seen at the moved outlines as at those given."""
SAMPLES = 24
HELD = 0.05
"""What the largest drift costs, as a share of what is seen: where only uprights show, nothing tells a drift along them."""


def drift_of(segmentation: Segmentation, outlines: Sequence[Outlined]) -> Floats:
    """The drift (2,) px by which outlines of a view must be moved to lie on what the network sees; 0 where that tells none."""
    lines = [
        (_blurred(probability), _middle_lines(probability, [line for thing, line in outlines if thing.label == label]))
        for label, probability in zip(segmentation.classes, segmentation.maps[1:], strict=True)
    ]
    lines = [(probability, points) for probability, points in lines if len(points)]
    if not lines:
        return np.zeros(2)
    reach = REACH * lines[0][0].shape[1]
    drift = np.zeros(2)
    for step, around in ((COARSE_PX, reach), (FINE_PX, COARSE_PX)):
        drift = _best(lines, drift + _grid(step, around), reach)
    given, moved = (float(_seen(lines, one[None])[0]) for one in (np.zeros(2), drift))
    is_clear = LEAST_PX < np.hypot(*drift) < reach and moved > LEAST_GAIN * given
    return drift if is_clear else np.zeros(2)


def _blurred(probability: Singles) -> Singles:
    """Probabilities that are greatest in the middle of what is seen."""
    return np.asarray(cv2.GaussianBlur(probability, (0, 0), BLUR_PX), np.float32)


def _grid(step: float, around: float) -> Floats:
    """Drifts (n, 2) px, a step apart."""
    steps = np.arange(-np.floor(around / step), np.floor(around / step) + 1) * step
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def _best(lines: Sequence[tuple[Singles, Floats]], drifts: Floats, reach: float) -> Floats:
    """That of some drifts (n, 2) with which most is seen."""
    cost = 1 - HELD * np.hypot(*drifts.T) / reach
    return np.asarray(drifts[(_seen(lines, drifts) * cost).argmax()])


def _seen(lines: Sequence[tuple[Singles, Floats]], drifts: Floats) -> Floats:
    """The sum (n,) of the probabilities at points (m, 2) px, moved by each of some drifts (n, 2)."""
    total = np.zeros(len(drifts))
    for probability, points in lines:
        places = (points[None] + drifts[:, None]).astype(np.float32)
        total += cv2.remap(probability, places, None, cv2.INTER_LINEAR).sum(axis=1)  # type: ignore[call-overload]
    return total


def _middle_lines(probability: Singles, outlines: Sequence[Floats]) -> Floats:
    """Points (m, 2) px along the middles of thin outlines, where these are in the picture."""
    shown = [within_picture(outline, probability.shape) for outline in outlines]
    middles = [_middle_line(outline) for outline in shown if len(outline) >= 3]
    points = np.concatenate([np.zeros((0, 2)), *middles])
    size = np.array(probability.shape[::-1])
    return np.asarray(points[((points >= 0) & (points < size)).all(axis=1)])


def _middle_line(outline: Floats) -> Floats:
    """Points (`SAMPLES`, 2) along the middle of the smallest rectangle around an outline (n, 2)."""
    corners = cv2.boxPoints(cv2.minAreaRect(outline.astype(np.float32)))
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    first = 0 if sides[0] < sides[1] else 1
    ends = [(corners[k] + corners[(k + 1) % 4]) / 2 for k in (first, first + 2)]
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    return np.asarray(ends[0] + share * (ends[1] - ends[0]), np.float64)
