"""Uprights on the common axis of all frames: how many there are, and which sighting is of which (paper, III.D)."""

from dataclasses import dataclass

import numpy as np

from savmap.types import Floats, Ints
from savmap_shelves.tracking.density import cheapest_in_group, medians, modes, nearest
from savmap_shelves.tracking.sightings import FaceSightings, Sightings

KERNEL, REACH = 0.06, 0.18
"""Of an upright's sightings along x, as shares of the distance from one to the next."""
LEAST_SIGHTINGS, LEAST_SHARE = 3, 0.25
"""Of an upright, and as a share of what is usual."""


@dataclass(frozen=True, eq=False)
class Uprights:
    """Uprights, left to right: x (k, 2) of their left and right edges; which upright each sighting (n,) is of, or -1."""

    x: Floats
    which: Ints

    def ends_of(self, sightings: Sightings) -> Ints:
        """Which uprights each sighted beam ends at (m, 2), -1 where that is not known."""
        return np.where(sightings.bounds >= 0, np.append(self.which, -1)[sightings.bounds], -1)


def find_uprights(sightings: FaceSightings, states: Floats, frames: Ints, spacing: float) -> Uprights:
    """Uprights that were sighted often enough in `frames`. spacing: of the uprights, in x."""
    state = states[sightings.upright_frame]
    x = (sightings.horizon() + state[:, 1:2]) / state[:, :1]
    usable = np.isin(sightings.upright_frame, frames) & np.isfinite(x).all(axis=1)
    centre = np.where(usable, x.mean(axis=1), np.nan)
    centres = modes(centre[usable], KERNEL * spacing)
    picture = sightings.upright_frame * len(sightings.views) + sightings.upright_view
    while True:
        which = nearest(centre, centres, REACH * spacing)
        which = cheapest_in_group(picture, which, np.abs(centre - np.append(centres, np.nan)[which]))
        count = np.bincount(which[which >= 0], minlength=len(centres))
        sure = count >= max(LEAST_SIGHTINGS, LEAST_SHARE * np.median(count) if len(count) else 0.0)
        if sure.all():
            return Uprights(medians(x, which, len(centres)), which)
        centres = centres[sure]
