"""Square markers as constraints: four corners that form a square in any attitude, whose side the user measured."""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from savmap.graph.constraints import Constraints, known_distance
from savmap.graph.keys import KeySpace
from savmap.graph.observations import observe
from savmap.graph.references import KnownMarker
from savmap.types import Floats, Track, Trajectory, ViewSpec

ROOM = "survey markers"
LEAST_FRAMES = 3
LEAST_PARALLAX_DEG = 5.0
FIRST_M = 2.0


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
    every = [track for marker in used for track in tracks[marker.name]]
    keys = KeySpace(ROOM).keys(track.name for track in every)
    factors = gtsam.NonlinearFactorGraph()
    relations = []
    for marker in used:
        corners = [keys[track.name] for track in tracks[marker.name]]
        factors.push_back(square(corners, marker.sigma_m))
        relations.append(
            known_distance(corners[0], corners[1], marker.size_m, marker.sigma_m, f"side of marker {marker.name}")
        )
    initial = {track.name: _first_place(track, views, start) for track in every}
    return Constraints(ROOM, keys, observe(every, keys, views), tuple(relations), initial, factors=factors), missed


def square(corners: Sequence[int], sigma_m: float) -> gtsam.CustomFactor:
    """Four points, in order, are a square of any size: opposite sides alike (3 equations), the diagonals as long as one
    another, two neighbouring sides as well."""

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        points = np.array([values.atPoint3(key) for key in corners])
        if jacobians is not None:
            slopes = _square_slopes(points)
            for number in range(4):
                jacobians[number] = slopes[:, number]
        return _square_errors(points)

    return gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(5, sigma_m), list(corners), error)


def _square_errors(points: Floats) -> Floats:
    a, b, c, d = points
    lengths = [np.linalg.norm(span) for span in (c - a, d - b, b - a, c - b)]
    return np.array([*(a - b + c - d), lengths[0] - lengths[1], lengths[2] - lengths[3]])


def _square_slopes(points: Floats) -> Floats:
    """Derivatives (5, 4, 3) of the errors by the corners."""
    slopes = np.zeros((5, 4, 3))
    slopes[:3] = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * np.eye(3)[:, None]
    for row, first, last, way in ((3, 0, 2, 1.0), (3, 1, 3, -1.0), (4, 0, 1, 1.0), (4, 1, 2, -1.0)):
        span = points[last] - points[first]
        along = way * span / max(float(np.linalg.norm(span)), 1e-9)
        slopes[row, last] += along
        slopes[row, first] -= along
    return slopes


def _well_seen(tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory) -> bool:
    if not tracks or len(tracks[0].frames) < LEAST_FRAMES:
        return False
    rays = _world_rays(tracks[0], views, start)
    return bool((rays @ rays.T).min() < np.cos(np.radians(LEAST_PARALLAX_DEG)))


def _first_place(track: Track, views: Mapping[str, ViewSpec], start: Trajectory) -> Floats:
    """Rough: along the ray of the middle frame."""
    middle = len(track.frames) // 2
    place: Floats = _poses(track, start)[middle, :3, 3] + FIRST_M * _world_rays(track, views, start)[middle]
    return place


def _world_rays(track: Track, views: Mapping[str, ViewSpec], start: Trajectory) -> Floats:
    rays = [views[view].rig_rays(pixel) for view, pixel in zip(track.views, track.pixels, strict=True)]
    turned: Floats = np.einsum("nij,nj->ni", _poses(track, start)[:, :3, :3], np.array(rays))
    return turned


def _poses(track: Track, start: Trajectory) -> Floats:
    return start.world_from_rig[np.searchsorted(start.frames, track.frames)]
