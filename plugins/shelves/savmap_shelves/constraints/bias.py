"""The masks' biases as unknowns of the solve: their edges lie outside their structure, or inside it, by much the same
everywhere.

A bias of b px makes every width too large by 2 b px and every gap too small by as much (paper, section IV.B). What a
pixel is worth in metres changes with the camera's distance and, in a wide view, with its attitude; widths do not: so
the bias shows, if faintly; a single known width shows it well. The bias of a single edge does not show at all, but
counts in its sigma.
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
    """Standard deviations, px, of the bias of all edges, of the further bias of each class's edges, and of each edge's;
    `upright_px`: of an upright's edge, where it is another.

    `common`: whether the first two are estimated, or only allowed for in sigmas. `relative`: they are multiples of each
    measurement's standard deviation instead, as the residuals show it: what is seen badly is likely to be off by more,
    all along.
    """

    all_px: float = 0.0
    class_px: float = 0.0
    edge_px: float = 0.0
    common: Literal["estimated", "considered"] = "considered"
    relative: bool = False
    upright_px: float | None = None


NO_BIAS = BiasSettings()
PICTURES = BiasSettings(0.2, 0.3, 1.2, relative=True, upright_px=0.4)
"""Of edges measured in pictures: what makes normalised errors of widths and heights of maps of simulated footage about
unit-sized."""


def mask_biases(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory, settings: BiasSettings
) -> Biases | None:
    """How pixels move with each bias: an edge outwards, across itself. None if all sigmas are 0."""
    if not max(settings.all_px, settings.class_px, settings.edge_px, settings.upright_px or 0.0) > 0:
        return None
    standing = [track for track in tracks if not is_foot(track)]
    edges: list[Column | Row] = [*sorted({column_of(t) for t in standing})]
    edges += sorted({row_of(t) for t in standing if t.label == "beam"})
    number = {edge: index for index, edge in enumerate(edges, len(CLASSES))}
    moves = [_moves(track, directions(track, views, start), settings.relative) for track in tracks]
    which = [np.tile(_which(track, number), (len(track.frames), 1)) for track in tracks]
    common = [settings.all_px, settings.class_px, settings.class_px]
    upright_px = settings.edge_px if settings.upright_px is None else settings.upright_px
    prior = np.array([*common, *(upright_px if len(edge) == 2 else settings.edge_px for edge in edges)])
    free = (np.arange(len(prior)) < len(CLASSES)) & (settings.common == "estimated")
    return _without_empty(np.concatenate(which), np.concatenate(moves), prior, free & (prior > 0), settings.relative)


def _which(track: Track, number: Mapping[Column | Row, int]) -> Ints:
    """Numbers (5,) of the biases that move a track's observations."""
    if is_foot(track):
        return np.zeros(5, np.int64)
    level = number[row_of(track)] if track.label == "beam" else 0
    return np.array([0, 1, 2, number[column_of(track)], level])


def _moves(track: Track, axes: Floats, relative: bool) -> Floats:
    """What each of five biases, in px or `relative` to standard deviations, adds to the pixels (n, 2, 5): a corner
    slides along an edge if the other moves.

    axes (n, 2, 2): image directions of x and y, as columns.
    """
    if is_foot(track):
        return np.zeros((len(axes), 2, 5))
    x, y = axes[:, :, 0], axes[:, :, 1]
    per_px = 1 / np.maximum(np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]), LEAST_SINE)
    beam = track.label == "beam"
    right = (track.place["side"] == "left") == beam
    across_upright, across_beam = _sigmas(track, axes) if relative else np.ones((2, len(axes)))
    upright = (1.0 if right else -1.0) * (per_px * across_upright)[:, None] * x
    up = 1.0 if track.place.get("edge") == "upper" else -1.0
    level = up * (per_px * across_beam)[:, None] * y if beam else np.zeros_like(y)
    return np.stack([upright + level, upright, level, upright, level], axis=-1)


def _sigmas(track: Track, axes: Floats) -> tuple[Floats, Floats]:
    """Standard deviations (n,) px across the upright's and across the beam's edge that observations lie on."""
    if track.label != "beam":
        return np.sqrt(np.linalg.eigvalsh(track.covariances)[:, 0]), np.zeros(len(axes))
    normals = np.stack([axes[:, 1], -axes[:, 0]], axis=1)[:, :, ::-1]
    upright, level = np.sqrt(np.einsum("nik,nij,njk->kn", normals, track.covariances, normals))
    return np.asarray(upright), np.asarray(level)


def _without_empty(which: Ints, moves: Floats, prior: Floats, free: Bools, relative: bool) -> Biases:
    """The biases whose sigma is not 0."""
    real = prior > 0
    number = np.cumsum(real) - 1
    kept = real[which]
    return Biases(
        np.where(kept, number[which], 0),
        moves * kept[:, None, :],
        prior[real],
        free[real],
        np.full(int(real.sum()), relative),
    )
