"""Bodies of building models as boxes: what counts of a member is how wide, high and deep it is, whatever flanges, lips
and rounded edges its profile has, and whatever plates are welded to its ends."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from savmap.maps.exports.frames import transformed
from savmap.maps.exports.hull import hull
from savmap.types import Floats, Ints, array_record

TIE = 1.01
"""A smaller box has less surface by this factor: of a round tube, all are as good as that along its axes."""


@dataclass(frozen=True, eq=False)
@array_record
class Mesh:
    """A body's surface: points (n, 3) m in the frame of its placement, which bodies of one shape share; corners (m, 3)
    of its triangles by their number; and world_from_placement (4, 4), z up."""

    shape: Floats
    triangles: Ints
    place: Floats

    @property
    def points(self) -> Floats:
        """The points (n, 3) m in the world's frame."""
        return transformed(self.shape, self.place)


def box_of(meshes: Sequence[Mesh]) -> Floats:
    """Corners (8, 3) m of the box around bodies: along its longest side it reaches from end to end, across it is as
    large as their section half-way. It lies along their placement's axes, or upright where it is smaller so."""
    points = np.concatenate([mesh.points for mesh in meshes])
    axes, upright = meshes[0].place[:3, :3].T, _upright_axes(points)
    if _surface(points @ upright.T) * TIE < _surface(points @ axes.T):
        axes = upright
    along = points @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    length = int(np.argmax(high - low))
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])[:-1]
    triangles = np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)])
    section = _section(along, triangles, length, (low[length] + high[length]) / 2)
    if len(section):
        across = np.arange(3) != length
        low[across], high[across] = section.min(axis=0)[across], section.max(axis=0)[across]
    corners = np.array(list(product(*zip(low, high, strict=True))))
    result: Floats = corners @ axes
    return result


def _section(points: Floats, triangles: Ints, axis: int, place: float) -> Floats:
    """Where the edges of triangles pass a plane across an axis (n, 3)."""
    first, second = points[triangles].reshape(-1, 3), points[np.roll(triangles, -1, axis=1)].reshape(-1, 3)
    before, after = first[:, axis] - place, second[:, axis] - place
    passing = (before <= 0) & (after > 0) | (before > 0) & (after <= 0)
    share = before[passing] / (before[passing] - after[passing])
    section: Floats = first[passing] + share[:, None] * (second[passing] - first[passing])
    return section


def _upright_axes(points: Floats) -> Floats:
    """Directions (3, 3) of the smallest upright box: one of its sides lies along one of the plan's hull."""
    corners = hull(points[:, :2] - points[0, :2])
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    if not (lengths > 0).any():
        return np.eye(3)
    ways = sides[lengths > 0] / lengths[lengths > 0, None]
    across = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    x, y = ways[np.argmin(np.ptp(corners @ ways.T, axis=0) * np.ptp(corners @ across.T, axis=0))].tolist()
    return np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])


def _surface(along: Floats) -> float:
    """Half the surface of the box around points (n, 3), m2."""
    a, b, c = np.ptp(along, axis=0)
    return float(a * b + b * c + c * a)
