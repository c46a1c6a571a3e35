"""Tracks of what was found and then measured: every feature is of the object that it was looked for at."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Place, RowFacts, Track

ENDS, PART, PARTS_OF = ("top", "bottom"), " part", "parts of "
Point = tuple[Feature, int]
"""A feature and which of its pixels."""


def track_structures(features: Sequence[Feature], facts: RowFacts) -> list[Track]:
    """Tracks of both ends of uprights' edges, of beams' corners, of uprights' feet, and of parts of edges, all of an
    edge in one track.

    Raises StructureError where no beam was measured.
    """
    points: dict[str, list[Point]] = defaultdict(list)
    for feature in features:
        for name, number in _parts(feature):
            points[name].append((feature, number))
    tracks = [_track(name, _measured(seen)) for name, seen in sorted(points.items())]
    if not any(track.label == "beam" and not track.name.startswith(PARTS_OF) for track in tracks):
        raise StructureError(
            f"row {facts.name}: no beam that meets an upright was measured in any of {len(facts.frames)} frames"
        )
    return tracks


def _measured(points: Sequence[Point]) -> Sequence[Point]:
    """Those that were measured, or all where none was: edges without a score are guessed."""
    return [point for point in points if point[0].score > 0] or points


def _parts(feature: Feature) -> list[tuple[str, int]]:
    """The tracks that a feature's pixels are of."""
    if feature.part.endswith(PART):
        return [(f"{PARTS_OF}{feature.object} / {feature.part.removesuffix(PART)}", 0)]
    if feature.label == "upright" and feature.part != "foot":
        return [(f"{feature.object} / {feature.part} / {end}", number) for number, end in enumerate(ENDS)]
    return [(f"{feature.object} / {feature.part}", 0)] if len(feature.pixels) == 1 else []


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
