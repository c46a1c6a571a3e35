"""A survey's entry of a row out of what somebody measured of its uprights and beams: points, lines or boxes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from savmap.errors import OutputError
from savmap.types import Floats, Structure, SurveyEntry
from savmap_shelves.report.evaluation import read_row

NEAR_END = 0.25
"""The share of an element's extent that counts as its end: all its points there make up the edge."""
NARROWEST_M = 1e-3
SIDES = {0: ("left", "right"), 1: ("lower", "upper")}


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """Uprights from left to right, and the beams between each two from the floor up. A beam beside the outermost
    uprights is left out.

    Raises OutputError where uprights are missing, overlap or have no width."""
    uprights = _ordered([own for own in structures if own.label == "upright"], 0)
    beams = [own for own in structures if own.label == "beam"]
    if len(uprights) < 2:
        raise OutputError(f"a survey of beams needs the uprights at their sides: there are {len(uprights)}")
    between = np.searchsorted([interval.mean() for _, interval in uprights], [_middle_x(beam) for beam in beams])
    sections = [
        {"beams": [interval.tolist() for _, interval in _ordered(own, 1)]}
        for k in range(1, len(uprights))
        for own in [[beam for beam, number in zip(beams, between, strict=True) if number == k]]
    ]
    values: dict[str, Any] = {"uprights": [interval.tolist() for _, interval in uprights], "sections": sections}
    read_row(values)
    outside = [beam.id for beam, number in zip(beams, between, strict=True) if number in (0, len(uprights))]
    return SurveyEntry(values, dict.fromkeys(outside, "it lies beside the outermost uprights"))


def _ordered(structures: Sequence[Structure], axis: int) -> list[tuple[str, Floats]]:
    """Ids and intervals (2,) m along an axis, in their order."""
    return sorted(((own.id, _interval(own, axis)) for own in structures), key=lambda pair: float(pair[1].mean()))


def _interval(structure: Structure, axis: int) -> Floats:
    """From edge to edge along an axis: the means of the points that are labelled so, or, without labels, of those near
    either end."""
    along = structure.vertices[:, axis]
    low, high = (
        np.array([side in label.split() for label in structure.vertex_labels], dtype=np.bool_) for side in SIDES[axis]
    )
    if not (low.any() and high.any()):
        near = NEAR_END * np.ptp(along)
        low, high = along <= along.min() + near, along >= along.max() - near
    interval = np.array(sorted((float(along[low].mean()), float(along[high].mean()))))
    if np.ptp(interval) < NARROWEST_M:
        what = "width" if axis == 0 else "height"
        raise OutputError(f"{structure.id}: has no {what}: all its points are at {interval[0]:.3f} m")
    return interval


def _middle_x(beam: Structure) -> float:
    along = beam.vertices[:, 0]
    return float((along.min() + along.max()) / 2)
