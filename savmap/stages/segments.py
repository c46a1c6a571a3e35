"""Straight segments all over a panorama, and the building's axes they follow."""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.errors import StructureError
from savmap.geometry.vanishing import Floats, manhattan_from_segments
from savmap.stages.render import Renderer
from savmap.types import Panorama, View, ViewSpec

LOOKS = [
    *(ViewSpec(f"level {yaw}", yaw, 0, 0, 100, 512, 512) for yaw in (0, 90, 180, 270)),
    *(ViewSpec(f"pole {pitch}", 45, pitch, 0, 100, 512, 512) for pitch in (90, -90)),
]
SHORTEST_PX = 25.0
LEAST_SUPPORT = 0.25


def manhattan(panoramas: Sequence[Panorama], renderer: Renderer) -> Floats:
    """rig_from_manhattan (3, 3): the building's axes in the rig frame, as columns; mean over frames of one pass.

    y is the axis nearest the rig's up, z of the others the one nearest its back (so that one looks along -z). The rig may
    be turned any way about the vertical and tilted by some 45 degrees. StructureError where no three axes stand out.
    """
    edges = [segments(panorama, renderer) for panorama in panoramas]
    rays_a, rays_b = (np.concatenate([pair[side] for pair in edges]) for side in (0, 1))
    coarse = manhattan_from_segments(rays_a, rays_b)
    if coarse is None or coarse.support < LEAST_SUPPORT:
        raise StructureError(
            "no building directions stand out in the pictures; give the views' angles in the site file"
        )
    each = [manhattan_from_segments(*pair, coarse.rig_from_manhattan) for pair in edges]
    return _mean([found.rig_from_manhattan for found in each if found is not None])


def _mean(rotations: Sequence[Floats]) -> Floats:
    """The rotation nearest to all of these."""
    left, _, right = np.linalg.svd(np.median(rotations, axis=0))
    mean: Floats = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    return mean


def segments(panorama: Panorama, renderer: Renderer) -> tuple[Floats, Floats]:
    """Unit rays (n, 3) of the ends of the straight segments seen in views that cover the sphere, rig frame."""
    found = [_in_view(renderer.render(panorama, look)) for look in LOOKS]
    return np.concatenate([pair[0] for pair in found]), np.concatenate([pair[1] for pair in found])


def _in_view(view: View) -> tuple[Floats, Floats]:
    grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY)
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if lines is None else np.asarray(lines, np.float64).reshape(-1, 2, 2)
    ends = ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > SHORTEST_PX]
    return view.spec.rig_rays(ends[:, 0]), view.spec.rig_rays(ends[:, 1])
