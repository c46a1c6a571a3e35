"""What pictures show beside the plugins' structures, as constraints: the floor, square markers with a side that the
user measured, and how deep flat parts lie."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from savmap.graph.constraints import (
    TIGHT_M,
    Constraints,
    Relation,
    equal_coordinate,
    fixed_coordinate,
    known_coordinate,
    known_distance,
)
from savmap.graph.factors.shapes import square
from savmap.graph.keys import KeySpace
from savmap.graph.measurements import image_measurements
from savmap.graph.references import KnownMarker, References
from savmap.types import FlatDepth, Floats, Track, Trajectory, ViewSpec

FLOOR = "floor"
FLOOR_REFERENCE = "floor before the face"
USUAL_HEIGHT_M = 2.0
FIRST_BEFORE_M = 1.0
MARKERS = "survey markers"
LEAST_FRAMES = 3
LEAST_PARALLAX_DEG = 5.0
FIRST_M = 2.0
LIKELY = 3.0
"""Standard deviations within which what a plugin knows of a coordinate agrees with what was measured: beyond, something
else was."""


def floor_constraints(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], sigma: float, references: References, start: Trajectory
) -> Constraints | None:
    """The floor's part of the graph; None without points. They are on one level, which is one reference. sigma: of
    their common depth below the camera, as a share of it."""
    located = [track for track in tracks if np.isin(track.frames, start.frames).all()]
    if not located:
        return None
    keys = KeySpace(FLOOR).keys(track.name for track in located)
    heights = [height.value_m for height in references.camera_heights]
    sigma_m = sigma * (float(np.median(heights)) if heights else USUAL_HEIGHT_M)
    first, *others = (keys[track.name] for track in located)
    level = (equal_coordinate("y", first, other) for other in others)
    seen = replace(known_coordinate("y", first, 0.0, sigma_m, FLOOR_REFERENCE), is_given=False)
    along = [float(start.world_from_rig[np.isin(start.frames, track.frames), 0, 3].mean()) for track in located]
    initial = {track.name: np.array([x, 0.0, FIRST_BEFORE_M]) for track, x in zip(located, along, strict=True)}
    return Constraints(FLOOR, keys, image_measurements(located, keys, views), (seen, *level), initial)


def without_presumed(constraints: Constraints) -> Constraints:
    """A plugin's constraints without what it presumes of heights, and the landmarks that it has for that: the floor is
    seen, and guards may hide what stands on it."""
    presumed = {relation.a for relation in constraints.relations if relation.presumed and relation.axis == "y"}
    if not presumed:
        return constraints
    measurements = constraints.measurements
    return replace(
        constraints,
        keys={name: key for name, key in constraints.keys.items() if key not in presumed},
        measurements=measurements.take(~np.isin(measurements.keys, list(presumed))),
        relations=tuple(r for r in constraints.relations if not presumed.intersection(r.keys)),
        initial={name: first for name, first in constraints.initial.items() if constraints.keys[name] not in presumed},
    )


def marker_constraints(
    tracks: Mapping[str, Sequence[Track]],
    views: Mapping[str, ViewSpec],
    markers: Sequence[KnownMarker],
    start: Trajectory,
) -> tuple[Constraints | None, tuple[str, ...]]:
    """The markers' part of the graph, None without any, and the names of those that were not seen well enough: in three
    frames, from directions at least 5 degrees apart. `tracks`: the corners of each marker, in order around it."""
    used = [marker for marker in markers if _well_seen(tracks.get(marker.name, ()), views, start)]
    missed = tuple(marker.name for marker in markers if marker not in used)
    if not used:
        return None, missed
    corner_tracks = [track for marker in used for track in tracks[marker.name]]
    keys = KeySpace(MARKERS).keys(track.name for track in corner_tracks)
    factors = gtsam.NonlinearFactorGraph()
    relations = []
    for marker in used:
        corners = [keys[track.name] for track in tracks[marker.name]]
        factors.push_back(square(corners, marker.sigma_m))
        relations.append(
            known_distance(corners[0], corners[1], marker.size_m, marker.sigma_m, f"side of marker {marker.name}")
        )
    initial = {track.name: _first_position(track, views, start) for track in corner_tracks}
    measurements = image_measurements(corner_tracks, keys, views)
    return Constraints(MARKERS, keys, measurements, tuple(relations), initial, factors=factors), missed


def _well_seen(tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory) -> bool:
    if not tracks or len(tracks[0].frames) < LEAST_FRAMES:
        return False
    rays = _world_rays(tracks[0], views, start)
    return bool((rays @ rays.T).min() < np.cos(np.radians(LEAST_PARALLAX_DEG)))


def _first_position(track: Track, views: Mapping[str, ViewSpec], start: Trajectory) -> Floats:
    """Rough: along the ray of the middle frame."""
    middle = len(track.frames) // 2
    position: Floats = _poses(track, start)[middle, :3, 3] + FIRST_M * _world_rays(track, views, start)[middle]
    return position


def _world_rays(track: Track, views: Mapping[str, ViewSpec], start: Trajectory) -> Floats:
    rays = [views[view].rig_rays(pixel) for view, pixel in zip(track.views, track.pixels, strict=True)]
    turned: Floats = np.einsum("nij,nj->ni", _poses(track, start)[:, :3, :3], np.array(rays))
    return turned


def _poses(track: Track, start: Trajectory) -> Floats:
    return start.world_from_rig[np.searchsorted(start.frames, track.frames)]


@dataclass(frozen=True)
class MeasuredDepth:
    """What flat parts tell: the plugin, the coordinate of its landmark as a relation, and by how many sections;
    `likely`: whether it agrees with what the plugin knows of it."""

    plugin: str
    landmark: str
    relation: Relation
    sections: int
    likely: bool


def measured_depths(
    depths: Sequence[FlatDepth], constraints: Mapping[str, Constraints], path: Trajectory
) -> Iterator[MeasuredDepth]:
    """What flat parts tell of landmarks that the constraints have, where the path in metres has their frames."""
    for depth in depths:
        part = constraints.get(depth.plugin)
        of_frames = np.isin(path.frames, depth.frames)
        if part is None or depth.landmark not in part.keys or not of_frames.any():
            continue
        column = ("x", "y", "z").index(depth.axis)
        value, sigma = depth.metres(float(path.world_from_rig[of_frames, column, 3].mean()))
        relation = fixed_coordinate(depth.axis, part.keys[depth.landmark], value, sigma)
        likely = all(abs(r.value - value) <= LIKELY * np.hypot(r.sigma, sigma) for r in _coordinates(part, relation))
        yield MeasuredDepth(depth.plugin, depth.landmark, relation, depth.sections, likely)


def _coordinates(part: Constraints, relation: Relation) -> Iterator[Relation]:
    """What a plugin says of a coordinate itself, or of one that it sets equal to it."""
    along = [r for r in part.relations if r.axis == relation.axis]
    equal = [set(r.keys) for r in along if r.b is not None and r.value == 0 and r.sigma <= TIGHT_M]
    group, grown = set[int](), {relation.a}
    while grown != group:
        group, grown = grown, grown.union(*(pair for pair in equal if pair & grown))
    return (r for r in along if r.b is None and r.a in group)


def with_depths(constraints: Mapping[str, Constraints], depths: Sequence[MeasuredDepth]) -> dict[str, Constraints]:
    """The plugins' constraints with the depths that are likely."""
    new = {name: tuple(d.relation for d in depths if d.plugin == name and d.likely) for name in constraints}
    return {name: replace(part, relations=(*part.relations, *new[name])) for name, part in constraints.items()}
