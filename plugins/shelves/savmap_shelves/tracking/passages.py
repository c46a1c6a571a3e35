"""Passages: sections without beams, through which racks behind are seen.

What lies behind the face moves on it as the camera sways, and what looks like one beam there is a different one from time to time. So no level of such
a section keeps its height as those of the other sections do; in a section of this row at least one does.
"""

import numpy as np

from savmap.types import Bools, Floats, Ints

LEAST_LEVELS, TIMES, LEAST_SCATTER = 2, 4.0, 0.4


def seen_through(section: Ints, scatter: Floats) -> Bools:
    """Which levels (k,) are seen through a passage: those of sections (k,) with several levels that all scatter by several times what is usual.

    scatter (k, 2): the median residual of each level's lower and upper edge, over its sigma.
    """
    least = scatter.min(axis=1)
    loose = least > max(LEAST_SCATTER, TIMES * float(np.median(least)))
    found = np.zeros(len(section), dtype=np.bool_)
    for number in np.unique(section):
        here = section == number
        found |= here & (here.sum() >= LEAST_LEVELS) & loose[here].all()
    return found
