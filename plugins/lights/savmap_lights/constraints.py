"""Lamps in the factor graph: their points, and, where it is so, one height and one line along the aisle."""

from collections.abc import Sequence

from savmap.geometry.triangulate import nearest_point
from savmap.graph import Constraints, KeySpace, equal_coordinate, image_measurements, sight_lines
from savmap.types import RowFacts, Track, Trajectory


def constrain(tracks: Sequence[Track], facts: RowFacts, start: Trajectory, room: str, line: bool) -> Constraints:
    """Projection factors of all lamps; with `line`, all points share y and z. Paper, last paragraph of section III.E."""
    keys = KeySpace(room).keys([track.name for track in tracks])
    ordered = [keys[track.name] for track in tracks]
    relations = (
        [equal_coordinate(axis, ordered[0], other) for other in ordered[1:] for axis in ("y", "z")] if line else []
    )
    return Constraints(
        plugin=room,
        keys=keys,
        measurements=image_measurements(tracks, keys, facts.views),
        relations=tuple(relations),
        initial={track.name: nearest_point(*sight_lines(track, facts, start)) for track in tracks},
    )
