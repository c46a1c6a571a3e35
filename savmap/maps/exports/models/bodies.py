"""A map as models see it: rows with the places that they are built around, their structures in the world's frame, and
solids as closed bodies of triangles whose faces look outwards."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from savmap.maps.exports.frames import Element, elements, world_from_row
from savmap.maps.exports.marks import assumed_depths
from savmap.types import Floats, SiteMap, Solid, Structure
from savmap.types.common import Ints, array_record

THINNEST_M = 1e-6
"""What is thinner is no solid: 0.01 mm is the resolution of map files."""


@dataclass(frozen=True, eq=False)
@array_record
class Body:
    """A prism: its outline (n, 3) m, counter-clockwise as seen from outside, `depth` (3,) m, which points away from
    there, and the corners (n - 2, 3) of the triangles that fill the outline. `normal` (3,): the outline's, outwards, of
    length 1."""

    outline: Floats
    depth: Floats
    normal: Floats
    filling: Ints

    @property
    def points(self) -> Floats:
        """Corners (2n, 3): the outline's, then those at the other end."""
        return np.concatenate([self.outline, self.outline + self.depth])

    @property
    def triangles(self) -> Ints:
        """Corners (4n - 4, 3) of all triangles, by their number in `points`; counter-clockwise as seen from outside."""
        count = len(self.outline)
        here = np.arange(count)
        after = np.roll(here, -1)
        sides = [[here, here + count, after], [after, here + count, after + count]]
        return np.concatenate([self.filling, self.filling[:, ::-1] + count, *(np.stack(side, 1) for side in sides)])

    @property
    def normals(self) -> Floats:
        """Normals (4n - 4, 3) of the triangles, outwards; the triangles that fill an outline share that of its
        plane."""
        sides = self._side_normals()
        ends = np.repeat([self.normal, -self.normal], len(self.filling), axis=0)
        return np.concatenate([ends, sides, sides])

    def flatness_m(self) -> float:
        """How far the outline's corners are off their plane at most."""
        return float(np.abs((self.outline - self.outline.mean(axis=0)) @ self.normal).max())

    def flat_faces(self) -> tuple[Floats, Floats, Ints]:
        """The same for flat shading: points (6n, 3), each of a single face, their normals (6n, 3), and triangles (4n -
        4, 3)."""
        count = len(self.outline)
        after = np.roll(self.outline, -1, axis=0)
        walls = np.stack([self.outline, self.outline + self.depth, after, after + self.depth], axis=1)
        wall_normals = np.repeat(self._side_normals(), 4, axis=0)
        normals = np.concatenate([np.repeat([self.normal, -self.normal], count, axis=0), wall_normals])
        corners = 2 * count + 4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [2, 1, 3]])
        triangles = [self.filling, self.filling[:, ::-1] + count, corners.reshape(-1, 3)]
        return np.concatenate([self.points, walls.reshape(-1, 3)]), normals, np.concatenate(triangles)

    def _side_normals(self) -> Floats:
        """Normals (n, 3) of the sides; the outline's for a side that has no area."""
        normals = np.cross(self.depth, np.roll(self.outline, -1, axis=0) - self.outline)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        unit: Floats = np.where(lengths > 0, normals / np.where(lengths > 0, lengths, 1.0), self.normal)
        return unit


def body_of(solid: Solid) -> Body | None:
    """A solid as a body; None where it has no volume."""
    outline = solid.outline[np.linalg.norm(solid.outline - np.roll(solid.outline, 1, axis=0), axis=1) > THINNEST_M]
    if len(outline) < 3:
        return None
    arms = outline - outline[0]
    area = np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0) / 2  # the normal times the area (Newell)
    size = float(np.linalg.norm(area))
    if size < THINNEST_M**2 or abs(area @ solid.depth) < THINNEST_M * size:
        return None
    if area @ solid.depth > 0:
        outline, area = outline[::-1], -area
    normal = area / size
    axis = int(np.argmax(np.abs(normal)))
    flat = outline[:, [(axis + 1) % 3, (axis + 2) % 3]]  # in the axis-aligned plane that it is nearest to
    return Body(outline, solid.depth, normal, _filling(flat if normal[axis] > 0 else flat * [1.0, -1.0]))


def _filling(flat: Floats) -> Ints:
    """Corners (n - 2, 3) of triangles that fill a counter-clockwise outline (n, 2): its ears are cut off in turn."""
    left, cut, at = list(range(len(flat))), list[list[int]](), 0
    while len(left) > 3:
        corners = [[left[k - 1], left[k], left[(k + 1) % len(left)]] for k in range(len(left))]
        turns = ((at + k) % len(left) for k in range(len(left)))
        at = next((k for k in turns if _is_ear(flat, left, corners[k])), at % len(left))
        cut.append(corners[at])
        del left[at]
    return np.array([*cut, left], dtype=np.int64)


def _is_ear(flat: Floats, left: list[int], corners: list[int]) -> bool:
    """Whether a triangle turns left and no other corner lies in it."""

    def turn(a: Floats, b: Floats, c: Floats) -> Floats:
        area: Floats = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
        return area

    a, b, c = flat[corners]
    if turn(a, b, c) <= 0:
        return False
    others = flat[[name for name in left if name not in corners]]
    return not bool(np.any((turn(a, b, others) >= 0) & (turn(b, c, others) >= 0) & (turn(c, a, others) >= 0)))


@dataclass(frozen=True, eq=False)
class Part:
    """A structure in the world's frame, its body (None: it is lines, or points), and what is warned of it."""

    row: str
    plugin: str
    structure: Structure
    body: Body | None
    warnings: tuple[str, ...]

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
    warnings = site.warnings()

    def parts(group: Iterator[Element]) -> Iterator[Part]:
        for element in group:
            structure = element.structure
            body = None if structure.solid is None else body_of(structure.solid)
            said = tuple(warnings.get((element.row, structure.id), ()))
            yield Part(element.row, element.plugin, structure, body, said)

    rows = groupby(elements(site), key=lambda element: element.row)
    return [RowParts(name, world_from_row(site, name)[:3, 3], tuple(parts(group))) for name, group in rows]
