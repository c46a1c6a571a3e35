"""Which section of the rack a sign hangs at."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.types import Structure

SECTION = "section"
AT_FACE_M = 0.6
BESIDE_M = 0.4


def with_bays(structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]) -> list[Structure]:
    """Signs at the face get the attribute `bay`, such as "section 3": the section in front of which they hang, or, for one at an
    upright, the section that begins there, as one faces it. Sections are whatever others mapped with an attribute `section`."""
    spans = _spans([one for own in others.values() for one in own if SECTION in one.attributes])
    return [_with_bay(own, spans) for own in structures]


def _spans(parts: Sequence[Structure]) -> dict[int, tuple[float, float]]:
    """From where to where along x sections reach."""
    places: dict[int, list[float]] = {}
    for part in parts:
        places.setdefault(int(float(part.attributes[SECTION])), []).extend(part.vertices[:, 0].tolist())
    return {number: (min(x), max(x)) for number, x in sorted(places.items())}


def _with_bay(own: Structure, spans: Mapping[int, tuple[float, float]]) -> Structure:
    x, _, z = np.asarray(own.vertices.mean(axis=0)).tolist()
    inside = [number for number, (left, right) in spans.items() if left <= x <= right]
    begins = [number for number, (left, _) in spans.items() if left - BESIDE_M <= x < left]
    ends = [number for number, (_, right) in spans.items() if right < x <= right + BESIDE_M]
    if abs(z) > AT_FACE_M or not (inside or begins or ends):
        return own
    return replace(own, attributes={**own.attributes, "bay": f"{SECTION} {(inside or begins or ends)[0]}"})
