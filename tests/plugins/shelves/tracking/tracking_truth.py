"""How well tracks agree with what was really there."""

from collections import Counter

import synth

from savmap.types import Feature, Track


def counted(tracks: list[Track]) -> tuple[int, list[int]]:
    """Uprights, and beams in each bay."""
    uprights = {track.place["upright"] for track in tracks if track.label == "upright"}
    beams = {(track.place["bay"], track.place["beam"]) for track in tracks if track.label == "beam"}
    levels = Counter(section for section, _ in beams)
    return len(uprights), [levels[section] for section in range(1, len(uprights))]


def truth_of(footage: synth.Footage) -> dict[tuple[int, bytes], tuple[object, ...] | None]:
    """What each point, by frame and pixels, really is, as a track's place would say it; None where nothing of the rack."""
    uprights = {(f.frame, f.instance): footage.truth[id(f)] for f in footage.features if f.label == "upright"}
    points: dict[tuple[int, bytes], tuple[object, ...] | None] = {}
    for feature in footage.features:
        own = footage.truth[id(feature)]
        if feature.label == "upright":
            for end, pixel in zip(("top", "bottom"), feature.pixels, strict=True):
                points[feature.frame, pixel.tobytes()] = (own[0] + 1, feature.part, end) if own else None
        elif len(feature.pixels) == 1:
            points[feature.frame, feature.pixels[0].tobytes()] = _corner(feature, own, uprights)
    return points


def _corner(
    feature: Feature, own: tuple[int, ...] | None, uprights: dict[tuple[int, int], tuple[int, ...] | None]
) -> tuple[object, ...] | None:
    edge, side = feature.part.split()
    at = uprights[feature.frame, feature.neighbours[side]]
    if own is None or at is None or at[0] != own[0] + (side == "right"):
        return None
    return own[0] + 1, own[1] + 1, side, edge


def shares(footage: synth.Footage, tracks: list[Track]) -> tuple[float, float]:
    """Share of true observations that are in their track, and share of wrong ones among those in tracks."""
    truth = truth_of(footage)
    right = wrong = 0
    for track in tracks:
        for frame, pixel in zip(track.frames, track.pixels, strict=True):
            same = truth[int(frame), pixel.tobytes()] == tuple(track.place.values())
            right, wrong = right + same, wrong + (not same)
    return right / sum(place is not None for place in truth.values()), wrong / (right + wrong)
