"""From the solution to signs in the map: four vertices, what is written on them, and how sure that is."""

from collections.abc import Sequence

import numpy as np

from savmap.graph import Solution
from savmap.types import Structure, Track
from savmap_signs.constraints import by_sign

LOST_M = 0.5
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]], dtype=np.int64)


def describe(tracks: Sequence[Track], solution: Solution, room: str) -> list[Structure]:
    """One structure "sign k" for each sign; one with a corner that the solve could not place within `LOST_M`, one standard
    deviation, is left out."""
    signs = [_sign(number, own, solution, room) for number, own in by_sign(tracks).items()]
    return [sign for sign in signs if np.sqrt(np.linalg.eigvalsh(sign.covariances).max()) < LOST_M]


def _sign(number: int, tracks: Sequence[Track], solution: Solution, room: str) -> Structure:
    landmarks = [solution.landmarks_of(room)[track.name] for track in tracks]
    vertices = np.array([landmark.position for landmark in landmarks])
    sides = np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)
    place = tracks[0].place
    attributes: dict[str, float | int | str] = {
        "sign": number,
        "text": str(place["text"]),
        "confidence": int(place["per_mille"]) / 1000,
        "code": str(place["code"]),
        "width_m": round(float(sides[[0, 2]].mean()), 4),
        "height_m": round(float(sides[[1, 3]].mean()), 4),
        "observations": sum(landmark.observations for landmark in landmarks),
    }
    return Structure(
        id=f"sign {number}",
        label=tracks[0].label,
        vertices=vertices,
        covariances=np.array([landmark.covariance for landmark in landmarks]),
        vertex_labels=tuple(track.name for track in tracks),
        edges=RING,
        attributes=attributes,
    )
