"""The rig's attitude in every frame, from edges whose world axis is known (paper, section III-E: initial
orientation)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.geometry.poses import rotations_at
from savmap.geometry.vanishing import orientation_from_edges, plane_normals
from savmap.types import Feature, Floats, Ints, ViewSpec, array_record

AXES = {"x": 0, "y": 1, "z": 2}
LEAST_EDGES = 4
LEAST_INFORMATION = 1 / np.radians(1.5) ** 2


@dataclass(frozen=True, eq=False)
@array_record
class Edges:
    """Edges of known axis, frame by frame: `frames` (n,), axes (n,) 0, 1, 2 for x, y, z, unit rays (n, 2, 3) of their
    ends in the rig frame, and these ends' standard deviations (n, 2) across the edge, radians."""

    frames: Ints
    axes: Ints
    rays: Floats
    sigmas: Floats


def attitudes(features: Sequence[Feature], views: Mapping[str, ViewSpec], start: Floats) -> Floats:
    """world_from_rig (n, 3, 3) of frames 0..n-1, from the features that are edges with an axis; `start` (n, 3, 3).

    Each frame begins from `start`, turned as the frame before it came out. Frames whose edges do not fix all three
    angles are interpolated between their neighbours, relative to `start`; with no frame fixed, `start` is returned.
    """
    edges = _edges(features, views)
    frames = np.unique(edges.frames)
    bounds = (np.searchsorted(edges.frames, frames, side).tolist() for side in ("left", "right"))
    turns: dict[int, Floats] = {}
    last = np.eye(3)
    for frame, low, high in zip(frames.tolist(), *bounds, strict=True):
        attitude = _orientation(edges, slice(low, high), last @ start[frame])
        if attitude is not None:
            last = turns[frame] = attitude @ start[frame].T
    if not turns:
        return start
    return rotations_at(np.arange(len(start)), np.array(list(turns)), np.stack(list(turns.values()))) @ start


def _orientation(edges: Edges, part: slice, start: Floats) -> Floats | None:
    """world_from_rig of one frame by its edges, or None where these leave an angle open."""
    if part.stop - part.start < LEAST_EDGES:
        return None
    rays = edges.rays[part]
    orientation = orientation_from_edges(rays[:, 0], rays[:, 1], edges.axes[part], edges.sigmas[part], start)
    return orientation.world_from_rig if np.linalg.eigvalsh(orientation.information)[0] > LEAST_INFORMATION else None


def _edges(features: Sequence[Feature], views: Mapping[str, ViewSpec]) -> Edges:
    """Those of the features that are edges with an axis, sorted by frame."""
    number = {name: index for index, name in enumerate(views)}
    chosen = [f for f in features if f.axis is not None and len(f.pixels) == 2 and f.view in number]
    chosen.sort(key=lambda feature: feature.frame)
    view = np.array([number[f.view] for f in chosen], np.int64)
    pixels = np.array([f.pixels for f in chosen]).reshape(-1, 2, 2)
    covariance = np.array([f.covariance for f in chosen]).reshape(-1, 2, 2, 2)
    rays, sigmas = np.empty((len(chosen), 2, 3)), np.empty((len(chosen), 2))
    for index, spec in enumerate(views.values()):
        of_view = view == index
        rays[of_view] = spec.rig_rays(pixels[of_view])
        sigmas[of_view] = _sigmas_rad(pixels[of_view], covariance[of_view], rays[of_view], spec)
    axes = [AXES[f.axis] for f in chosen if f.axis is not None]
    return Edges(np.array([f.frame for f in chosen], np.int64), np.array(axes, np.int64), rays, sigmas)


def _sigmas_rad(pixels: Floats, covariance: Floats, ends: Floats, spec: ViewSpec) -> Floats:
    """Standard deviations (n, 2), radians, of edges' ends across these: rays (n, 2, 3) through pixels (n, 2, 2)."""
    along = pixels[:, 1] - pixels[:, 0]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
    sigmas_px = np.sqrt(np.einsum("ni,nkij,nj->nk", across, covariance, across))
    normals, _ = plane_normals(ends[:, 0], ends[:, 1])
    radians_per_px = np.abs(np.einsum("nki,ni->nk", spec.rig_rays(pixels + across[:, None]) - ends, normals))
    sigmas: Floats = np.maximum(sigmas_px * radians_per_px, 1e-6)
    return sigmas
