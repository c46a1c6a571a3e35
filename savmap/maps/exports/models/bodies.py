"""Solids as closed bodies of triangles whose faces look outwards."""

from dataclasses import dataclass

import numpy as np

from savmap.types import Floats, Solid
from savmap.types.common import Ints, array_record

THINNEST_M = 1e-6
"""What is thinner is no solid: 0.01 mm is the resolution of map files."""

Corner = tuple[int, int, int]


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
        """The same for flat shading: points (6n, 3), each of one face alone, their normals (6n, 3), and triangles (4n -
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
    area = _area(outline)
    size = float(np.linalg.norm(area))
    if size < THINNEST_M**2 or abs(area @ solid.depth) < THINNEST_M * size:
        return None
    if area @ solid.depth > 0:
        outline, area = outline[::-1], -area
    normal = area / size
    return Body(outline, solid.depth, normal, _filling(_in_plane(outline, normal)))


def _area(outline: Floats) -> Floats:
    """The vector area (3,) of a closed outline (n, 3): its normal times its area (Newell)."""
    arms = outline - outline[0]
    area: Floats = np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0) / 2
    return area


def _in_plane(outline: Floats, normal: Floats) -> Floats:
    """The outline (n, 2) in the axis-aligned plane that it is nearest to, counter-clockwise."""
    axis = int(np.argmax(np.abs(normal)))
    flat = outline[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] > 0 else flat * [1.0, -1.0]


def _filling(flat: Floats) -> Ints:
    """Corners (n - 2, 3) of triangles that fill an outline (n, 2), which is counter-clockwise: its ears are cut off one
    by one."""
    left, cut, at = list(range(len(flat))), list[Corner](), 0
    while len(left) > 3:
        turns = (at + k for k in range(len(left)))
        ear = next((k % len(left) for k in turns if _is_ear(flat, left, k % len(left))), at % len(left))
        cut.append(_corner(left, ear))
        del left[ear]
        at = ear
    return np.array([*cut, left], dtype=np.int64)


def _corner(left: list[int], k: int) -> Corner:
    return left[k - 1], left[k], left[(k + 1) % len(left)]


def _is_ear(flat: Floats, left: list[int], k: int) -> bool:
    """Whether the triangle at this corner turns left and no other corner lies in it."""
    names = _corner(left, k)
    a, b, c = flat[list(names)]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[name for name in left if name not in names]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not bool(np.any(inside))


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the signed area of triangles; positive where they turn left."""
    area: Floats = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
    return area
