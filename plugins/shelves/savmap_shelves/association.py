"""Tracks of what was found and then measured: every feature is of the object that it was looked for at."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Place, RowFacts, Track, Trajectory

ENDS, FOOT, PART, PARTS_OF = ("top", "bottom"), " / foot", " part", "parts of "
LEAST_SIGHTINGS, HIDDEN = 3, 0.03
"""Of a foot, and by how much one that stands on the floor may seem higher than the lowest, as a share of the camera's
distance."""
Key = tuple[int, str, str]
"""Frame, view and object."""
Point = tuple[Feature, int]
"""A feature and which of its pixels."""


def track_structures(features: Sequence[Feature], facts: RowFacts, path: Trajectory | None) -> list[Track]:
    """Tracks of both ends of uprights' edges, of beams' corners, of uprights' feet that stand on the floor, by a path
    up to scale, and of parts of edges, all of an edge in one track.

    Raises StructureError where no beam was measured.
    """
    points: dict[str, list[Point]] = defaultdict(list)
    objects = {(f.frame, f.view, f.label, f.instance): f.object for f in features}
    for feature in _best(features):
        for name, number in _parts(feature, objects):
            points[name].append((feature, number))
    standing = _standing({name: seen for name, seen in points.items() if name.endswith(FOOT)}, facts, path)
    tracks = [
        _track(name, seen) for name, seen in sorted(points.items()) if not name.endswith(FOOT) or name in standing
    ]
    if not any(track.label == "beam" and not track.name.startswith(PARTS_OF) for track in tracks):
        raise StructureError(
            f"row {facts.name}: no beam that meets an upright was measured in any of {len(facts.frames)} frames"
        )
    return tracks


def _standing(feet: Mapping[str, Sequence[Point]], facts: RowFacts, path: Trajectory | None) -> set[str]:
    """The feet that are about as low as the lowest: guards and goods hide others, and none is below the floor."""
    if path is None:
        return set()
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    heights: dict[str, list[float]] = defaultdict(list)
    for name, points in feet.items():
        for feature, _ in points:
            pose = poses.get(feature.frame)
            if pose is not None:
                ray = pose[:3, :3] @ facts.views[feature.view].rig_rays(feature.pixels[0])
                if ray[2] < 0:
                    heights[name].append(float((pose[1, 3] - pose[2, 3] * ray[1] / ray[2]) / pose[2, 3]))
    usual = {name: float(np.median(values)) for name, values in heights.items() if len(values) >= LEAST_SIGHTINGS}
    return {name for name, height in usual.items() if height < min(usual.values()) + HIDDEN}


def _best(features: Sequence[Feature]) -> list[Feature]:
    """The features of the best instance of each object in each picture."""
    scores: dict[Key, dict[int, float]] = defaultdict(lambda: defaultdict(float))
    for feature in features:
        if feature.object:
            scores[feature.frame, feature.view, feature.object][feature.instance] += feature.score
    best = {key: max(each, key=lambda number: each[number]) for key, each in scores.items()}
    return [f for f in features if f.object and best[f.frame, f.view, f.object] == f.instance]


def _parts(feature: Feature, objects: Mapping[tuple[int, str, str, int], str]) -> list[tuple[str, int]]:
    """The tracks that a feature's pixels are of."""
    if feature.part.endswith(PART):
        return [(f"{PARTS_OF}{feature.object} / {feature.part.removesuffix(PART)}", 0)]
    if feature.label == "upright":
        if feature.part == "foot":
            return [(f"{feature.object} / foot", 0)]
        return [(f"{feature.object} / {feature.part} / {end}", number) for number, end in enumerate(ENDS)]
    if len(feature.pixels) > 1:
        return []
    side = feature.part.split()[-1]
    post = objects.get((feature.frame, feature.view, "upright", feature.neighbours.get(side, -1)))
    bay = int(feature.object.split()[1])
    return [(f"{feature.object} / {feature.part}", 0)] if post == f"upright {bay + (side == 'right')}" else []


def _track(name: str, points: Sequence[Point]) -> Track:
    points = sorted(points, key=lambda point: (point[0].frame, point[0].view))
    pixels: Floats = np.array([feature.pixels[number] for feature, number in points])
    covariances = np.array([feature.covariance[number] for feature, number in points])
    frames = np.array([feature.frame for feature, _ in points], np.int64)
    return Track(name, points[0][0].label, _place(name), frames, tuple(f.view for f, _ in points), pixels, covariances)


def _place(name: str) -> Place:
    """Where on the grid a track is, by its name."""
    words = name.split(" / ")
    if name.startswith(PARTS_OF):
        number, edge = int(words[0].split()[-1]), words[-1]
        if len(words) == 2:
            return {"upright": number, "side": edge, "end": "part"}
        return {"bay": number, "beam": int(words[1].split()[1]), "edge": edge, "end": "part"}
    if words[0].startswith("upright"):
        number = int(words[0].split()[1])
        side, end = ("middle", "foot") if len(words) == 2 else (words[1], words[2])
        return {"upright": number, "side": side, "end": end}
    edge, side = words[2].split()
    return {"bay": int(words[0].split()[1]), "beam": int(words[1].split()[1]), "side": side, "edge": edge}
