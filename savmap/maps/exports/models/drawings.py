"""Drawings of a row, flat: its elevation, which looks at its face, and its plan, which looks down; and what is
dimensioned in them.

Both have x along the row. In the elevation y points up; in the plan, away from who faces the row. Metres, from the
row's origin.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.maps.exports.hull import hull
from savmap.types import Floats, RowMap, Structure
from savmap.types.common import array_record

COLUMN, BEAM = "IfcColumn", "IfcBeam"
SAME_M = 0.005
"""Heights that differ by less are one in a chain of dimensions."""


SKEW = 1e-3
"""What is askew by less is seen straight on."""


@dataclass(frozen=True, eq=False)
@array_record
class Shape:
    """Lines of a structure in a drawing: points (n, 2) m, closed or not."""

    structure: Structure
    points: Floats
    closed: bool


@dataclass(frozen=True)
class Dimension:
    """A length in a drawing, from one point to another, along x or upright; its line is at `line`: the other
    coordinate."""

    start: tuple[float, float]
    end: tuple[float, float]
    line: float
    upright: bool


def elevation(row: RowMap) -> list[Shape]:
    """The row as one faces it."""
    return [shape for one in _structures(row) for shape in _shapes(one, (0, 1), 1.0)]


def plan(row: RowMap) -> list[Shape]:
    """The row from above."""
    return [shape for one in _structures(row) for shape in _shapes(one, (0, 2), -1.0)]


def reach(shapes: Sequence[Shape]) -> tuple[Floats, Floats]:
    """The lower left and the upper right corner (2,) of all shapes; the origin twice where there is none."""
    points = np.concatenate([np.zeros((0, 2)), *(shape.points for shape in shapes)])
    return (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))


def dimensions(row: RowMap, below: float, left: float) -> list[Dimension]:
    """What an elevation is dimensioned with: clear widths between neighbouring columns, from the first column's outer
    side to the last one's, and, in each width, the heights of the beams' upper sides. `below`, `left`: where the
    chains' lines begin."""
    spans = sorted(_reach_of(one) for one in _structures(row) if _class_of(one) == COLUMN)
    beams = [_reach_of(one) for one in _structures(row) if _class_of(one) == BEAM]
    if not spans:
        return []
    gaps = [(a[1], b[0]) for a, b in pairwise(spans) if b[0] > a[1]]
    widths = [Dimension((a, 0.0), (b, 0.0), below, False) for a, b in gaps]
    whole = Dimension((spans[0][0], 0.0), (max(span[1] for span in spans), 0.0), below - 0.4, False)
    heights = [
        Dimension((a + left, low), (a + left, high), a + left, True)
        for a, b in gaps
        for low, high in pairwise(_levels(beams, a, b))
    ]
    return [*widths, whole, *heights]


def _levels(beams: Iterable[tuple[float, float, float]], left: float, right: float) -> list[float]:
    """The floor and the upper sides of the beams whose middle is in a gap, upwards."""
    tops = sorted(top for start, end, top in beams if left <= (start + end) / 2 <= right)
    levels = [0.0]
    for top in tops:
        if top - levels[-1] > SAME_M:
            levels.append(top)
    return levels


def _structures(row: RowMap) -> list[Structure]:
    return [structure for group in row.structures.values() for structure in group]


def _class_of(structure: Structure) -> str:
    return structure.solid.ifc_class if structure.solid else ""


def _reach_of(structure: Structure) -> tuple[float, float, float]:
    """From where to where along the row a structure's solid reaches, and how high."""
    outline = structure.solid.outline if structure.solid else structure.vertices
    return float(outline[:, 0].min()), float(outline[:, 0].max()), float(outline[:, 1].max())


def _shapes(structure: Structure, axes: tuple[int, int], way: float) -> list[Shape]:
    """A structure's solid, or its edges, along two of the row's axes, the other of which may be turned round. A solid
    is its outline where it is looked at along its depth, else all that it covers."""
    turn = np.array([1.0, way])
    if structure.solid is not None:
        outline, depth = structure.solid.outline, structure.solid.depth
        if np.abs(depth[[*axes]]).max() < SKEW * np.linalg.norm(depth):
            return [Shape(structure, outline[:, axes] * turn, closed=True)]
        flat = np.concatenate([outline, outline + depth])[:, axes] * turn
        return [Shape(structure, hull(flat), closed=True)]
    flat = structure.vertices[:, axes] * turn
    ends = [flat[edge] for edge in structure.edges] or [flat[k : k + 1] for k in range(len(flat))]
    return [Shape(structure, points, closed=False) for points in ends]
