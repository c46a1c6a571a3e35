"""Pillars in the factor graph, and from its solution into the map."""

from collections.abc import Sequence

import numpy as np

from savmap.geometry.triangulate import nearest_point
from savmap.graph import (
    Constraints,
    KeySpace,
    Relation,
    Solution,
    equal_coordinate,
    image_measurements,
    known_length,
    sight_lines,
)
from savmap.types import RowFacts, Structure, Track, Trajectory

LOST_M = 0.5


def constrain(
    tracks: Sequence[Track],
    facts: RowFacts,
    start: Trajectory,
    room: str,
    plumb_m: float,
    height_m: tuple[float, float] | None = None,
) -> Constraints:
    """Every foot and top as a point that was seen; a top stands over its foot, and as high above it as is known, if it is."""
    keys = KeySpace(room).keys([track.name for track in tracks])
    relations: list[Relation] = []
    for number in sorted({int(track.place["pillar"]) for track in tracks}):
        foot, top = keys[f"pillar {number} / foot"], keys[f"pillar {number} / top"]
        relations += [equal_coordinate("x", foot, top, plumb_m), equal_coordinate("z", foot, top, plumb_m)]
        if height_m is not None:
            relations.append(known_length("y", foot, top, *height_m, f"height of pillar {number}"))
    return Constraints(
        plugin=room,
        keys=keys,
        measurements=image_measurements(tracks, keys, facts.views),
        relations=tuple(relations),
        initial={track.name: nearest_point(*sight_lines(track, facts, start)) for track in tracks},
    )


def describe(tracks: Sequence[Track], solution: Solution, room: str) -> list[Structure]:
    """A structure "pillar 1" and so on with the vertices "foot" and "top"; one that the solve could not place is left out."""
    solved = solution.landmarks_of(room)
    structures: list[Structure] = []
    for number in sorted({int(track.place["pillar"]) for track in tracks}):
        points = [solved[f"pillar {number} / {part}"] for part in ("foot", "top")]
        places = np.array([point.position for point in points])
        covariances = np.array([point.covariance for point in points])
        if np.sqrt(np.linalg.eigvalsh(covariances).max()) < LOST_M:
            structures.append(
                Structure(
                    id=f"pillar {number}",
                    label="pillar",
                    vertices=places,
                    covariances=covariances,
                    vertex_labels=("foot", "top"),
                    edges=np.array([[0, 1]]),
                    attributes={
                        "pillar": number,
                        "height_m": round(float(places[1, 1] - places[0, 1]), 4),
                        "observations": sum(point.observations for point in points),
                    },
                )
            )
    return structures
