"""Compact lamps that something before them hides a part of: the side that shows, and the size of the others, tell where they are.

Which side shows is not known of one frame. Both places are tried, and only the right one is the same in many frames.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from savmap.plugin import Feature, Floats, Sightings

ALIKE, ALIKE_M = 0.06, 0.03
LEAST_SHOWN = 0.4
SAME_LINE_M = 0.4
FEWEST, ENOUGH = 3, 5
THICKEST_M = 0.3
Instance = tuple[int, str, int]


@dataclass(frozen=True, eq=False)
class Sides:
    """The four sides of a compact lamp in a frame, two and two opposite: pixels (4, 2), places (4, 2), x and z, at a level, and how
    aslant (2,) they are seen, metres along x and z for each metre upwards."""

    pixels: Floats
    places: Floats
    aslant: Floats

    @property
    def size(self) -> Floats:
        """Sizes (2,) m along x and z."""
        return np.asarray(np.ptp(self.places, axis=0))


def completed(features: Sequence[Feature], seen: Sightings, level_m: float, line_z: float) -> list[Feature]:
    """The features with those of compact lamps, centres and glimpses, made whole: as they are where they have the usual size, at both
    places that they may have where a part is missing, left out where they are larger. The usual size is that of those on the line at
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
            whole += _candidates(
                feature, own, np.array([size + rise * own.aslant[k] for k, (size, rise) in enumerate(usual)])
            )
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
    found: dict[Instance, list[tuple[Floats, Floats, Floats]]] = {}
    for feature, place, slope in zip(seen.features, seen.at(level_m), seen.slopes, strict=True):
        if feature.part == "side":
            found.setdefault(_instance(feature), []).append((feature.pixels[0], place, slope))
    return {
        instance: Sides(
            np.array([pixel for pixel, _, _ in own]),
            np.array([place for _, place, _ in own]),
            np.abs(np.mean([slope for _, _, slope in own], axis=0)),
        )
        for instance, own in found.items()
        if len(own) == 4
    }


def _candidates(feature: Feature, sides: Sides, usual: Floats) -> Iterator[Feature]:
    """Where the centre may be."""
    size = sides.size
    missing = usual - size
    alike = np.abs(missing) <= ALIKE * usual + ALIKE_M
    if (size[~alike] > usual[~alike]).any() or (size < LEAST_SHOWN * usual).any():
        return
    shifts = []
    for one, other in ((0, 1), (2, 3)):
        axis = int(np.argmax(np.abs(sides.places[other] - sides.places[one])))
        step = (sides.pixels[other] - sides.pixels[one]) * missing[axis] / size[axis] / 2
        shifts.append([0.0 * step] if alike[axis] else [-step, step])
    for first, second in product(*shifts):
        yield replace(feature, part="centre", pixels=feature.pixels + first + second)
