"""The scatter of rays to one place across the line of lamps: outliers are left out, and the sigma of the others grows
with their scatter."""

import numpy as np

from savmap.plugin import Bools, Floats, Ints

FAR = 4.7
MAD_TO_SIGMA = 1.48


def scatter(sideways: Floats, sigma: Floats, place: Ints, kept: Bools) -> tuple[Bools, Floats]:
    """Whether each ray (n,) that was kept agrees, in its offset `aside` (n,) m, with the others to its place; and the
    ratio (n,), at least 1, of the scatter of each place's rays to their standard deviations `sigma` (n,) m."""
    agree, wider = kept.copy(), np.ones(len(sideways))
    for number in np.unique(place[kept]):
        of_place = place == number
        errors = np.abs(sideways - np.median(sideways[of_place & kept])) / sigma
        wider[of_place] = max(1.0, MAD_TO_SIGMA * float(np.median(errors[of_place & kept])))
        agree[of_place] &= errors[of_place] < FAR * wider[of_place]
    return agree, wider
