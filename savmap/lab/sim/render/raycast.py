"""Casting rays at boxes: which face of which box a ray hits first, and where.

All boxes become one triangle mesh (two triangles a face), so a primitive's number says its box and its face.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.errors import SavmapError
from savmap.lab.scenes import FACES, Box
from savmap.types import Floats

Ints = NDArray[np.int64]

_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64)
_SIDES = np.array(
    [
        [[-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]],
        [[1, -1, 1], [1, -1, -1], [1, 1, -1], [1, 1, 1]],
        [[-1, -1, -1], [1, -1, -1], [1, -1, 1], [-1, -1, 1]],
        [[-1, 1, 1], [1, 1, 1], [1, 1, -1], [-1, 1, -1]],
        [[1, -1, -1], [-1, -1, -1], [-1, 1, -1], [1, 1, -1]],
        [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    ],
    dtype=np.float64,
)
_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


class RayCasterMissingError(SavmapError):
    """The ray caster is an optional dependency."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What n rays hit: box (n,) and face (n,) as indices (-1: nothing), distance (n,) m, world point and normal (n,
    3)."""

    box: Ints
    face: Ints
    distance: Floats
    point: Floats
    normal: Floats


def corners(box: Box) -> Floats:
    """The corners (6, 4, 3) of a box's faces in the order of FACES, counter-clockwise seen from outside, world."""
    world: Floats = box.center + (_SIDES * (box.size / 2)) @ box.rotation.T
    return world


def require_ray_caster() -> None:
    """Raise RayCasterMissingError where rays cannot be cast, before anything is made for them."""
    _embree()


def _embree() -> tuple[Any, Any]:
    try:
        mesh = importlib.import_module("embreex.mesh_construction")
        scene = importlib.import_module("embreex.rtcore_scene")
    except ImportError as error:
        raise RayCasterMissingError(
            "the simulator's ray caster (embreex) is not installed; install the `sim` extra"
        ) from error
    return scene.EmbreeScene, mesh.TriangleMesh


class TriangleCaster:
    """Casts rays at triangles (n, 3, 3). Queries do not change it. Raises RayCasterMissingError without embreex."""

    def __init__(self, triangles: Floats) -> None:
        scene_type, mesh_type = _embree()
        self._scene = scene_type()
        self._mesh = mesh_type(self._scene, triangles.astype(np.float32))

    def first(self, origin: Floats, directions: Floats) -> tuple[Ints, Floats]:
        """The triangles (n,) that rays from `origin` (3,) or (n, 3) along unit `directions` (n, 3) hit first, -1 for
        none, and their distances (n,) m, infinite for none."""
        answer = self._run(origin, directions, output=True, query="INTERSECT")
        triangle = np.asarray(answer["primID"], dtype=np.int64)
        return triangle, np.where(triangle >= 0, np.asarray(answer["tfar"], dtype=np.float64), np.inf)

    def blocked(self, origin: Floats, directions: Floats, reach: Floats) -> NDArray[np.bool_]:
        """Whether anything is in the way from `origin` (n, 3) along unit `directions` (n, 3) up to `reach` (n,) m."""
        answer = self._run(origin, directions, dists=np.asarray(reach, dtype=np.float32), query="OCCLUDED")
        hit: NDArray[np.bool_] = np.asarray(answer) != -1
        return hit

    def _run(self, origin: Floats, directions: Floats, **query: Any) -> Any:
        origins = np.ascontiguousarray(np.broadcast_to(origin, directions.shape), dtype=np.float32)
        return self._scene.run(origins, np.ascontiguousarray(directions, dtype=np.float32), **query)


class Caster(TriangleCaster):
    """Casts rays at a fixed list of boxes. Raises RayCasterMissingError without embreex."""

    def __init__(self, boxes: Sequence[Box]) -> None:
        self.boxes = list(boxes)
        self._normals = np.array([_NORMALS @ box.rotation.T for box in boxes]).reshape(-1, 3)
        super().__init__(np.array([corners(box)[:, _TRIANGLES] for box in boxes]).reshape(-1, 3, 3))

    def __reduce__(self) -> tuple[type["Caster"], tuple[list[Box]]]:
        return Caster, (self.boxes,)

    def cast(self, origin: Floats, directions: Floats) -> Hits:
        """First hits of rays from `origin` (3,) or (n, 3) along unit `directions` (n, 3); misses are infinitely far."""
        triangle, distance = self.first(origin, directions)
        hit = triangle >= 0
        side = np.where(hit, triangle // 2, 0)
        return Hits(
            box=np.where(hit, side // 6, -1),
            face=np.where(hit, side % 6, -1),
            distance=distance,
            point=origin + np.where(hit, distance, 0.0)[:, None] * directions,
            normal=self._normals.take(side, axis=0) * hit[:, None],
        )

    def labels(self, hits: Hits, classes: Sequence[str]) -> NDArray[np.uint8]:
        """The class of every hit: 0 for the background, k for classes[k - 1]. Where `NAME_side` is one of them, it is
        that of the other faces of a box with a face of the class NAME."""
        table = np.zeros((len(self.boxes) + 1, len(FACES)), dtype=np.uint8)
        for index, box in enumerate(self.boxes):
            sides = {face: f"{name}_side" for name in box.face_labels.values() for face in FACES}
            for face, name in {**sides, **box.face_labels}.items():
                table[index, FACES.index(face)] = classes.index(name) + 1 if name in classes else 0
        return table[hits.box, hits.face]
