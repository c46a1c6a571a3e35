"""What paint says of a face's cells: members of one class have one paint in the light of one row."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from savmap.types import Bools, Floats

BIN, BINS, SMOOTH = 8, 32, 1.0
"""CIELAB values in a bin, bins along each axis, and how many bins colours are smoothed over."""
UNSEEN = 1e-7
"""Added to densities: a colour that neither has tells nothing."""


def paint_ratios(
    picture: NDArray[np.uint8], members: Sequence[Bools], groups: Sequence[Bools], limit: float
) -> list[Floats]:
    """For each group of cells the log ratio (rows, columns), at most `limit`, of how often each cell's colour is among
    the members of the other groups, and among all other cells of those; 0 where there are no others.

    picture (rows, columns, 3) RGB; members, groups: cells (rows, columns) of each group's members, and of all of it.
    """
    colours = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2LAB).astype(np.intp) // BIN
    cells = (colours[..., 0] * BINS + colours[..., 1]) * BINS + colours[..., 2]
    inside = np.array([_counts(cells[member]) for member in members])
    outside = np.array([_counts(cells[group & ~member]) for member, group in zip(members, groups, strict=True)])
    ratios = []
    for number in range(len(members)):
        same, others = (_density(np.delete(counts, number, axis=0).sum(axis=0)) for counts in (inside, outside))
        table = (
            np.clip(np.log((same + UNSEEN) / (others + UNSEEN)), -limit, limit)
            if same.any() and others.any()
            else 0 * same
        )
        ratios.append(np.asarray(table.ravel()[cells], np.float64))
    return ratios


def _counts(cells: NDArray[np.intp]) -> Floats:
    return np.bincount(cells, minlength=BINS**3).astype(np.float64)


def _density(counts: Floats) -> Floats:
    total = counts.sum()
    return np.asarray(gaussian_filter(counts.reshape(BINS, BINS, BINS) / max(total, 1.0), SMOOTH), np.float64)
