"""Which of many views to label: those that promise most, unlike one another and spread over the recording."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST_WORTH = 0.25


def ranks(values: Floats) -> Floats:
    """Each value's rank (n,) as a share, 0 for the least and 1 for the greatest; equal ones share theirs."""
    distinct, place = np.unique(values, return_inverse=True)
    found: Floats = place / max(len(distinct) - 1, 1)
    return found


def chosen(worth: Floats, features: Floats, count: int) -> list[int]:
    """Up to `count` indices, in order, of views with what each promises (n,), 0..1, and what it looks like (n, d).

    Farthest-point sampling, weighted: first the one that promises most, then again and again the one that is farthest from all taken,
    times what it promises (but not less than a quarter, so that what the network is wrongly sure of has a chance). Equal to one
    that was taken: not taken.
    """
    if not len(worth):
        return []
    taken = [int(np.argmax(worth))]
    apart = np.linalg.norm(features - features[taken[0]], axis=1)
    while len(taken) < count:
        gain = apart * np.maximum(worth, LEAST_WORTH)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        taken.append(best)
        apart = np.minimum(apart, np.linalg.norm(features - features[best], axis=1))
    return sorted(taken)
