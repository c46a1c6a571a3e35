"""The masks' biases as unknowns of the solve: their edges lie outside their structure, or inside it, by much the same everywhere.

A bias of b px makes every width too large by 2 b px and every gap too small by as much (paper, section IV.B). What a pixel
is worth in metres changes with the camera's distance and, in a wide view, with its attitude; widths do not: so the
bias shows, if faintly; a single known width shows it well. The bias of a single edge does not show at all, but counts
in its sigma.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.graph import Biases
from savmap.types import Bools, Floats, Ints, Track, Trajectory, ViewSpec
from savmap_shelves.constraints.sharing import directions
from savmap_shelves.constraints.track_grid import Column, Row, column_of, is_foot, row_of

CLASSES = ("all", "upright", "beam")
LEAST_SINE = 0.1


@dataclass(frozen=True)
class BiasSettings:
    """Standard deviations, px, of the bias of all edges, of the further bias of each class's edges, and of each edge's.

    `common`: whether the first two are estimated, or only allowed for in sigmas.
    """

    all_px: float = 0.0
    class_px: float = 0.0
    edge_px: float = 0.0
    common: Literal["estimated", "considered"] = "considered"


NO_BIAS = BiasSettings()
PICTURES = BiasSettings(0.15, 0.25, 0.25)
"""Of the plugin's network: what makes normalised errors of widths and gaps of maps of simulated footage unit-sized."""


def mask_biases(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory, settings: BiasSettings
) -> Biases | None:
    """How pixels move with each bias: an edge outwards, across itself. None if all sigmas are 0."""
    if not max(settings.all_px, settings.class_px, settings.edge_px) > 0:
        return None
    standing = [track for track in tracks if not is_foot(track)]
    edges: list[Column | Row] = [*sorted({column_of(t) for t in standing})]
    edges += sorted({row_of(t) for t in standing if t.label == "beam"})
    number = {edge: index for index, edge in enumerate(edges, len(CLASSES))}
    moves = [_moves(track, directions(track, views, start)) for track in tracks]
    which = [np.tile(_which(track, number), (len(track.frames), 1)) for track in tracks]
    common = [settings.all_px, settings.class_px, settings.class_px]
    prior = np.array([*common, *(len(edges) * [settings.edge_px])])
    free = (np.arange(len(prior)) < len(CLASSES)) & (settings.common == "estimated")
    return _without_empty(np.concatenate(which), np.concatenate(moves), prior, free & (prior > 0))


def _which(track: Track, number: Mapping[Column | Row, int]) -> Ints:
    """Numbers (5,) of the biases that move a track's observations."""
    if is_foot(track):
        return np.zeros(5, np.int64)
    level = number[row_of(track)] if track.label == "beam" else 0
    return np.array([0, 1, 2, number[column_of(track)], level])


def _moves(track: Track, axes: Floats) -> Floats:
    """What each of five biases adds to the pixels (n, 2, 5): a corner slides along an edge if the other moves.

    axes (n, 2, 2): image directions of x and y, as columns.
    """
    if is_foot(track):
        return np.zeros((len(axes), 2, 5))
    x, y = axes[:, :, 0], axes[:, :, 1]
    per_px = 1 / np.maximum(np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]), LEAST_SINE)
    beam = track.label == "beam"
    right = (track.place["side"] == "left") == beam
    upright = (1.0 if right else -1.0) * per_px[:, None] * x
    up = 1.0 if track.place.get("edge") == "upper" else -1.0
    level = up * per_px[:, None] * y if beam else np.zeros_like(y)
    return np.stack([upright + level, upright, level, upright, level], axis=-1)


def _without_empty(which: Ints, moves: Floats, prior: Floats, free: Bools) -> Biases:
    """The biases whose sigma is not 0."""
    real = prior > 0
    number = np.cumsum(real) - 1
    kept = real[which]
    return Biases(np.where(kept, number[which], 0), moves * kept[:, None, :], prior[real], free[real])
