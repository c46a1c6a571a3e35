"""Corners on one upright edge share that edge's line fit: its information is counted once, not once a corner."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.types import Floats, Ints, Track, Trajectory, ViewSpec
from savmap_shelves.constraints.track_grid import Column, column_of

APART = 1e6


def share_edges(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory
) -> tuple[list[Track], dict[str, Floats]]:
    """Tracks with inflated covariances, and what each observation is worth in equations (for `observe`).

    Where n corners are seen on one edge in one view, their variance along the beam (which is the upright's, across it)
    grows n times. Beams and uprights lie on different planes: corners say nothing along the beam where the ends of the
    upright's edge are seen in any view. A thousand corners, however faint, would hold the beams to the face plane, and
    so would a dozen good ones.
    """
    corners = Counter(line for track in tracks if track.label == "beam" for line in _lines(track))
    placed = {column_of(track) for track in tracks if track.label != "beam"}
    shared, worth = [], {}
    for track in tracks:
        if track.label == "beam":
            count = np.array([corners[line] * (APART if line[2] in placed else 1.0) for line in _lines(track)])
            shared.append(_stretched(track, count, directions(track, views, start)))
            worth[track.name] = 1.0 + 1.0 / count
        else:
            shared.append(track)
            worth[track.name] = np.ones(len(track.frames))
    return shared, worth


def _lines(track: Track) -> list[tuple[int, str, Column]]:
    """The fitted line that each observation lies on: frame, view and upright edge."""
    column = column_of(track)
    return [(frame, view, column) for frame, view in zip(track.frames.tolist(), track.views, strict=True)]


def directions(track: Track, views: Mapping[str, ViewSpec], start: Trajectory) -> Floats:
    """Image directions (n, 2, 2), as columns: along the world's x axis, then along y, at each observed pixel.

    A frame that the start lacks takes the attitude of the next one it has: a few degrees do not matter here.
    """
    names = sorted(set(track.views))
    which: Ints = np.array([names.index(view) for view in track.views])
    cameras = np.array([views[name].camera for name in names])[which]
    rig_from_view = np.array([views[name].rig_from_view for name in names])[which]
    order = np.argsort(start.frames)
    at = np.searchsorted(start.frames[order], track.frames).clip(max=len(order) - 1)
    world_from_view = start.world_from_rig[order[at], :3, :3] @ rig_from_view
    rays = np.concatenate([track.pixels - cameras[:, :2, 2], cameras[:, 0, 0][:, None]], axis=1)
    axes = np.swapaxes(world_from_view, 1, 2)[:, :, :2]
    moved = axes[:, :2] * rays[:, 2][:, None, None] - rays[:, :2, None] * axes[:, 2:3]
    unit: Floats = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    return unit


def _stretched(track: Track, factor: Floats, directions: Floats) -> Track:
    """Variances along the first direction times `factor` (n,): the corner's two lines are taken apart along their
    axes."""
    inverse = np.linalg.inv(directions)
    parts = inverse @ track.covariances @ np.swapaxes(inverse, 1, 2)
    scale = np.ones((len(factor), 2))
    scale[:, 0] = np.sqrt(factor)
    parts = parts * scale[:, :, None] * scale[:, None, :]
    covariances = directions @ parts @ np.swapaxes(directions, 1, 2)
    return replace(track, covariances=(covariances + np.swapaxes(covariances, 1, 2)) / 2)
