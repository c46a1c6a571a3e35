"""Class masks of path-traced pictures: rays through the pixels' centres at the very triangles that are rendered."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from savmap.errors import SavmapError
from savmap.sim.camera import CameraSample, view_rays
from savmap.train.blender_mesh import Mesh, Shader, join

IGNORED = 255
_TOO_FAR_M = 14.0

Mask = NDArray[np.uint8]


class MaskCaster:
    """Casts masks of a scene. Wire decks are left out: one sees through them. Raises SavmapError without embreex."""

    def __init__(self, meshes: Mapping[Shader, Mesh], far_label: int) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise SavmapError("masks need the ray caster embreex: install the `sim` extra") from error
        solid = join([mesh for name, mesh in meshes.items() if name != "wire"])
        self._labels = np.append(solid.labels, np.uint8(0))
        self._far_label = far_label
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, solid.vertices[solid.triangles].astype(np.float32))

    def cast(self, eye: CameraSample, width: int, height: int) -> tuple[Mask, NDArray[np.float64]]:
        """The mask (height, width) and the distances (m, inf for nothing). Fronts beyond 14 m are 255: not to be judged.

        `far_label`, given to the caster, is the one class that counts at any distance.
        """
        rays = (view_rays(width, height, eye.hfov_deg) @ eye.world_from_view.T).reshape(-1, 3).astype(np.float32)
        origins = np.tile(eye.origin.astype(np.float32), (len(rays), 1))
        answer = self._scene.run(origins, rays, query="INTERSECT", output=True)
        hit = np.asarray(answer["primID"], dtype=np.int64)
        distance = np.where(hit >= 0, np.asarray(answer["tfar"], dtype=np.float64), np.inf)
        labels = self._labels[hit]
        labels[(labels > 0) & (labels != self._far_label) & (distance > _TOO_FAR_M)] = IGNORED
        return labels.reshape(height, width), distance.reshape(height, width)
