"""Points of the floor as constraints: y = 0 is where the pictures show it (`savmap.vision.evidence.floor`)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.graph.constraints import Constraints, equal_coordinate, known_coordinate
from savmap.graph.keys import KeySpace
from savmap.graph.measurements import image_measurements
from savmap.graph.references import References
from savmap.types import Track, Trajectory, ViewSpec

PLUGIN = "floor"
REFERENCE = "floor before the face"
USUAL_HEIGHT_M = 2.0
FIRST_BEFORE_M = 1.0


def floor_constraints(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], sigma: float, references: References, start: Trajectory
) -> Constraints | None:
    """The floor's part of the graph; None without points. sigma: of their common depth below the camera, as a share of
    it.

    The points are on one level, which is one reference: what is wrong of one is wrong of all.
    """
    known = [track for track in tracks if np.isin(track.frames, start.frames).all()]
    if not known:
        return None
    keys = KeySpace(PLUGIN).keys(track.name for track in known)
    heights = [height.value_m for height in references.camera_heights]
    sigma_m = sigma * (float(np.median(heights)) if heights else USUAL_HEIGHT_M)
    first, *others = (keys[track.name] for track in known)
    level = (equal_coordinate("y", first, other) for other in others)
    relations = (known_coordinate("y", first, 0.0, sigma_m, REFERENCE), *level)
    along = [float(start.world_from_rig[np.isin(start.frames, track.frames), 0, 3].mean()) for track in known]
    initial = {track.name: np.array([x, 0.0, FIRST_BEFORE_M]) for track, x in zip(known, along, strict=True)}
    return Constraints(PLUGIN, keys, image_measurements(known, keys, views), relations, initial)


def without_presumed(constraints: Constraints) -> Constraints:
    """A plugin's constraints without what it takes for granted of heights, and the landmarks that are there for that:
    the floor itself is seen, and guards may hide what stands on it."""
    granted = {one.a for one in constraints.relations if one.presumed and one.axis == "y"}
    if not granted:
        return constraints
    measurements = constraints.measurements
    return replace(
        constraints,
        keys={name: key for name, key in constraints.keys.items() if key not in granted},
        measurements=measurements.take(~np.isin(measurements.keys, list(granted))),
        relations=tuple(one for one in constraints.relations if not granted.intersection(one.keys)),
        initial={name: first for name, first in constraints.initial.items() if constraints.keys[name] not in granted},
    )
