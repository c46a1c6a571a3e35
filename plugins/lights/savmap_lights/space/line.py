"""The plane and the line of the lamps, by a sweep through heights: at the right one, all frames' sightings coincide."""

from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import Bools, Floats, Ints, Sightings, StructureError, gathering_level
from savmap.vision import peaks

HEIGHTS_M = (0.5, 20.0)
SAME = 0.024
"""Of the height: how near marks of one lamp fall there."""
NEAR_M = 2.5
SAME_LINE_M = 0.4
LEAST_OF_BEST = 0.25
LEAST_FRAMES = 3


@dataclass(frozen=True, eq=False)
class Marks:
    """Sightings of ends and centres of lamps. `outward` (n, 2): the direction along x and z, 0 or +-1, in which a lamp
    ends there; (0, 0) for centres. `middles` (n, 2): the slopes of the rays to the middle of the visible part of each
    one's lamp."""

    sightings: Sightings
    outward: Ints
    middles: Floats

    def where(self, keep: Bools) -> "Marks":
        """The marks for which a mask (n,) is true."""
        return replace(
            self, sightings=self.sightings.where(keep), outward=self.outward[keep], middles=self.middles[keep]
        )

    def sideways(self, level_m: float) -> Floats:
        """z (n,) m of the lamps' middles at a level."""
        origins = self.sightings.origins
        return np.asarray(origins[:, 2] + (level_m - origins[:, 1]) * self.middles[:, 1])

    @property
    def kind(self) -> Ints:
        """A number (n,) for each outward direction."""
        return np.asarray(3 * self.outward[:, 0] + self.outward[:, 1])


def marks_of(sightings: Sightings) -> Marks:
    """The ends of strips, and the centres of compact lamps. An end points away from the middle of the visible part of
    its strip."""
    middles = {
        (feature.frame, feature.view, feature.instance): slope
        for feature, slope in zip(sightings.features, sightings.slopes, strict=True)
        if feature.part == "middle"
    }
    outward = np.zeros((len(sightings.features), 2), np.int64)
    towards = sightings.slopes.copy()
    kept = np.zeros(len(sightings.features), np.bool_)
    for index, (feature, slope) in enumerate(zip(sightings.features, sightings.slopes, strict=True)):
        middle = middles.get((feature.frame, feature.view, feature.instance))
        kept[index] = feature.part == "centre" if middle is None else feature.part.startswith("end")
        if middle is not None and kept[index]:
            towards[index] = middle
            axis = int(np.argmax(np.abs(slope - middle)))
            outward[index, axis] = int(np.sign(slope[axis] - middle[axis]))
    return Marks(sightings.where(kept), outward[kept], towards[kept])


def level_of(marks: Marks) -> float:
    """The height, m, at which marks of one kind over the aisle fall on one another best."""
    return gathering_level(marks.sightings, HEIGHTS_M, marks.kind, lambda level_m: over_aisle(marks, level_m))


def over_aisle(marks: Marks, level_m: float) -> Bools:
    """Whether each mark's (n,) lamp, at a level, would be in front of the face and not far aside of the camera."""
    z = marks.sideways(level_m)
    near: Bools = (z > 0) & (np.abs(z - marks.sightings.origins[:, 2]) < NEAR_M)
    return near


def line_of(marks: Marks, level_m: float) -> float:
    """z of the line of lamps, parallel to x, that is nearest to the camera's path, of those with marks that many frames
    agree on.

    Raises StructureError where there is none."""
    places, above = marks.sightings.at(level_m), level_m - float(marks.sightings.origins[:, 1].mean())
    weight = np.minimum(_partners(marks, places, SAME * above), 10) * marks.sightings.certainty
    z = marks.sideways(level_m)
    weight[(_partners(marks, places, SAME * above) < LEAST_FRAMES - 1) | ~over_aisle(marks, level_m)] = 0.0
    firm = z[weight > 0]
    lines = peaks.peaks(firm, SAME_LINE_M, LEAST_FRAMES)
    if not len(lines):
        raise no_lamp()
    support = np.array([weight[np.abs(z - line) <= SAME_LINE_M].sum() for line in lines])
    good = lines[support >= LEAST_OF_BEST * support.max()]
    return float(good[np.argmin(np.abs(good - np.median(marks.sightings.origins[:, 2])))])


def _partners(marks: Marks, places: Floats, width_m: float) -> Ints:
    """The number of other frames in which each mark (n,) has one of its kind within `width_m` at a level."""
    near = (np.abs(places[:, None] - places[None]) <= width_m).all(axis=-1) & (marks.kind[:, None] == marks.kind[None])
    frames, index = np.unique(marks.sightings.frames, return_inverse=True)
    counts = np.zeros((len(places), len(frames)), np.int64)
    np.maximum.at(counts.T, index, near.T.astype(np.int64))
    return np.asarray(counts.sum(axis=1) - 1)


def no_lamp() -> StructureError:
    """The error for a row in which no lamps are found."""
    return StructureError(
        "no three frames show a lamp in one place: does the ceiling view show lamps, and was the network trained on "
        "such?"
    )
