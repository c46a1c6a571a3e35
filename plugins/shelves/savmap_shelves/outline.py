"""The intervals that mapped uprights and beams span, read off their structures' vertices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.errors import OutputError
from savmap.types import Floats, Structure


@dataclass(frozen=True)
class Elements:
    """Mapped elements sorted by centre: ids (n) and intervals (n, 2) m, x for uprights, y for beams."""

    ids: tuple[str, ...]
    intervals: Floats


@dataclass(frozen=True)
class Section:
    """A mapped section: x from its beams' left to right ends (2,), and its beams."""

    extent: Floats
    beams: Elements


def uprights_of(structures: Sequence[Structure]) -> Elements:
    """The uprights, x of their left and right edges."""
    return _elements([own for own in structures if own.label == "upright"], 0, ("left", "right"))


def sections_of(structures: Sequence[Structure]) -> list[Section]:
    """The sections that have beams, from left to right, with y of the beams' lower and upper edges."""
    grouped: dict[int, list[Structure]] = {}
    for own in structures:
        if own.label == "beam":
            grouped.setdefault(_section_of(own), []).append(own)
    sections = [Section(_extent(beams), _elements(beams, 1, ("lower", "upper"))) for beams in grouped.values()]
    return sorted(sections, key=lambda section: float(section.extent.mean()))


def _section_of(beam: Structure) -> int:
    number = beam.attributes.get("section")
    if not isinstance(number, int | np.integer):
        raise OutputError(f"map: {beam.id}: attribute 'section' should be a whole number, not {number!r}")
    return int(number)


def _elements(structures: list[Structure], axis: int, sides: tuple[str, str]) -> Elements:
    spans = [_span(own, axis, sides) for own in structures]
    intervals = np.array(spans, dtype=np.float64).reshape(-1, 2)
    order = np.argsort(intervals.mean(axis=1), kind="stable")
    return Elements(tuple(structures[k].id for k in order), intervals[order])


def _span(structure: Structure, axis: int, sides: tuple[str, str]) -> tuple[float, float]:
    """Mean coordinate of the vertices on either side, smaller first."""
    first, second = (_mean(structure, axis, side) for side in sides)
    return min(first, second), max(first, second)


def _mean(structure: Structure, axis: int, side: str) -> float:
    chosen = [side in label.split() for label in structure.vertex_labels]
    if not any(chosen):
        raise OutputError(f"map: {structure.id}: no vertex is labelled {side!r}")
    return float(structure.vertices[chosen, axis].mean())


def _extent(beams: list[Structure]) -> Floats:
    spans = [_span(beam, 0, ("left", "right")) for beam in beams]
    extent: Floats = np.median(np.array(spans, dtype=np.float64), axis=0)
    return extent
