"""Structures of a map as outlines, and the planes that they lie in."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from savmap.geometry import pinhole
from savmap.lab.sim.paint.raster import beyond
from savmap.types import Bools, Floats, Ints, PlaneEvidence, PlanePatch, Structure, ViewSpec, array_record

TOLERANCE_M = 0.12
"""How far from a plane the corners of an outline in it may lie."""
CELLS_ACROSS = 5.0
LEAST_CELL_M = 0.002
MOST_CELLS = 4_000_000
LEVEL = 0.7
ODD, FEWEST_ALIKE = 0.1, 0.5
LONG = 1.5
NEAR = 0.02
"""In front of a camera, as a share of the farthest corner's distance."""
AROUND, NEAREST, ALIKE = 64, 8, 0.9


@dataclass(frozen=True, eq=False)
@array_record
class Outline:
    """A mapped structure of one of a network's classes: its corners (n, 3) m in the row's frame in their order around
    it, and how far around each side (n,) m, from a corner to the next, its place is less sure than those of the sides
    around it."""

    label: str
    corners: Floats
    unsure_m: Floats


@dataclass(frozen=True, eq=False)
@array_record
class Face:
    """A plane with the outlines in it. The patch is the smallest that holds them: what was mapped, and nothing beyond
    it."""

    patch: PlanePatch
    outlines: tuple[Outline, ...]

    def cells(self, points: Floats) -> Floats:
        """Columns and rows (..., 2) of points (..., 3) of the plane in the patch, both from 0 at a cell's middle."""
        from_corner = points - self.patch.origin
        columns = from_corner @ self.patch.right / self.patch.cell - 0.5
        rows = self.patch.shape[0] - 0.5 - from_corner @ self.patch.up / self.patch.cell
        return np.stack([columns, rows], axis=-1)

    def inside(self, outline: Outline) -> Bools:
        """The cells (rows, columns) within an outline."""
        mask = np.zeros(self.patch.shape, np.uint8)
        cv2.fillPoly(mask, [np.round(16 * self.cells(outline.corners)).astype(np.int32)], 1, shift=4)
        return np.asarray(mask, np.bool_)

    def usual(self, evidence: PlaneEvidence, label: str) -> float:
        """The usual mean evidence within the outlines of a class; 0 where there are none."""
        inside = [self.inside(outline) & (evidence.weight > 0) for outline in self.outlines if outline.label == label]
        means = [float(evidence.of(label)[cells].mean()) for cells in inside if cells.any()]
        return float(np.median(means)) if means else 0.0


def outlines_of(
    structures: Sequence[Structure], classes: Sequence[str], doubted: Collection[str] = ()
) -> list[Outline]:
    """The outlines of the structures of a network's classes; those whose edges are no single ring have none.

    What all sides around are not sure of is common to the map and the camera's path, and moves nothing in the pictures.
    A side is unsure by what its two standard deviations have beyond that, and by at most a quarter of the outline's
    size across it. An outline that is much thicker or thinner than the size most of its class agree on has a wrong
    side, and nobody knows which: both are unsure by half of the outline or of what is usual. Where fewer than half of a
    class agree, all are unsure by a third of their thickness: a row without one sure member of a class would teach that
    there is none. Structures that are `doubted`, by their ids, are unsure all over.
    """
    rings: list[tuple[str, Floats, _Sides]] = []
    trusted: list[bool] = []
    for structure in structures:
        order = ring(structure.edges, len(structure.vertices)) if structure.label in classes else None
        if order is not None:
            corners, covariances = structure.vertices[order], structure.covariances[order]
            rings.append((structure.label, corners, _Sides.of(corners, covariances)))
            trusted.append(structure.id not in doubted)
    usual = _usual_around([sides for _, _, sides in rings])
    doubts = _doubts([label for label, _, _ in rings], [sides for _, _, sides in rings], trusted)
    return [
        Outline(label, corners, np.maximum(doubt, np.minimum(2 * np.maximum(sides.sigmas - least, 0), sides.sizes / 4)))
        for (label, corners, sides), least, doubt in zip(rings, usual, doubts, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Sides:
    """An outline's sides, each from a corner to the next: middles (n, 3), unit directions across them (n, 3), standard
    deviations (n,) m and the outline's sizes (n,) m in these directions."""

    middles: Floats
    across: Floats
    sigmas: Floats
    sizes: Floats

    @property
    def thickness(self) -> float:
        """The outline's lesser size, m."""
        return float(self.sizes.min())

    @classmethod
    def of(cls, corners: Floats, covariances: Floats) -> "_Sides":
        following = np.roll(corners, -1, axis=0)
        across = np.cross(following - corners, _normal(corners))
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        ends = [_along(end, across) for end in (covariances, np.roll(covariances, -1, axis=0))]
        sigmas = np.sqrt(np.maximum(np.maximum(*ends), 0.0))
        return cls((corners + following) / 2, across, sigmas, np.ptp(corners @ across.T, axis=0))


def _usual_around(outlines: Sequence[_Sides]) -> list[Floats]:
    """For the sides of each outline, the least standard deviation (n,) m of the nearest sides that are measured in the
    same direction."""
    if not outlines:
        return []
    middles, across, sigmas = (
        np.concatenate([getattr(sides, name) for sides in outlines]) for name in ("middles", "across", "sigmas")
    )
    near = cKDTree(middles).query(middles, k=np.arange(1, min(AROUND, len(middles)) + 1))[1]
    alike = np.abs(np.einsum("ik,ijk->ij", across, across[near])) > ALIKE
    nearest = alike & (np.cumsum(alike, axis=1) <= NEAREST)
    least = np.where(nearest, sigmas[near], np.inf).min(axis=1)
    return np.split(least, np.cumsum([len(sides.sigmas) for sides in outlines])[:-1])


def _doubts(labels: Sequence[str], outlines: Sequence[_Sides], trusted: Sequence[bool]) -> list[Floats]:
    """For the sides (n,) of each outline, how far around them, m, it is wrong of itself: its thickness is not its
    class's, or it is not `trusted` that it is there."""
    thickness, names = np.array([sides.thickness for sides in outlines]), np.array(labels)
    doubts: list[Floats] = []
    for label, sides, trusts in zip(labels, outlines, trusted, strict=True):
        sizes = thickness[names == label]
        usual = most_common(sizes)
        alike = np.abs(sizes - usual) <= ODD * usual
        doubt = max(sides.thickness, usual) / 2 if abs(sides.thickness - usual) > ODD * usual else 0.0
        if alike.mean() < FEWEST_ALIKE:
            doubt = sides.thickness / 3
        if not trusts:
            doubt = max(sides.thickness, usual)
        doubts.append(np.where(sides.sizes < LONG * sides.thickness, doubt, 0.0))
    return doubts


def most_common(sizes: Floats) -> float:
    """The size that most of (n,) sizes agree on: the median of the half of them that are most alike.

    What is wrong with a structure's edge mostly makes it thicker (a flank is taken for its face, a deck for its edge),
    so that the median of all is too much where many are wrong.
    """
    ordered = np.sort(sizes)
    count = (len(ordered) + 1) // 2
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    return float(np.median(ordered[first : first + count]))


def ring(edges: Ints, count: int) -> list[int] | None:
    """The numbers of `count` vertices in their order around the ring that edges (m, 2) make; None where they make no
    single ring."""
    neighbours: dict[int, list[int]] = {number: [] for number in range(count)}
    for first, second in np.asarray(edges).reshape(-1, 2).tolist():
        neighbours[first].append(second)
        neighbours[second].append(first)
    if count < 3 or any(len(others) != 2 for others in neighbours.values()):
        return None
    order, last = [0], -1
    while len(order) <= count:
        here = order[-1]
        following = next((other for other in neighbours[here] if other != last), last)
        if following == 0:
            break
        order.append(following)
        last = here
    return order if len(order) == count else None


def faces_of(outlines: Sequence[Outline]) -> list[Face]:
    """The planes that outlines lie in: one where most lie in it, and then those of the others, the largest first."""
    return [
        Face(_patch(f"face {number}", plane, members), tuple(members)) for number, (plane, members) in _planes(outlines)
    ]


def _planes(outlines: Sequence[Outline]) -> Iterator[tuple[int, tuple["_Plane", list[Outline]]]]:
    rest, number = list(outlines), 0
    while rest:
        number += 1
        plane = _Plane.through(np.concatenate([outline.corners for outline in rest]))
        members = [outline for outline in rest if plane.holds(outline)]
        if 2 * len(members) < len(rest):
            largest = max(rest, key=lambda outline: float(np.ptp(outline.corners, axis=0).max()))
            plane = _Plane.through(largest.corners)
            members = [outline for outline in rest if outline is largest or plane.holds(outline)]
        yield number, (_Plane.through(np.concatenate([outline.corners for outline in members])), members)
        rest = [outline for outline in rest if not any(outline is member for member in members)]


@dataclass(frozen=True, eq=False)
class _Plane:
    """A plane through a point (3,) with a unit normal (3,)."""

    point: Floats
    normal: Floats

    @classmethod
    def through(cls, points: Floats) -> "_Plane":
        """The plane nearest to points (n, 3)."""
        return cls(points.mean(axis=0), _normal(points))

    def holds(self, outline: Outline) -> bool:
        """Whether all corners of an outline lie in the plane."""
        return float(np.abs((outline.corners - self.point) @ self.normal).max()) <= TOLERANCE_M


def _normal(points: Floats) -> Floats:
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2])


def _patch(name: str, plane: _Plane, outlines: Sequence[Outline]) -> PlanePatch:
    """The smallest upright rectangle of a plane around outlines, in cells of a fifth of the usual outline's lesser
    side."""
    right, up = _axes(plane.normal)
    places = [(outline.corners - plane.point) @ np.stack([right, up], axis=1) for outline in outlines]
    low, high = np.concatenate(places).min(axis=0), np.concatenate(places).max(axis=0)
    thin = float(np.median([cv2.minAreaRect(place.astype(np.float32))[1] for place in places], axis=0).min())
    size = np.maximum(high - low, LEAST_CELL_M)
    cell = max(thin / CELLS_ACROSS, LEAST_CELL_M, float(np.sqrt(size.prod() / MOST_CELLS)))
    return PlanePatch(name, plane.point + low[0] * right + low[1] * up, right, up, size, cell)


def _axes(normal: Floats) -> tuple[Floats, Floats]:
    """Unit vectors to the right and up in a plane; up is along y where the plane is not level."""
    reference = np.eye(3)[1] if abs(normal[1]) < LEVEL else np.eye(3)[2]
    up = reference - (reference @ normal) * normal
    up /= np.linalg.norm(up)
    return np.cross(up, normal), up


def _along(covariances: Floats, directions: Floats) -> Floats:
    """Variances (n,) along unit directions (n, 3)."""
    return np.asarray(np.einsum("ni,nij,nj->n", directions, covariances, directions))


def outline_in(view: ViewSpec, world_from_rig: Floats, outline: Floats) -> Floats | None:
    """The outline (m, 2) px in a view of an outline (n, 3) in the row's frame: the part in front of the camera. None
    where all is behind it."""
    points = (outline - world_from_rig[:3, 3]) @ (world_from_rig[:3, :3] @ view.rig_from_view)
    kept = beyond(points, NEAR * float(np.abs(points).max()))
    return pinhole.project(kept, view.camera) if len(kept) >= 3 else None
