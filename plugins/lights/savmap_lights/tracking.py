"""Tracks of lamps: every feature names the lamp that it was measured of, and its rays tell which of them agree."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import (
    Bools,
    Feature,
    Floats,
    Ints,
    RowFacts,
    Sightings,
    StructureError,
    Track,
    Trajectory,
    project,
    sightings,
    track_of,
)
from savmap_lights.space.ends import Fitted, Rays, fit
from savmap_lights.space.partial import completed
from savmap_lights.space.scatter import scatter

MAX_SLOPE = 3.0
"""Rays that are flatter tell little."""
LEAST_FRAMES = 3
"""In how many frames each end of a lamp is measured at least."""
WIDTH, REACH = 0.012, 3.0
"""The scatter of the marks of one place, as a share of the height above the camera, and how many times that is near."""
PATH_M = 0.007
"""The standard deviation of the camera's positions."""
PARTS = {(-1, 0): "end 0", (1, 0): "end 1", (0, -1): "end 0", (0, 1): "end 1", (0, 0): "centre"}
"""The parts of lamps by the direction along x and z in which the lamp ends there."""


@dataclass(frozen=True, eq=False)
class Marks:
    """Sightings of ends and centres of lamps: of which lamp each is (n,), and `outward` (n, 2), the direction along x
    and z, 0 or +-1, in which the lamp ends there; (0, 0) for centres of compact lamps."""

    sightings: Sightings
    lamp: Ints
    outward: Ints

    def where(self, keep: Bools) -> "Marks":
        """The marks for which a mask (n,) is true."""
        return Marks(self.sightings.where(keep), self.lamp[keep], self.outward[keep])

    def places(self) -> tuple[Ints, Ints]:
        """The marks' places: lamp and outward direction (p, 3) of each, and each mark's place (n,)."""
        names, place = np.unique(np.column_stack([self.lamp, self.outward]), axis=0, return_inverse=True)
        return names, place.ravel()


def track_lamps(features: Sequence[Feature], facts: RowFacts, path: Trajectory) -> list[Track]:
    """Tracks "light 3 / end 0" and "light 3 / end 1" (towards +x, or, of strips across the aisle, +z) of strips, "light
    3 / centre" of compact lamps. The pixels of strips' ends are those of their middle height. A strip of which an end
    is not measured has one track. Raises StructureError where no lamp is measured in at least three frames."""
    named = [feature for feature in features if feature.object]
    observed = sightings(named, facts, path, upwards=True, max_slope=MAX_SLOPE)
    marks = of_one_kind(marks_of(observed, ("centre", "glimpse")))
    if len(marks.lamp):
        level = level_of(marks)
        z = float(np.median(marks.sightings.at(level)[:, 1]))
        observed = sightings(completed(named, observed, level, z), facts, path, upwards=True, max_slope=MAX_SLOPE)
        marks = frequent(gathered(of_one_kind(marks_of(observed, ("centre",))), level))
    if not len(marks.lamp):
        raise StructureError(f"row {facts.name}: no lamp is measured in at least {LEAST_FRAMES} frames")
    return [*_tracks(marks, level, facts, path)]


def marks_of(observed: Sightings, compact_parts: Sequence[str]) -> Marks:
    """The ends of strips, and the centres of compact lamps: the parts that tell these. An end points away from the
    middle of the visible part of its strip."""
    middles = {
        (feature.frame, feature.view, feature.instance): slope
        for feature, slope in zip(observed.features, observed.slopes, strict=True)
        if feature.part == "middle"
    }
    outward = np.zeros((len(observed.features), 2), np.int64)
    kept = np.zeros(len(observed.features), np.bool_)
    for index, (feature, slope) in enumerate(zip(observed.features, observed.slopes, strict=True)):
        middle = middles.get((feature.frame, feature.view, feature.instance))
        kept[index] = feature.part in compact_parts if middle is None else feature.part.startswith("end")
        if middle is not None and kept[index]:
            axis = int(np.argmax(np.abs(slope - middle)))
            outward[index, axis] = int(np.sign(slope[axis] - middle[axis]))
    lamps = np.array([int(feature.object.split()[1]) for feature in observed.features], np.int64)
    return Marks(observed, lamps, outward).where(kept)


def of_one_kind(marks: Marks) -> Marks:
    """The marks of the kind of most: ends of strips along the line, or across it, or centres of compact lamps."""
    compact = (marks.outward == 0).all(axis=1)
    kinds = [marks.outward[:, 0] != 0, marks.outward[:, 1] != 0, compact]
    return marks.where(kinds[int(np.argmax([kinds[0].sum(), kinds[1].sum(), 2 * compact.sum()]))])


def level_of(marks: Marks) -> float:
    """The height, m, at which most pairs of rays to one place meet."""
    _, place = marks.places()
    first, second = np.nonzero(np.triu(place[:, None] == place[None], 1))
    slopes, origins = marks.sightings.slopes[:, 0], marks.sightings.origins
    starts = origins[:, 0] - origins[:, 1] * slopes
    turn = slopes[first] - slopes[second]
    usable = np.abs(turn) > 0
    heights = (starts[second] - starts[first])[usable] / turn[usable]
    order = np.argsort(heights)
    total = np.cumsum(np.abs(turn[usable])[order])
    if not len(total):
        return float(np.median(origins[:, 1]))
    return float(heights[order][np.searchsorted(total, total[-1] / 2)])


def gathered(marks: Marks, level: float) -> Marks:
    """Of every frame, the mark of each place that is nearest to where most of the place's marks are."""
    (names, place), points = marks.places(), marks.sightings.at(level)
    width = WIDTH * (level - float(np.median(marks.sightings.origins[:, 1])))
    kept = np.zeros(len(place), np.bool_)
    for number in range(len(names)):
        indices = np.flatnonzero(place == number)
        separation = np.square(points[indices, None] - points[indices]).sum(axis=2) / width**2
        away = separation[np.exp(-separation / 2).sum(axis=1).argmax()]
        order = np.lexsort((away, marks.sightings.frames[indices]))
        _, first = np.unique(marks.sightings.frames[indices][order], return_index=True)
        nearest = order[first]
        kept[indices[nearest[away[nearest] < REACH**2]]] = True
    return marks.where(kept)


def frequent(marks: Marks) -> Marks:
    """The marks of places that are measured in enough frames."""
    place = marks.places()[1]
    return marks.where((np.bincount(place) >= LEAST_FRAMES)[place])


def sigmas(observed: Sightings, level: float, facts: RowFacts) -> Floats:
    """The standard deviations (n,) m, along x, of where rays meet a level."""
    focal = np.array([facts.views[feature.view].camera[0, 0] for feature in observed.features])
    pixels = np.array([np.sqrt(feature.covariance[0, 0, 0]) for feature in observed.features])
    above = level - observed.origins[:, 1]
    return np.asarray(np.hypot(PATH_M, pixels / focal * above * (1 + np.square(observed.slopes).sum(axis=1))))


def _tracks(marks: Marks, level: float, facts: RowFacts, path: Trajectory) -> Iterator[Track]:
    """The lamps' tracks, of the marks that fit, moved to the lamps' middle height."""
    (names, place), observed = marks.places(), marks.sightings
    lamp = np.unique(marks.lamp, return_inverse=True)[1].ravel()
    slope, sigma = observed.slopes[:, 0], sigmas(observed, level, facts)
    edge = -marks.outward[:, 0] * np.sign(slope).astype(np.int64)
    rays = Rays(place, lamp, observed.origins[:, 0], observed.origins[:, 1], slope, edge, sigma)
    fitted = fit(rays, level)
    z = observed.origins[:, 2] + (fitted.heights[lamp] - observed.origins[:, 1]) * observed.slopes[:, 1]
    agree, wider = scatter(z, sigma, place, fitted.kept)
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    for number, (name, *outward) in enumerate(names.tolist()):
        agreeing = np.flatnonzero((place == number) & agree)
        middle = np.array([fitted.places[number], 0.0, np.median(z[agreeing])]) if len(agreeing) else np.zeros(3)
        measured = [
            _at_middle(_widened(observed.features[ray], wider[ray]), fitted, rays, ray, middle, poses, facts)
            for ray in agreeing.tolist()
        ]
        if measured:
            yield track_of(name, PARTS[outward[0], outward[1]], measured)


def _at_middle(
    feature: Feature,
    fitted: Fitted,
    rays: Rays,
    ray: int,
    middle: Floats,
    poses: Mapping[int, Floats],
    facts: RowFacts,
) -> Feature:
    """A feature moved along the line by as much as the edge that is seen lies nearer or further than the lamp's middle
    would."""
    if not rays.edge[ray] or not fitted.half_m:
        return feature
    middle = np.array([middle[0], fitted.heights[rays.lamp[ray]], middle[2]])
    edge = middle - np.array([rays.edge[ray] * fitted.half_m * rays.slope[ray], 0.0, 0.0])
    pose, view = poses[feature.frame], facts.views[feature.view]
    turn = pose[:3, :3] @ view.rig_from_view
    pixels = project((np.stack([middle, edge]) - pose[:3, 3]) @ turn, view.camera)
    return replace(feature, pixels=feature.pixels + pixels[0] - pixels[1])


def _widened(feature: Feature, wider: float) -> Feature:
    return replace(feature, covariance=feature.covariance * wider**2)
