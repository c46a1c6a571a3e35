"""Corners on one upright edge share that edge's line fit: count its information once, not once a corner."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.types import Floats, Ints, Track, Trajectory, ViewSpec

APART = 1e6


def share_edges(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory, apart: bool = False
) -> tuple[list[Track], dict[str, Floats]]:
    """Tracks with inflated covariances, and what each observation is worth in equations (for `observe`).

    Where n corners and the upright's own ends are seen on one edge in one view, the corners' variance along the beam (which
    is the upright's, across it) grows 2n times and the ends' 2 times; n times where only corners were seen. `apart`: beams
    and uprights lie on different planes, so that corners say nothing along the beam where the ends do: those of a thousand pixels, however faint, would
    hold the beams to the face plane.
    """
    corners, ends = _counts(tracks)
    shared, worth = [], {}
    for track in tracks:
        slots = _slots(track)
        with_ends = np.array([ends.get(slot, 0) > 0 for slot in slots])
        if track.label == "beam":
            alone = np.array([corners[slot] for slot in slots])
            count = np.where(with_ends, alone * (APART if apart else 2.0), alone)
            shared.append(_stretched(track, count, directions(track, views, start)))
            worth[track.name] = 1.0 + 1.0 / count
        else:
            count = np.array([2.0 if slot in corners and not apart else 1.0 for slot in slots])
            shared.append(replace(track, covariances=track.covariances * count[:, None, None]))
            worth[track.name] = 1.0 / count
    return shared, worth


def _slots(track: Track) -> list[tuple[int, str, str]]:
    """Frame, view and upright edge of each observation."""
    if track.label == "upright":
        edge = f"{track.place['upright']} {track.place['side']}"
    elif track.place["side"] == "left":
        edge = f"{track.place['section']} right"
    else:
        edge = f"{int(track.place['section']) + 1} left"
    return [(frame, view, edge) for frame, view in zip(track.frames.tolist(), track.views, strict=True)]


def _counts(tracks: Sequence[Track]) -> tuple[dict[tuple[int, str, str], int], dict[tuple[int, str, str], int]]:
    corners: dict[tuple[int, str, str], int] = {}
    ends: dict[tuple[int, str, str], int] = {}
    for track in tracks:
        tally = corners if track.label == "beam" else ends
        for slot in _slots(track):
            tally[slot] = tally.get(slot, 0) + 1
    return corners, ends


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
    """Variances along the first direction times `factor` (n,): the corner's two lines are taken apart along their axes."""
    inverse = np.linalg.inv(directions)
    parts = inverse @ track.covariances @ np.swapaxes(inverse, 1, 2)
    scale = np.ones((len(factor), 2))
    scale[:, 0] = np.sqrt(factor)
    parts = parts * scale[:, :, None] * scale[:, None, :]
    covariances = directions @ parts @ np.swapaxes(directions, 1, 2)
    return replace(track, covariances=(covariances + np.swapaxes(covariances, 1, 2)) / 2)
