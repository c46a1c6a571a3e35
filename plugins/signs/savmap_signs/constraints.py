"""Signs in the factor graph: their corners, flat or rectangles, of known sizes and parallel to planes where that is said."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from savmap.geometry.triangulate import nearest_points
from savmap.graph import (
    Constraints,
    KeySpace,
    Relation,
    equal_coordinate,
    flat,
    graph_of,
    image_measurements,
    known_distance,
    rectangle,
    sight_lines,
)
from savmap.types import Axis, Floats, RowFacts, Track, Trajectory
from savmap_signs.features import PARTS
from savmap_signs.settings import Settings

NEAR_SIZE = 0.15
NEAR_PLANE_DEG = 15.0
NORMALS: Mapping[str, Axis] = {"face": "z", "across": "x", "floor": "y"}


def constrain(tracks: Sequence[Track], facts: RowFacts, start: Trajectory, room: str, config: Settings) -> Constraints:
    """Projection factors of all corners, one factor of shape a sign, and what the settings know."""
    keys = KeySpace(room).keys(track.name for track in tracks)
    initial = {track.name: first_position(track, facts, start) for track in tracks}
    signs = [[track.name for track in own] for own in by_sign(tracks).values()]
    shape = {"rectangle": rectangle, "flat": flat}[config.shape]
    relations = [
        relation
        for names in signs
        for relation in _relations(names, keys, np.array([initial[name] for name in names]), config)
    ]
    return Constraints(
        plugin=room,
        keys=keys,
        measurements=image_measurements(tracks, keys, facts.views),
        relations=tuple(relations),
        initial=initial,
        factors=graph_of([shape([keys[name] for name in names], config.shape_sigma_m) for names in signs]),
    )


def by_sign(tracks: Sequence[Track]) -> dict[int, list[Track]]:
    """The four tracks of each sign, in the corners' order."""
    grouped: dict[int, list[Track]] = {}
    for track in tracks:
        grouped.setdefault(int(track.place["sign"]), []).append(track)
    return {
        number: sorted(own, key=lambda track: PARTS.index(str(track.place["part"]))) for number, own in grouped.items()
    }


def first_position(track: Track, facts: RowFacts, start: Trajectory) -> Floats:
    """The point (3,) nearest to the rays of a track from the camera's first path."""
    origins, rays = sight_lines(track, facts, start)
    point: Floats = nearest_points(origins, rays[None])[0]
    return point


def _relations(names: Sequence[str], keys: Mapping[str, int], quad: Floats, config: Settings) -> Iterator[Relation]:
    corners = [keys[name] for name in names]
    size = nearest_size(quad, config.sizes_m)
    if size is not None:
        sign = names[0].partition(" / ")[0]
        for what, (a, b), value in (("width", (0, 1), size[0]), ("height", (0, 3), size[1])):
            yield known_distance(corners[a], corners[b], value, config.size_sigma_m, f"{what} of {sign}")
    for axis in nearest_planes(quad, config.parallel):
        yield from (equal_coordinate(axis, corners[0], other, config.shape_sigma_m) for other in corners[1:])


def nearest_size(quad: Floats, sizes: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The known size, width and height, that corners (4, 3) are near."""
    sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    seen = np.array([sides[[0, 2]].mean(), sides[[1, 3]].mean()])
    near = [size for size in sizes if np.abs(seen / np.array(size) - 1).max() < NEAR_SIZE]
    return min(near, key=lambda size: float(np.abs(seen / np.array(size) - 1).max()), default=None)


def nearest_planes(quad: Floats, planes: Sequence[str]) -> Iterator[Axis]:
    """The axis that is normal to the plane, of those named, which corners (4, 3) are nearly parallel to."""
    normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
    normal /= np.linalg.norm(normal)
    for plane in planes:
        if abs(normal["xyz".index(NORMALS[plane])]) > np.cos(np.radians(NEAR_PLANE_DEG)):
            yield NORMALS[plane]
