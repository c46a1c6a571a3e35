"""From the solution to lamps in the map: a strip has two ends, a compact lamp a centre."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from savmap.graph import Solution
from savmap.types import Structure, Track

LOST_M = 1.0


def describe(tracks: Sequence[Track], solution: Solution, room: str) -> list[Structure]:
    """One structure "light k" for each lamp, with the vertices "end 0" and "end 1", or "centre".

    A lamp with a vertex that the solve could not place within `LOST_M`, one standard deviation, is left out.
    """
    ordered = sorted(tracks, key=lambda track: (int(track.place["light"]), track.name))
    lamps = [
        _lamp(number, list(own), solution, room)
        for number, own in groupby(ordered, key=lambda t: int(t.place["light"]))
    ]
    return [lamp for lamp in lamps if np.sqrt(np.linalg.eigvalsh(lamp.covariances).max()) < LOST_M]


def _lamp(number: int, tracks: Sequence[Track], solution: Solution, room: str) -> Structure:
    landmarks = [solution.landmarks_of(room)[track.name] for track in tracks]
    return Structure(
        id=f"light {number}",
        label=tracks[0].label,
        vertices=np.array([landmark.position for landmark in landmarks]),
        covariances=np.array([landmark.covariance for landmark in landmarks]),
        vertex_labels=tuple(str(track.place["part"]) for track in tracks),
        edges=np.array([[0, 1]] if len(tracks) == 2 else np.empty((0, 2)), dtype=np.int64),
        attributes={"light": number, "observations": sum(landmark.observations for landmark in landmarks)},
    )
