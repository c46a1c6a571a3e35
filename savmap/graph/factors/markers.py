"""Square markers as constraints: four corners that form a square in any attitude, with a side that the user
measured."""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from savmap.graph.constraints import Constraints, known_distance
from savmap.graph.factors.shapes import square
from savmap.graph.keys import KeySpace
from savmap.graph.measurements import image_measurements
from savmap.graph.references import KnownMarker
from savmap.types import Floats, Track, Trajectory, ViewSpec

PLUGIN = "survey markers"
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
    corner_tracks = [track for marker in used for track in tracks[marker.name]]
    keys = KeySpace(PLUGIN).keys(track.name for track in corner_tracks)
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
    return Constraints(PLUGIN, keys, measurements, tuple(relations), initial, factors=factors), missed


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
