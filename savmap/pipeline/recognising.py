"""A pass along a row that is mapped: recognised there by what it shows, it needs no references of its own.

The pass is solved in an assumed scale and laid into the map by an app (`savmap.plugin.apps.Dates`). What the map says
of scale and heights then stands for references: a length along the row and heights of a few edges, with the map's
standard deviations. They give the frame alone. No element of the map pulls at its counterpart, so that what moved
shows.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.errors import StructureError
from savmap.graph import CameraPriors, KnownLength, Landmark, References, Solution, SurveyedPoint
from savmap.types import Floats, RowMap, RowPlace, Structure
from savmap.vision.markers import MarkerTracks

HEIGHTS = 4
"""So many edges, of as many elements, are given a height."""
SCALE_SIGMA, HEIGHT_SIGMA_M = 0.003, 0.005
"""Of maps that do not say how well they know their scale, and of those that measured no height."""
MEASURED_M, ASSUMED = 0.15, 0.001


NO_MARKS = MarkerTracks({}, {})


def bare(frames: CameraPriors) -> CameraPriors:
    """The frames without any reference."""
    return replace(frames, references=References())


def assumed_length(points: Iterable[Mapping[str, Floats]]) -> References:
    """The length along x of what was located, by landmark, taken for known: whatever the scale is, it is one."""
    along = sorted((float(position[0]), name) for group in points for name, position in group.items())
    (low, first), (high, last) = along[0], along[-1]
    return References(lengths=(KnownLength(first, last, high - low, ASSUMED * (high - low), "x"),))


def frame_references(
    place: RowPlace, mapped: RowMap, structures: Mapping[str, Sequence[Structure]], solution: Solution
) -> References:
    """What the map says of the scale and the heights of a pass whose structures were solved in another scale.

    The length is that between the two landmarks that are farthest apart of those in both maps; the heights are those of
    the landmarks that are known best, of as many elements. Raises StructureError where none is measured.
    """
    measured = [*_measured(place, structures, solution)]
    along = [item for item in measured if item[1].covariance[0, 0] < MEASURED_M**2]
    if not along:
        raise StructureError(
            f"row {place.row}: nothing that the pass shows of it is measured well enough; film more of it"
        )
    first = min(along, key=lambda item: float(item[1].position[0]))
    last = max(along, key=lambda item: float(item[1].position[0]))
    span = place.scale * float(last[1].position[0] - first[1].position[0])
    share = float(mapped.report.get("scale_sigma", SCALE_SIGMA))
    sigma = span * float(np.hypot(share, np.sqrt(place.covariance[0, 0]) / place.scale))
    height_sigma = place.height_sigma_m if np.isfinite(place.height_sigma_m) else HEIGHT_SIGMA_M
    sigma_y = float(np.hypot(height_sigma, np.sqrt(place.covariance[2, 2]))) * np.sqrt(HEIGHTS)
    points = tuple(
        SurveyedPoint(name, (None, place.scale * float(landmark.position[1]) + float(place.shift_m[1]), None), sigma_y)
        for name, landmark in _best_heights(measured)
    )
    return References(lengths=(KnownLength(first[0], last[0], span, sigma, "x"),), points=points)


def _measured(
    place: RowPlace, structures: Mapping[str, Sequence[Structure]], solution: Solution
) -> Iterator[tuple[str, Landmark]]:
    """The landmarks, by name, of structures that the map has too."""
    shared = {(plugin, name) for plugin, name, _ in place.pairs}
    for plugin, group in structures.items():
        landmarks = solution.landmarks_of(plugin)
        for structure in group:
            if (plugin, structure.id) in shared:
                yield from ((name, landmarks[name]) for name in structure.vertex_labels if name in landmarks)


def _best_heights(measured: Iterable[tuple[str, Landmark]]) -> list[tuple[str, Landmark]]:
    """One landmark of an element, of those elements whose height is known best."""
    best: dict[str, tuple[str, Landmark]] = {}
    for name, landmark in measured:
        element = name.rpartition(" / ")[0]
        if landmark.covariance[1, 1] < best.get(element, (name, landmark))[1].covariance[1, 1] or element not in best:
            best[element] = name, landmark
    ordered = sorted(best.values(), key=lambda item: float(item[1].covariance[1, 1]))
    return [item for item in ordered if item[1].covariance[1, 1] < MEASURED_M**2][:HEIGHTS]
