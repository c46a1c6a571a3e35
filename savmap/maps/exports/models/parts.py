"""A map as models see it: rows with the places that they are built around, and their structures in the world's frame,
with their bodies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from savmap.maps.exports.frames import Element, elements, world_from_row
from savmap.maps.exports.marks import assumed_depths
from savmap.maps.exports.models.bodies import Body, body_of
from savmap.types import Floats, SiteMap, Structure
from savmap.types.common import array_record


@dataclass(frozen=True, eq=False)
class Part:
    """A structure in the world's frame, its body (None: it is lines, or points), and what is doubted of it."""

    row: str
    plugin: str
    structure: Structure
    body: Body | None
    doubts: tuple[str, ...]

    @property
    def assumed(self) -> bool:
        """Whether it has a body whose depth was neither measured nor given."""
        return self.body is not None and self.structure.solid is not None and self.structure.solid.assumed

    @property
    def ifc_class(self) -> str:
        """What it is in a building model, as its plugin says; nothing where that says nothing."""
        return "" if self.structure.solid is None else self.structure.solid.ifc_class


@dataclass(frozen=True, eq=False)
@array_record
class RowParts:
    """A row's parts, and its origin (3,) m in the world's frame, near which they are: files whose numbers have seven
    digits give positions from there."""

    name: str
    origin: Floats
    parts: tuple[Part, ...]


def depth_note(rows: Sequence[RowParts]) -> str:
    """What to say of the depths of all parts that were neither measured nor given; nothing where there is none."""
    return assumed_depths(
        (part.structure.label, float(np.linalg.norm(part.body.depth)))
        for row in rows
        for part in row.parts
        if part.assumed and part.body is not None
    )


def parts_of(site: SiteMap) -> list[RowParts]:
    """All rows of a map that have structures. Raises OutputError where rows have no common frame."""
    said = site.doubts()

    def made(group: Iterator[Element]) -> Iterator[Part]:
        for row, plugin, thing in ((one.row, one.plugin, one.structure) for one in group):
            body = None if thing.solid is None else body_of(thing.solid)
            yield Part(row, plugin, thing, body, tuple(said.get((row, thing.id), ())))

    rows = groupby(elements(site), key=lambda element: element.row)
    return [RowParts(name, world_from_row(site, name)[:3, 3], tuple(made(group))) for name, group in rows]
