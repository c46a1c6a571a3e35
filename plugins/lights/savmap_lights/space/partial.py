"""Compact lamps of which an object hides a part: their centres, by the visible side and the size of the other lamps.

A single frame does not say which side is hidden. Both centres are tried, and only the right one is the same in many
frames.

The middle of a lamp's picture is not that of the lamp. In an oblique view, the far side shows its lower edge and the
near side its upper edge, so that the picture reaches farther beyond the far side than before the near one. The growth
of the picture with obliqueness gives the thickness.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from savmap.plugin import Feature, Floats, Sightings

ALIKE, ALIKE_M = 0.06, 0.03
LEAST_SHOWN, MOST_JOINED = 0.4, 1.4
SAME_LINE_M = 0.4
FEWEST, ENOUGH = 3, 5
THINNEST_M, THICKEST_M = 0.02, 0.3
Instance = tuple[int, str, int]


@dataclass(frozen=True, eq=False)
class Sides:
    """The four sides of a compact lamp in a frame, two and two opposite: pixels (4, 2); places (4, 2), x and z m, at a
    level; the slopes (2,) of the ray to their middle, along x and z per metre upwards; `above_m`: the level's height
    above the camera."""

    pixels: Floats
    places: Floats
    slopes: Floats
    above_m: float

    @property
    def aslant(self) -> Floats:
        """The obliqueness (2,) of the view along x and z: the absolute slopes."""
        return np.abs(self.slopes)

    def outward(self, sizes: Floats, thickness_m: float) -> Floats:
        """The offset (2,) m, along x and z, of the sides' middle from a lamp's, by its sizes (2,) m and thickness."""
        most = sizes / (2 * self.above_m)
        return np.asarray(thickness_m / 2 * np.clip(self.slopes, -most, most))

    @property
    def size(self) -> Floats:
        """Sizes (2,) m along x and z."""
        return np.asarray(np.ptp(self.places, axis=0))


def completed(features: Sequence[Feature], sightings: Sightings, level_m: float, line_z: float) -> list[Feature]:
    """The features, with the centres and glimpses of compact lamps completed.

    - A lamp of the usual size is put at its middle.
    - A lamp with a part missing is put at both possible middles.
    - A lamp that is too wide, because a bright object runs beside it along the line, is put at the middle nearer to the
      line.
    - A lamp that is larger otherwise is left out.

    The usual size is the median of the lamps on the line at `line_z`, of those that nothing hides if there are enough.
    It grows with the obliqueness of the view, in which a lamp's flank shows.
    """
    sides_of = _sides(sightings, level_m)
    sides_on_line = {
        name: sides for name, sides in sides_of.items() if abs(sides.places[:, 1].mean() - line_z) < SAME_LINE_M
    }
    unhidden = [
        sides_on_line[_instance(feature)]
        for feature in features
        if feature.part == "centre" and _instance(feature) in sides_on_line
    ]
    reference = unhidden if len(unhidden) >= ENOUGH else list(sides_on_line.values())
    if len(reference) < FEWEST:
        return list(features)
    sizes, aslant = (np.array([getattr(sides, name) for sides in reference]) for name in ("size", "aslant"))
    usual = [_growing(sizes[:, axis], aslant[:, axis]) for axis in (0, 1)]
    whole: list[Feature] = []
    for feature in features:
        sides = sides_of.get(_instance(feature))
        if sides is None or feature.part not in ("centre", "glimpse"):
            whole.append(feature)
        else:
            whole += _candidates(feature, sides, np.array(usual), line_z)
    return whole


def _growing(sizes: Floats, aslant: Floats) -> tuple[float, float]:
    """The size seen from below, m, and its growth with the obliqueness, m, by medians."""
    first, second = np.triu_indices(len(sizes), 1)
    difference = aslant[second] - aslant[first]
    far = np.abs(difference) > 0.1
    slopes = (sizes[second] - sizes[first])[far] / difference[far]
    rise = float(np.clip(np.median(slopes), 0.0, THICKEST_M)) if len(slopes) else 0.0
    return float(np.median(sizes - rise * aslant)), rise


def _instance(feature: Feature) -> Instance:
    return feature.frame, feature.view, feature.instance


def _sides(sightings: Sightings, level_m: float) -> dict[Instance, Sides]:
    """The sides of each instance of which all four are known."""
    indices_of: dict[Instance, list[int]] = {}
    for index, feature in enumerate(sightings.features):
        if feature.part == "side":
            indices_of.setdefault(_instance(feature), []).append(index)
    places = sightings.at(level_m)
    return {
        instance: Sides(
            np.array([sightings.features[index].pixels[0] for index in indices]),
            places[indices],
            np.asarray(sightings.slopes[indices].mean(axis=0)),
            level_m - float(sightings.origins[indices[0], 1]),
        )
        for instance, indices in indices_of.items()
        if len(indices) == 4
    }


def _candidates(feature: Feature, sides: Sides, usual: Floats, line_z: float) -> Iterator[Feature]:
    """The possible centres of a lamp. usual (2, 2): by axis x and z, its size seen from below and its growth with
    obliqueness, m."""
    size, expected = sides.size, usual[:, 0] + usual[:, 1] * sides.aslant
    missing = expected - size
    has_usual_size = np.abs(missing) <= ALIKE * expected + ALIKE_M
    most = np.where(has_usual_size, np.inf, expected * (1.0, MOST_JOINED))
    if (size > most).any() or (size < LEAST_SHOWN * expected).any():
        return
    thickness = usual[0, 1] if usual[0, 1] >= THINNEST_M else 0.0
    outward = sides.outward(usual[:, 0], thickness)
    shifts = []
    for first_side, second_side in ((0, 1), (2, 3)):
        offset = sides.places[second_side] - sides.places[first_side]
        axis = int(np.argmax(np.abs(offset)))
        across = (sides.pixels[second_side] - sides.pixels[first_side]) / offset[axis]
        steps = [0.0] if has_usual_size[axis] else [-missing[axis] / 2, missing[axis] / 2]
        if missing[axis] < 0 and len(steps) > 1:
            steps = [min(steps, key=lambda step: abs(sides.places[:, axis].mean() + step - line_z))]
        shifts.append([(step - outward[axis]) * across for step in steps])
    for first_shift, second_shift in product(*shifts):
        yield replace(feature, part="centre", pixels=feature.pixels + first_shift + second_shift)
