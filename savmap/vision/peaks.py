"""Peaks of one-dimensional values: where many of them agree, such as the places of one object in many frames."""

import numpy as np

from savmap.types import Floats


def peaks(values: Floats, width: float, support: int) -> Floats:
    """Positions, in order, that at least `support` of the values (n,) agree on within `width`: each is the median of
    what lies within `width` of a local maximum of their kernel density, and peaks are at least 2 `width` apart."""
    left = np.sort(values)
    positions: list[float] = []
    while len(left) >= support:
        counts = np.searchsorted(left, left + width, "right") - np.searchsorted(left, left - width, "left")
        if counts.max() < support:
            break
        best = left[np.argmax(counts)]
        middle = float(np.median(left[np.abs(left - best) <= width]))
        if all(abs(middle - other) >= 2 * width for other in positions):
            positions.append(middle)
        left = (
            left[np.abs(left - middle) > 2 * width]
            if abs(best - middle) <= width
            else left[np.abs(left - best) > width]
        )
    return np.sort(np.array(positions))
