"""Which frames saw the same pillar: feet put on the floor from the camera's first path, and grouped there."""

from collections.abc import Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, RowFacts, Track, Trajectory
from savmap.vision import peaks

SAME_M = 0.3
MIN_SUPPORT = 3
STEEP = 0.1
PARTS = ("foot", "top")


def tracks_of(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
    """Tracks "pillar 1 / foot" and "pillar 1 / top" and so on, numbered along x.

    `start` tells where the camera was, roughly: a foot is where its ray meets the floor, y = 0.
    Raises StructureError where no pillar is seen in three frames.
    """
    feet = [(feature, place) for feature in features if (place := on_floor(feature, facts, start)) is not None]
    x = np.array([place[0] for _, place in feet])
    found = peaks.peaks(x, SAME_M, MIN_SUPPORT)
    if not len(found):
        raise StructureError("no pillar was seen in three frames: was the network trained on such?")
    sightings = {_sighting(feature): feature for feature in features if feature.part == "top"}
    tracks: list[Track] = []
    for number, at in enumerate(found, start=1):
        own = [feature for feature, place in feet if abs(place[0] - at) <= SAME_M]
        tops = [sightings[_sighting(feature)] for feature in own]
        tracks += [_track(number, part, seen) for part, seen in zip(PARTS, (own, tops), strict=True)]
    return tracks


def on_floor(feature: Feature, facts: RowFacts, start: Trajectory) -> Floats | None:
    """Where the ray of a foot meets the floor: (3,) m in the row's frame; None for other parts, frames, and rays that hardly fall."""
    index = np.flatnonzero(start.frames == feature.frame)
    if feature.part != "foot" or not len(index):
        return None
    pose = start.world_from_rig[index[0]]
    ray = pose[:3, :3] @ facts.views[feature.view].rig_rays(feature.pixels[0])
    if ray[1] > -STEEP:
        return None
    place: Floats = pose[:3, 3] - ray * pose[1, 3] / ray[1]
    return place


def _sighting(feature: Feature) -> tuple[int, str, int]:
    return feature.frame, feature.view, feature.instance


def _track(number: int, part: str, seen: Sequence[Feature]) -> Track:
    return Track(
        name=f"pillar {number} / {part}",
        label=seen[0].label,
        place={"pillar": number, "part": part},
        frames=np.array([feature.frame for feature in seen], dtype=np.int64),
        views=tuple(feature.view for feature in seen),
        pixels=np.concatenate([feature.pixels for feature in seen]),
        covariances=np.concatenate([feature.covariance for feature in seen]),
    )
