"""Where the rig points in every frame, from edges whose world axis is known (paper, section III-E: initial orientation)."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from savmap.geometry.vanishing import orientation_from_edges
from savmap.types import Feature, ViewSpec

Floats = NDArray[np.float64]
AXES = {"x": 0, "y": 1, "z": 2}
LEAST_EDGES = 4
LEAST_INFORMATION = 1 / np.radians(1.5) ** 2


def attitudes(features: Sequence[Feature], views: Mapping[str, ViewSpec], start: Floats) -> Floats:
    """world_from_rig (n, 3, 3) of frames 0..n-1, from the features that are edges with an axis; `start` (n, 3, 3).

    Each frame begins from `start`, turned as the frame before it came out. Frames whose edges do not fix all three angles
    are interpolated between their neighbours, relative to `start`; with no frame fixed, `start` is returned.
    """
    edges: dict[int, list[Feature]] = {}
    for feature in features:
        if feature.axis is not None and len(feature.pixels) == 2 and feature.view in views:
            edges.setdefault(feature.frame, []).append(feature)
    turned: dict[int, Floats] = {}
    last = np.eye(3)
    for frame in sorted(edges):
        found = _orientation(edges[frame], views, last @ start[frame])
        if found is not None:
            last = turned[frame] = found @ start[frame].T
    return _between(turned, len(start)) @ start


def _orientation(edges: Sequence[Feature], views: Mapping[str, ViewSpec], start: Floats) -> Floats | None:
    """world_from_rig of one frame, or None where the edges leave an angle open."""
    if len(edges) < LEAST_EDGES:
        return None
    rays = np.array([views[edge.view].rig_rays(edge.pixels) for edge in edges])
    sigmas = np.array([_sigmas_rad(edge, views[edge.view]) for edge in edges])
    axes = np.array([AXES[edge.axis] for edge in edges if edge.axis is not None])
    found = orientation_from_edges(rays[:, 0], rays[:, 1], axes, sigmas, start)
    return found.world_from_rig if np.linalg.eigvalsh(found.information)[0] > LEAST_INFORMATION else None


def _sigmas_rad(edge: Feature, spec: ViewSpec) -> Floats:
    """Standard deviation (2,) of an edge's ends across it, as angles."""
    along = edge.pixels[1] - edge.pixels[0]
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    pixels = np.sqrt(np.einsum("i,nij,j->n", across, edge.covariance, across))
    ends = spec.rig_rays(edge.pixels)
    normal = np.cross(ends[0], ends[1])
    normal /= max(float(np.linalg.norm(normal)), 1e-9)
    radians_per_px = np.abs((spec.rig_rays(edge.pixels + across) - ends) @ normal)
    sigmas: Floats = np.maximum(pixels * radians_per_px, 1e-6)
    return sigmas


def _between(known: Mapping[int, Floats], count: int) -> Floats:
    """Rotations (count, 3, 3) that pass through the known ones; before the first and after the last they stay."""
    frames = sorted(known)
    if len(frames) < 2:
        return np.tile(known[frames[0]] if frames else np.eye(3), (count, 1, 1))
    path = Slerp(frames, Rotation.from_matrix(np.stack([known[frame] for frame in frames])))
    matrices: Floats = path(np.clip(np.arange(count), frames[0], frames[-1])).as_matrix()
    return matrices
