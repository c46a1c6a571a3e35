"""Compact lamps that something before them hides a part of: the side that shows, and the size of the others, tell where they are.

Which side shows is not known of one frame. Both places are tried, and only the right one is the same in many frames.

The middle of what is seen of a lamp is not that of the lamp: aslant, one sees its lower edge on the far side and its upper edge on the
near side, and the far one seems further off than the near one nearer. How thick a lamp is shows by how it grows aslant.
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
    """The four sides of a compact lamp in a frame, two and two opposite: pixels (4, 2), places (4, 2), x and z, at a level, the slopes
    (2,) of the ray to their middle, metres along x and z for each metre upwards, and how far, m, the level is above the camera."""

    pixels: Floats
    places: Floats
    slopes: Floats
    above_m: float

    @property
    def aslant(self) -> Floats:
        """How aslant (2,) they are seen along x and z."""
        return np.abs(self.slopes)

    def outward(self, sizes: Floats, thickness_m: float) -> Floats:
        """How far (2,) m along x and z the middle of the four sides lies beyond that of a lamp of such sizes (2,) m and thickness."""
        most = sizes / (2 * self.above_m)
        return np.asarray(thickness_m / 2 * np.clip(self.slopes, -most, most))

    @property
    def size(self) -> Floats:
        """Sizes (2,) m along x and z."""
        return np.asarray(np.ptp(self.places, axis=0))


def completed(features: Sequence[Feature], seen: Sightings, level_m: float, line_z: float) -> list[Feature]:
    """The features with those of compact lamps, centres and glimpses, made whole: at the lamp's middle where they have the usual size,
    at both places that this may have where a part is missing, at the one nearer to the line where something as bright that runs beside
    them along the line makes them wider, left out where they are larger otherwise. The usual size is that of those on the line at
    `line_z`, if possible of those that nothing hides; it grows aslant, where a lamp's flank shows."""
    sides = _sides(seen, level_m)
    near = {name: own for name, own in sides.items() if abs(own.places[:, 1].mean() - line_z) < SAME_LINE_M}
    shown = [
        near[_instance(feature)] for feature in features if feature.part == "centre" and _instance(feature) in near
    ]
    on_line = shown if len(shown) >= ENOUGH else list(near.values())
    if len(on_line) < FEWEST:
        return list(features)
    sizes, aslant = (np.array([getattr(own, name) for own in on_line]) for name in ("size", "aslant"))
    usual = [_growing(sizes[:, axis], aslant[:, axis]) for axis in (0, 1)]
    whole: list[Feature] = []
    for feature in features:
        own = sides.get(_instance(feature))
        if own is None or feature.part not in ("centre", "glimpse"):
            whole.append(feature)
        else:
            whole += _candidates(feature, own, np.array(usual), line_z)
    return whole


def _growing(sizes: Floats, aslant: Floats) -> tuple[float, float]:
    """Size seen from below, and its growth aslant, by medians."""
    first, second = np.triu_indices(len(sizes), 1)
    apart = aslant[second] - aslant[first]
    far = np.abs(apart) > 0.1
    slopes = (sizes[second] - sizes[first])[far] / apart[far]
    rise = float(np.clip(np.median(slopes), 0.0, THICKEST_M)) if len(slopes) else 0.0
    return float(np.median(sizes - rise * aslant)), rise


def _instance(feature: Feature) -> Instance:
    return feature.frame, feature.view, feature.instance


def _sides(seen: Sightings, level_m: float) -> dict[Instance, Sides]:
    """By instance its sides."""
    found: dict[Instance, list[int]] = {}
    for index, feature in enumerate(seen.features):
        if feature.part == "side":
            found.setdefault(_instance(feature), []).append(index)
    places = seen.at(level_m)
    return {
        instance: Sides(
            np.array([seen.features[index].pixels[0] for index in own]),
            places[own],
            np.asarray(seen.slopes[own].mean(axis=0)),
            level_m - float(seen.origins[own[0], 1]),
        )
        for instance, own in found.items()
        if len(own) == 4
    }


def _candidates(feature: Feature, sides: Sides, usual: Floats, line_z: float) -> Iterator[Feature]:
    """Where the centre may be of a lamp that has these sizes along x and z seen from below, and grows so much (2, 2) aslant."""
    size, expected = sides.size, usual[:, 0] + usual[:, 1] * sides.aslant
    missing = expected - size
    alike = np.abs(missing) <= ALIKE * expected + ALIKE_M
    most = np.where(alike, np.inf, expected * (1.0, MOST_JOINED))
    if (size > most).any() or (size < LEAST_SHOWN * expected).any():
        return
    thickness = usual[0, 1] if usual[0, 1] >= THINNEST_M else 0.0
    outward = sides.outward(usual[:, 0], thickness)
    shifts = []
    for one, other in ((0, 1), (2, 3)):
        apart = sides.places[other] - sides.places[one]
        axis = int(np.argmax(np.abs(apart)))
        across = (sides.pixels[other] - sides.pixels[one]) / apart[axis]
        steps = [0.0] if alike[axis] else [-missing[axis] / 2, missing[axis] / 2]
        if missing[axis] < 0 and len(steps) > 1:
            steps = [min(steps, key=lambda step: abs(sides.places[:, axis].mean() + step - line_z))]
        shifts.append([(step - outward[axis]) * across for step in steps])
    for first, second in product(*shifts):
        yield replace(feature, part="centre", pixels=feature.pixels + first + second)
