"""How strong the evidence of a face is: on average over what was seen, along a level, and along a post."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from savmap.types import Bools, Floats, PlaneEvidence

Singles = NDArray[np.float32]


def seen_mean(values: Singles, weight: Singles, axis: int) -> Floats:
    """The mean along an axis over visible cells, 0 where there are none."""
    visible = weight > 0
    return np.asarray((values * visible).sum(axis=axis) / np.maximum(visible.sum(axis=axis), 1), np.float64)


def heights_of(evidence: PlaneEvidence) -> Floats:
    """y (rows,) of the face's cells."""
    return np.asarray(evidence.patch.origin[1] + evidence.patch.heights)


def across_of(evidence: PlaneEvidence) -> Floats:
    """x (columns,) of the face's cells."""
    return np.asarray(evidence.patch.origin[0] + evidence.patch.across)


def level_strength(evidence: PlaneEvidence, columns: Bools, low: float, high: float) -> float:
    """The greatest mean evidence of a beam over some columns, of the rows from `low` to `high`."""
    y = heights_of(evidence)
    cells = np.ix_((y > low) & (y < high), columns)
    return float(seen_mean(evidence.of("beam")[cells], evidence.weight[cells], 1).max(initial=0.0))


def post_heights(evidence: PlaneEvidence, post: Floats, least: float) -> Floats:
    """The y (n,) at which a post, x (2,) of its edges, shows by at least so much evidence."""
    x = across_of(evidence)
    columns = (x > post[0]) & (x < post[1])
    along = gaussian_filter1d(seen_mean(evidence.of("upright")[:, columns], evidence.weight[:, columns], 1), 1.0)
    return np.asarray(heights_of(evidence)[along >= least])
