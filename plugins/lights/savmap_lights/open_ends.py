"""Strips of which one end was never seen: mapped as far as they were, with a standard deviation that says so."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Structure, Track
from savmap_lights.doubts import UNKNOWN_M
from savmap_lights.tracking import SEEN_TO


def with_open_ends(lamps: Sequence[Structure], tracks: Sequence[Track]) -> list[Structure]:
    """The lamps; those with one end in sight get a vertex for the other, `UNKNOWN_M` along x."""
    seen_to = {
        f"{track.label} {track.place[track.label]}": float(track.place[SEEN_TO]) / 1000
        for track in tracks
        if SEEN_TO in track.place
    }
    return [_opened(lamp, seen_to[lamp.id]) if lamp.id in seen_to else lamp for lamp in lamps]


def _opened(lamp: Structure, x: float) -> Structure:
    far = lamp.vertices[0].copy()
    far[0] = x
    covariance = lamp.covariances[0].copy()
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = UNKNOWN_M**2
    vertices, covariances = np.stack([lamp.vertices[0], far]), np.stack([lamp.covariances[0], covariance])
    label = "end 1" if lamp.vertex_labels[0] == "end 0" else "end 0"
    order = [0, 1] if label == "end 1" else [1, 0]
    labels = (lamp.vertex_labels[0], label)
    return replace(
        lamp,
        vertices=vertices[order],
        covariances=covariances[order],
        vertex_labels=tuple(labels[k] for k in order),
        edges=np.array([[0, 1]], np.int64),
    )
