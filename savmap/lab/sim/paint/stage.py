"""What a made-up place is built of: boxes, cylinders, polygons, collected one by one and laid out as faces at the
end."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from savmap.lab.sim.paint.faces import MOST_CORNERS, Faces, joined
from savmap.types import Floats

Point = tuple[float, float, float]
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Surface:
    """A texture of the atlas on a face. `span`: metres of one repetition along u and v, 0 stretches it once over the
    face."""

    tile: int
    tint: Rgb = (1.0, 1.0, 1.0)
    span: tuple[float, float] = (0.0, 0.0)

    def tinted(self, tint: Rgb) -> "Surface":
        """The same texture in another colour."""
        return Surface(self.tile, tint, self.span)


@dataclass(frozen=True)
class Gloom:
    """Darkness in a recess, in the frame it is entered in: light falls by `depth` a metre behind z = 0, by `under` up
    to `top`."""

    frame: int
    depth: float
    bottom: float
    top: float
    under: float


@dataclass(frozen=True)
class Tag:
    """What a labelled member is: its class, and its thickness in metres, below which in pixels it is not to be
    judged."""

    label: int = 0
    thickness: float = 1.0


BACKGROUND = Tag()
IGNORED = 255
"""The label of what is not to be judged."""


@dataclass
class Stage:
    """Collects shapes in the present frame (x right, y up, z towards the viewer of its face). Boxes are cheap."""

    rng: np.random.Generator
    sides: int = 0
    """What is added to the label of a labelled box on its sides, top and underside."""
    _frames: list[Floats] = field(default_factory=lambda: [np.eye(4)])
    _frame: int = 0
    _glooms: list[Gloom] = field(default_factory=lambda: [Gloom(0, 0.0, 0.0, 1.0, 0.0)])
    _gloom: int = 0
    _boxes: list[tuple[float, ...]] = field(default_factory=list)
    _polygons: list[tuple[object, ...]] = field(default_factory=list)

    @contextmanager
    def frame(self, at: Point, yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Iterator[None]:
        """A frame at a point of the present one: turned by yaw about y, then by pitch about its x, then by roll about
        its z."""
        before = self._frame
        self._frames.append(self._frames[before] @ _pose(at, yaw_deg, pitch_deg, roll_deg))
        self._frame = len(self._frames) - 1
        yield
        self._frame = before

    @contextmanager
    def gloom(self, depth: float, bottom: float = 0.0, top: float = 1.0, under: float = 0.0) -> Iterator[None]:
        """Whatever is added within is darker behind z = 0 of the present frame, and towards `top`."""
        before = self._gloom
        self._glooms.append(Gloom(self._frame, depth, bottom, top, under))
        self._gloom = len(self._glooms) - 1
        yield
        self._gloom = before

    def place(self, point: Point) -> Floats:
        """A point of the present frame in the world."""
        world: Floats = (self._frames[self._frame] @ np.array([*point, 1.0]))[:3]
        return world

    def box(
        self,
        low: Point,
        high: Point,
        front: Surface,
        side: Surface | None = None,
        top: Surface | None = None,
        tag: Tag = BACKGROUND,
        shade: float = 1.0,
    ) -> None:
        """A box between two corners; `side` and `top` surfaces are as `front` where they are not given."""
        side = side or front
        top = top or side
        row = (*low, *high, self._frame, self._gloom, tag.label, tag.thickness, shade)
        self._boxes.append(row + _flat(front) + _flat(side) + _flat(top))

    def quad(self, origin: Point, u: Point, v: Point, surface: Surface, **more: object) -> None:
        """A parallelogram; further arguments as for `polygon`."""
        self.polygon(origin, u, v, ((0, 0), (1, 0), (1, 1), (0, 1)), surface, **more)  # type: ignore[arg-type]

    def polygon(
        self,
        origin: Point,
        u: Point,
        v: Point,
        outline: Sequence[tuple[float, float]],
        surface: Surface,
        tag: Tag = BACKGROUND,
        shade: float = 1.0,
        two_sided: bool = True,
        mesh: tuple[float, float, float] = (0.0, 0.0, 0.0),
        veil: float = 0.0,
        normals: tuple[Point, Point] | None = None,
    ) -> None:
        """A convex polygon in the plane of u and v, at most MOST_CORNERS corners given in parts of u and v."""
        self._polygons.append(
            (origin, u, v, outline, surface, tag, shade, two_sided, mesh, veil, normals, self._frame, self._gloom)
        )

    def cylinder(
        self, at: Point, radius: float, length: float, side: Surface, lid: Surface, sides: int = 10, lying: bool = False
    ) -> None:
        """An upright cylinder that stands at a point; or one lying along x that begins there."""
        with self.frame(at, 0.0, 0.0, -90.0 if lying else 0.0):
            ring = [2 * math.pi * k / sides for k in range(sides + 1)]
            for k, (a, b) in enumerate(pairwise(ring)):
                p, q = (math.cos(a), 0.0, -math.sin(a)), (math.cos(b), 0.0, -math.sin(b))
                start = (radius * p[0], 0.0, radius * p[2])
                edge = (radius * (q[0] - p[0]), 0.0, radius * (q[2] - p[2]))
                part = Surface(side.tile, side.tint, (-sides, k / sides))
                self.quad(start, edge, (0.0, length, 0.0), part, two_sided=False, normals=(p, q))
            circle = [(0.5 + 0.5 * math.cos(a), 0.5 - 0.5 * math.sin(a)) for a in ring[:-1][:: max(1, sides // 12)]]
            width = 2 * radius
            self.polygon((-radius, length, radius), (width, 0, 0), (0, 0, -width), circle, lid)
            self.polygon((-radius, 0.0, radius), (width, 0, 0), (0, 0, -width), circle, lid)

    def faces(self) -> Faces:
        """All shapes as faces, in the order they were added, boxes first."""
        parts = []
        if self._boxes:
            parts.append(_box_faces(np.array(self._boxes), self._frames, self._glooms, self.sides))
        if self._polygons:
            parts.append(_polygon_faces(self._polygons, self._frames, self._glooms))
        return joined(parts)


def _flat(surface: Surface) -> tuple[float, ...]:
    return (surface.tile, *surface.tint, *surface.span)


def _pose(at: Point, yaw_deg: float, pitch_deg: float, roll_deg: float) -> Floats:
    a, b, c = math.radians(yaw_deg), math.radians(pitch_deg), math.radians(roll_deg)
    sa, ca, sb, cb, sc, cc = math.sin(a), math.cos(a), math.sin(b), math.cos(b), math.sin(c), math.cos(c)
    return np.array(
        [
            [ca * cc + sa * sb * sc, sa * sb * cc - ca * sc, sa * cb, at[0]],
            [cb * sc, cb * cc, -sb, at[1]],
            [ca * sb * sc - sa * cc, sa * sc + ca * sb * cc, ca * cb, at[2]],
            [0, 0, 0, 1],
        ]
    )


_SIDES: tuple[tuple[Point, Point, Point, int], ...] = (
    ((0, 0, 1), (1, 0, 0), (0, 1, 0), 0),
    ((1, 0, 0), (-1, 0, 0), (0, 1, 0), 0),
    ((1, 0, 1), (0, 0, -1), (0, 1, 0), 1),
    ((0, 0, 0), (0, 0, 1), (0, 1, 0), 1),
    ((0, 1, 1), (1, 0, 0), (0, 0, -1), 2),
    ((0, 0, 0), (1, 0, 0), (0, 0, 1), 2),
)
"""A box's faces (front, back, right, left, top, bottom): origin, u and v in parts of its size, and which surface they
have."""

_SQUARE = np.zeros((MOST_CORNERS, 2))
_SQUARE[:4] = ((0, 0), (1, 0), (1, 1), (0, 1))


def _box_faces(rows: Floats, frames: list[Floats], glooms: list[Gloom], sides: int) -> Faces:
    low, size = rows[:, 0:3], rows[:, 3:6] - rows[:, 0:3]
    world = np.array(frames)[rows[:, 6].astype(int)]
    parts = [_one_side(rows, low, size, world, side, frames, glooms) for side in _SIDES]
    for number, part in enumerate(parts[2:], start=2):
        labelled = (part.label > 0) & (part.label != IGNORED)
        parts[number] = replace(part, label=part.label + sides * labelled)
    return joined(parts)


def _one_side(
    rows: Floats,
    low: Floats,
    size: Floats,
    world: Floats,
    side: tuple[Point, Point, Point, int],
    frames: list[Floats],
    glooms: list[Gloom],
) -> Faces:
    origin, u, v = (np.array(part) for part in side[:3])
    count = len(rows)
    surface = rows[:, 11 + 6 * side[3] : 17 + 6 * side[3]]
    turned = world[:, :3, :3]
    points = np.einsum("nij,nj->ni", turned, low + origin * size) + world[:, :3, 3]
    us, vs = (np.einsum("nij,nj->ni", turned, part * size) for part in (u, v))
    normal = np.einsum("nij,j->ni", turned, np.cross(u, v))
    extent = np.stack([np.abs(size @ u), np.abs(size @ v)], axis=1)
    span = surface[:, 4:6]
    repeats = np.where(span > 0, extent / np.where(span > 0, span, 1), 1.0)
    return Faces(
        origin=points,
        u=us,
        v=vs,
        outline=np.broadcast_to(_SQUARE, (count, *_SQUARE.shape)),
        corners=np.full(count, 4, np.int32),
        normals=np.repeat(normal[:, None], 2, axis=1),
        two_sided=np.zeros(count, bool),
        tile=surface[:, 0].astype(np.int32),
        texture=np.concatenate([repeats, np.zeros((count, 2))], axis=1),
        tint=surface[:, 1:4],
        label=rows[:, 8].astype(np.int32),
        thickness=rows[:, 9],
        shade=_gloomy(points, us, vs, rows[:, 7].astype(int), frames, glooms) * rows[:, 10:11],
        mesh=np.zeros((count, 3)),
        veil=np.zeros(count),
    )


def _gloomy(
    origin: Floats, u: Floats, v: Floats, which: NDArray[np.int64], frames: list[Floats], glooms: list[Gloom]
) -> Floats:
    """Shade (N, 4) at the faces' corners in the glooms they were added in."""
    inverse = np.linalg.inv(np.array([frames[gloom.frame] for gloom in glooms]))[which]
    depth, bottom, top, under = np.array([[g.depth, g.bottom, g.top, g.under] for g in glooms])[which].T
    points = np.stack([origin, origin + u, origin + v, origin + u + v], axis=1)
    local = np.einsum("nij,nkj->nki", inverse[:, :3, :3], points) + inverse[:, None, :3, 3]
    height = np.clip((local[..., 1] - bottom[:, None]) / np.maximum(top - bottom, 1e-3)[:, None], 0, 1)
    behind = np.clip(-local[..., 2], 0, None)
    shade: Floats = np.exp(-depth[:, None] * behind) * (1 - under[:, None] * height**2)
    return shade


def _polygon_faces(rows: Sequence[tuple[object, ...]], frames: list[Floats], glooms: list[Gloom]) -> Faces:
    columns = list(zip(*rows, strict=True))
    world = np.array(frames)[list(columns[11])]
    turned = world[:, :3, :3]
    origin = np.einsum("nij,nj->ni", turned, np.array(columns[0], float)) + world[:, :3, 3]
    u, v = (np.einsum("nij,nj->ni", turned, np.array(columns[k], float)) for k in (1, 2))
    surfaces: list[Surface] = list(columns[4])
    tags: list[Tag] = list(columns[5])
    outline, corners = _outlines(columns[3])
    flat = np.cross(u, v)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    normals = np.repeat(flat[:, None], 2, axis=1)
    for k, given in enumerate(columns[10]):
        if given is not None:
            normals[k] = np.array(given) @ turned[k].T
    return Faces(
        origin=origin,
        u=u,
        v=v,
        outline=outline,
        corners=corners,
        normals=normals,
        two_sided=np.array(columns[7], bool),
        tile=np.array([s.tile for s in surfaces], np.int32),
        texture=_repetitions(surfaces, u, v),
        tint=np.array([s.tint for s in surfaces], float),
        label=np.array([tag.label for tag in tags], np.int32),
        thickness=np.array([tag.thickness for tag in tags], float),
        shade=_gloomy(origin, u, v, np.array(columns[12], int), frames, glooms) * np.array(columns[6], float)[:, None],
        mesh=np.array(columns[8], float),
        veil=np.array(columns[9], float),
    )


def _outlines(given: Sequence[Sequence[tuple[float, float]]]) -> tuple[Floats, NDArray[np.int32]]:
    outline = np.zeros((len(given), MOST_CORNERS, 2))
    for k, points in enumerate(given):
        outline[k, : len(points)] = points
    return outline, np.array([len(points) for points in given], np.int32)


def _repetitions(surfaces: Sequence[Surface], u: Floats, v: Floats) -> Floats:
    """Repetitions and offsets (N, 4); a negative span (-n, offset) is the part of a texture from `offset`, 1/n wide."""
    span = np.array([surface.span for surface in surfaces], float)
    extent = np.stack([np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)], axis=1)
    repeats = np.where(span > 0, extent / np.where(span > 0, span, 1), 1.0)
    part = span[:, 0] < 0
    across = np.where(part, -1 / np.where(part, span[:, 0], -1.0), repeats[:, 0])
    along = np.where(part, 1.0, repeats[:, 1])
    return np.stack([across, along, np.where(part, span[:, 1], 0.0), np.zeros(len(span))], axis=1)
