"""The rig's attitude in every frame, from edges whose world axis is known (paper, section III-E: initial orientation)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from savmap.geometry.vanishing import orientation_from_edges, plane_normals
from savmap.types import Feature, Floats, Ints, ViewSpec, array_record

AXES = {"x": 0, "y": 1, "z": 2}
LEAST_EDGES = 4
LEAST_INFORMATION = 1 / np.radians(1.5) ** 2


@dataclass(frozen=True, eq=False)
@array_record
class Edges:
    """Edges of known axis, frame by frame: `frames` (n,), axes (n,) 0, 1, 2 for x, y, z, unit rays (n, 2, 3) of their ends in the
    rig frame, and these ends' standard deviations (n, 2) across the edge, radians."""

    frames: Ints
    axes: Ints
    rays: Floats
    sigmas: Floats


def attitudes(features: Sequence[Feature], views: Mapping[str, ViewSpec], start: Floats) -> Floats:
    """world_from_rig (n, 3, 3) of frames 0..n-1, from the features that are edges with an axis; `start` (n, 3, 3).

    Each frame begins from `start`, turned as the frame before it came out. Frames whose edges do not fix all three angles
    are interpolated between their neighbours, relative to `start`; with no frame fixed, `start` is returned.
    """
    edges = _edges(features, views)
    frames = np.unique(edges.frames)
    bounds = (np.searchsorted(edges.frames, frames, side).tolist() for side in ("left", "right"))
    turned: dict[int, Floats] = {}
    last = np.eye(3)
    for frame, low, high in zip(frames.tolist(), *bounds, strict=True):
        found = _orientation(edges, slice(low, high), last @ start[frame])
        if found is not None:
            last = turned[frame] = found @ start[frame].T
    return _between(turned, len(start)) @ start


def _orientation(edges: Edges, own: slice, start: Floats) -> Floats | None:
    """world_from_rig of one frame by its own edges, or None where these leave an angle open."""
    if own.stop - own.start < LEAST_EDGES:
        return None
    rays = edges.rays[own]
    found = orientation_from_edges(rays[:, 0], rays[:, 1], edges.axes[own], edges.sigmas[own], start)
    return found.world_from_rig if np.linalg.eigvalsh(found.information)[0] > LEAST_INFORMATION else None


def _edges(features: Sequence[Feature], views: Mapping[str, ViewSpec]) -> Edges:
    """Those of the features that are edges with an axis, sorted by frame."""
    number = {name: index for index, name in enumerate(views)}
    own = [f for f in features if f.axis is not None and len(f.pixels) == 2 and f.view in number]
    own.sort(key=lambda feature: feature.frame)
    view = np.array([number[f.view] for f in own], np.int64)
    pixels = np.array([f.pixels for f in own]).reshape(-1, 2, 2)
    covariance = np.array([f.covariance for f in own]).reshape(-1, 2, 2, 2)
    rays, sigmas = np.empty((len(own), 2, 3)), np.empty((len(own), 2))
    for index, spec in enumerate(views.values()):
        mine = view == index
        rays[mine] = spec.rig_rays(pixels[mine])
        sigmas[mine] = _sigmas_rad(pixels[mine], covariance[mine], rays[mine], spec)
    axes = [AXES[f.axis] for f in own if f.axis is not None]
    return Edges(np.array([f.frame for f in own], np.int64), np.array(axes, np.int64), rays, sigmas)


def _sigmas_rad(pixels: Floats, covariance: Floats, ends: Floats, spec: ViewSpec) -> Floats:
    """Standard deviations (n, 2) of edges' ends across these, as angles; rays `ends` (n, 2, 3) go through pixels (n, 2, 2)."""
    along = pixels[:, 1] - pixels[:, 0]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
    sigmas_px = np.sqrt(np.einsum("ni,nkij,nj->nk", across, covariance, across))
    normals, _ = plane_normals(ends[:, 0], ends[:, 1])
    radians_per_px = np.abs(np.einsum("nki,ni->nk", spec.rig_rays(pixels + across[:, None]) - ends, normals))
    sigmas: Floats = np.maximum(sigmas_px * radians_per_px, 1e-6)
    return sigmas


def _between(known: Mapping[int, Floats], count: int) -> Floats:
    """Rotations (count, 3, 3) that pass through the known ones; before the first and after the last they stay."""
    frames = sorted(known)
    if len(frames) < 2:
        return np.tile(known[frames[0]] if frames else np.eye(3), (count, 1, 1))
    path = Slerp(frames, Rotation.from_matrix(np.stack([known[frame] for frame in frames])))
    matrices: Floats = path(np.clip(np.arange(count), frames[0], frames[-1])).as_matrix()
    return matrices
