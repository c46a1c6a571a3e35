"""Masks' edges lie outside their structure, or inside it, by much the same everywhere: unknowns of the solve.

A bias of b px makes every width too large by 2 b px and every gap too small by as much (paper, section IV.B). What a pixel
is worth in metres changes with the camera's distance and, in a wide view, with its attitude; widths do not: so the
bias shows.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.types import Floats, Track, Trajectory, ViewSpec
from savmap_shelves.sharing import directions

OWN_SHARE = 0.25


def bias_sigmas(sigma_px: float) -> tuple[float, ...]:
    """Priors of three biases: all edges', and what uprights' and beams' have beside that; () where there is none."""
    return (sigma_px, OWN_SHARE * sigma_px, OWN_SHARE * sigma_px) if sigma_px > 0 else ()


def mask_bias(tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory) -> dict[str, Floats]:
    """By track, how its pixels move (n, 2, 3) with each bias: edges outwards, across themselves."""
    return {track.name: _moves(track, directions(track, views, start)) for track in tracks}


def _moves(track: Track, axes: Floats) -> Floats:
    """A corner slides along one of its edges where the other moves; axes (n, 2, 2) are the image's x and y directions."""
    x, y = axes[:, :, 0], axes[:, :, 1]
    per_px = 1 / np.maximum(np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]), 0.1)
    beam = track.label == "beam"
    right = (track.place["side"] == "left") == beam
    upright = (1.0 if right else -1.0) * per_px[:, None] * x
    up = 1.0 if track.place.get("edge") == "upper" else -1.0
    level = up * per_px[:, None] * y if beam else np.zeros_like(y)
    return np.stack([upright + level, upright, level], axis=-1)
