"""Scenes as triangle meshes with what the path tracer's materials need to know at every vertex; numpy only.

World frame as in savmap.types.scenes: x along the aisle, y up, z out of the first row's face; metres.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from savmap.types.scenes import FACES, Box

Floats = NDArray[np.float64]
Shape = Literal["box", "drum", "sack", "roll", "tyres", "cone"]
Shader = Literal["paint", "concrete", "wood", "carton", "film", "stripes", "wire", "lamp", "checker", "paper"]


@dataclass(frozen=True, eq=False)
class Part:
    """A box of the scene as it will be rendered: goods may take another shape inscribed in their box."""

    box: Box
    shader: Shader
    shape: Shape = "box"
    tagged: bool = False
    perforated: bool = False


@dataclass(frozen=True, eq=False)
class Template:
    """A shape in the cube [-0.5, 0.5]^3: points (n, 3), triangles (m, 3), each triangle's index in FACES (m,), -1 for
    none.

    `axes` (n, 2) are the two box axes that run along the surface at each point; `smooth` asks for smooth shading.
    """

    points: Floats
    triangles: NDArray[np.int64]
    faces: NDArray[np.int64]
    axes: NDArray[np.int64]
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class Mesh:
    """n vertices (n, 3) in the world, m triangles (m, 3), their class labels (m,), and the materials' inputs at
    vertices (n, 3).

    `local`: place in the box, m, moved by the box's seed; `flat`: (u, v, 0) m from the face's centre; `extent`: the
    face's sides (m); `base`, `second`: linear RGB; `params`: (scale_m, contrast, roughness); `traits`: (metallic,
    emission, random 0..1); `tag`: (1 where printed labels belong, 1 where holes do, 0).
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    labels: NDArray[np.uint8]
    smooth: NDArray[np.bool_]
    local: Floats
    flat: Floats
    extent: Floats
    base: Floats
    second: Floats
    params: Floats
    traits: Floats
    tag: Floats


ATTRIBUTES = ("local", "flat", "extent", "base", "second", "params", "traits", "tag")


def _box() -> Template:
    points, axes = [], []
    for index in range(6):
        axis, side = index // 2, 2 * (index % 2) - 1
        u, v = {0: (2, 1), 1: (0, 2), 2: (0, 1)}[axis]
        corners = np.zeros((4, 3))
        corners[:, axis] = side / 2
        corners[:, [u, v]] = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
        outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])[axis] * side > 0
        points.append(corners if outward else corners[::-1])
        axes.append(np.tile([u, v], (4, 1)))
    triangles = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(6)[:, None, None]).reshape(-1, 3)
    return Template(np.concatenate(points), triangles, np.repeat(np.arange(6), 2), np.concatenate(axes))


def _lathe(radii: Sequence[float], heights: Sequence[float], axis: int, segments: int = 20) -> Template:
    """A body turned about a box axis; `radii` and `heights` in -0.5..0.5 run from one end to the other."""
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    rings = np.array([[[r * np.cos(a), h, r * np.sin(a)] for a in angles] for r, h in zip(radii, heights, strict=True)])
    rows, columns = np.meshgrid(np.arange(len(radii) - 1), np.arange(segments), indexing="ij")
    low, high = rows * segments + columns, (rows + 1) * segments + columns
    step = (columns + 1) % segments - columns
    triangles = np.stack([low, high, high + step, low, high + step, low + step], axis=-1).reshape(-1, 3)
    order = {1: [0, 1, 2], 2: [2, 0, 1], 0: [1, 2, 0]}[axis]
    points = rings.reshape(-1, 3)[:, order]
    axes = np.tile([0 if axis != 0 else 2, 1], (len(points), 1))
    return Template(points, triangles, np.full(len(triangles), -1), axes, smooth=True)


def _superellipsoid(power: float, rows: int = 9, segments: int = 18) -> Template:
    """A cushion: a sphere pushed towards the cube by `power` (1: sphere, towards 0: cube)."""
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, rows)
    radii = 0.5 * np.abs(np.cos(latitudes)) ** power
    heights = 0.5 * np.sign(latitudes) * np.abs(np.sin(latitudes)) ** power
    body = _lathe(list(radii), list(heights), 1, segments)
    angle = np.arctan2(body.points[:, 2], body.points[:, 0])
    ring = np.hypot(body.points[:, 0], body.points[:, 2])
    points = body.points.copy()
    points[:, 0] = ring * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power
    points[:, 2] = ring * np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power
    return Template(points, body.triangles, body.faces, body.axes, smooth=True)


def _tyres(count: int = 4) -> Template:
    turn = np.linspace(0, 2 * np.pi * count, 8 * count + 1)
    radii = 0.42 + 0.08 * np.sqrt(np.abs(np.sin(turn / 2)))
    return _lathe([0.0, *radii, 0.0], [-0.5, *np.linspace(-0.5, 0.5, len(turn)), 0.5], 1)


TEMPLATES: Mapping[Shape, Template] = {
    "box": _box(),
    "drum": _lathe(
        [0, 0.47, 0.5, 0.48, 0.48, 0.5, 0.48, 0.48, 0.5, 0.47, 0],
        [-0.5, -0.5, -0.49, -0.47, -0.18, -0.16, -0.14, 0.16, 0.18, 0.48, 0.48],
        axis=1,
    ),
    "sack": _superellipsoid(0.45),
    "roll": _lathe([0.08, 0.5, 0.5, 0.08], [-0.5, -0.5, 0.5, 0.5], axis=2, segments=24),
    "tyres": _tyres(),
    "cone": _lathe([0.5, 0.5, 0.0], [-0.5, -0.4, 0.5], axis=1),
}


def _stretch(part: Part) -> Floats:
    """Wood's grain follows the longest side: texture coordinates are shortened along it."""
    return np.where(np.arange(3) == np.argmax(part.box.size), 0.06, 1.0) if part.shader == "wood" else np.ones(3)


def _mesh_of(part: Part, classes: Sequence[str]) -> Mesh:
    template, box, paint = TEMPLATES[part.shape], part.box, part.box.material
    count = len(template.points)
    names = [box.face_labels.get(face) for face in FACES] + [None]
    codes = np.array([classes.index(name) + 1 if name in classes else 0 for name in names], dtype=np.uint8)
    dice = np.random.default_rng(paint.seed + 1000003 * int(abs(box.center).sum() * 100)).uniform(0, 1, 4)
    inside = template.points * box.size
    rows = np.arange(count)[:, None]
    flat = np.column_stack([inside[rows, template.axes], np.zeros(count)])
    extent = np.column_stack([box.size[template.axes], np.zeros(count)])

    def repeated(*values: float) -> Floats:
        return np.tile(np.array(values, dtype=np.float64), (count, 1))

    return Mesh(
        vertices=box.center + inside @ box.rotation.T,
        triangles=template.triangles,
        labels=codes[template.faces],
        smooth=np.full(len(template.triangles), template.smooth),
        local=inside * _stretch(part) + 20 * dice[:3],
        flat=flat,
        extent=extent,
        base=repeated(*paint.color),
        second=repeated(*paint.second_color),
        params=repeated(paint.scale_m, paint.contrast, paint.roughness),
        traits=repeated(paint.metallic, paint.emission, dice[3]),
        tag=repeated(part.tagged, part.perforated, 0),
    )


def join(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one; `meshes` must not be empty."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    columns = {f.name: np.concatenate([getattr(mesh, f.name) for mesh in meshes]) for f in fields(Mesh)}
    columns["triangles"] = np.concatenate([mesh.triangles + at for mesh, at in zip(meshes, starts, strict=False)])
    return Mesh(**columns)


def meshes_by_shader(parts: Sequence[Part], classes: Sequence[str]) -> dict[Shader, Mesh]:
    """One mesh for each material that occurs; labels are 1 + index in `classes`, 0 elsewhere."""
    shaders = sorted({part.shader for part in parts})
    return {name: join([_mesh_of(p, classes) for p in parts if p.shader == name]) for name in shaders}
