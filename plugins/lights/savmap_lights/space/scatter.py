"""How far rays to one place scatter aside of the line of lamps: what lies far off is left out, the others count for as much as they agree."""

import numpy as np

from savmap.plugin import Bools, Floats, Ints

FAR = 4.7
MAD_TO_SIGMA = 1.48


def scatter(aside: Floats, sigma: Floats, place: Ints, kept: Bools) -> tuple[Bools, Floats]:
    """Which of the rays (n,) that were kept agree aside, m, with the others to their places, and by how much (n,), at least 1, those to
    each place scatter more than their standard deviations, m."""
    agree, wider = kept.copy(), np.ones(len(aside))
    for number in np.unique(place[kept]):
        own = place == number
        errors = np.abs(aside - np.median(aside[own & kept])) / sigma
        wider[own] = max(1.0, MAD_TO_SIGMA * float(np.median(errors[own & kept])))
        agree[own] &= errors[own] < FAR * wider[own]
    return agree, wider
