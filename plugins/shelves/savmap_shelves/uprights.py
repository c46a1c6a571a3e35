"""Uprights on the common axis of all frames: how many there are, and which sighting is of which (paper, III.D)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Ints
from savmap_shelves.density import modes, nearest, one_each, supported
from savmap_shelves.odometry import at_horizon
from savmap_shelves.sightings import Catalogue, Tangents, visible

LEAST_AT_END = 0.3
NARROW = 0.75


@dataclass(frozen=True)
class Uprights:
    """Found uprights, left to right: x (k, 2) of their left and right edges; of each sighting (n,) which upright it is, or
    -1; support (k,): share of the frames that should show it in which it was seen."""

    x: Floats
    which: Ints
    support: Floats


def places(seen: Catalogue, face: Tangents, states: Floats) -> Floats:
    """x (n, 2) of every sighted upright's edges."""
    horizon = at_horizon(seen, face)
    state = states[seen.upright_frame]
    x: Floats = (horizon + state[:, 1:2] - state[:, 3:4] * (1 + horizon**2)) / state[:, :1]
    return x


def find_uprights(
    seen: Catalogue,
    face: Tangents,
    states: Floats,
    world_from_rig: Floats,
    frames: Ints,
    sizes: tuple[float, float, float],
) -> Uprights:
    """Uprights with enough support among the sightings of `frames`.

    sizes: kernel bandwidth and reach of a cluster, in x; and the least support, as a share of the usual one.
    """
    bandwidth, reach, least = sizes
    x = places(seen, face, states)
    mine = np.isin(seen.upright_frame, frames) & np.isfinite(x).all(axis=1)
    centre = np.where(mine, x.mean(axis=1), np.nan)
    found = modes(centre[mine], bandwidth)
    group = seen.upright_frame * len(seen.views) + seen.upright_view
    for _ in range(20):
        which = nearest(centre, found, reach)
        which = one_each(group, which, np.abs(centre - np.append(found, np.nan)[which]))
        support, sized, count = _support(seen, found, which, states, world_from_rig, frames)
        kept = _strong(found, support, sized, count, least, 2 * reach)
        if kept.all():
            kept = _trimmed(found, _widths(x, which, len(found)), count)
        if kept.all():
            break
        found = found[kept]
    edges = np.array([np.median(x[which == k], axis=0) for k in range(len(found))]).reshape(-1, 2)
    return Uprights(edges, which, support)


def _support(
    seen: Catalogue, x: Floats, which: Ints, states: Floats, world_from_rig: Floats, frames: Ints
) -> tuple[Floats, Ints, Ints]:
    """Of each (k,): the share of the frames that should show it in which it was seen, their number, and how often it was."""
    state = states[frames]
    p = x[:, None] * state[:, 0] - state[:, 1]
    shown, edge = (_inside(seen, p, frames, world_from_rig, margin) for margin in (0.06, 0.0))
    shown = np.where(shown.sum(axis=1, keepdims=True) >= 5, shown, edge)
    hits = np.zeros((len(x), len(states)), dtype=np.bool_)
    hits[which[which >= 0], seen.upright_frame[which >= 0]] = True
    hits = hits[:, frames]
    share = (hits & shown).sum(axis=1) / np.maximum(shown.sum(axis=1), 1)
    return np.where(shown.sum(axis=1) >= 3, share, 0.0), shown.sum(axis=1), hits.sum(axis=1)


def _inside(seen: Catalogue, p: Floats, frames: Ints, world_from_rig: Floats, margin: float) -> NDArray[np.bool_]:
    """Whether uprights at tangents p (k, f) lie in a view of `frames` (f,) at some height."""
    number = np.tile(frames, len(p))
    parts = [visible(seen, (p.ravel(), np.full(p.size, q)), number, world_from_rig, margin) for q in (-1.0, 0.0, 1.0)]
    return np.asarray(np.any(parts, axis=0).reshape(p.shape))


def _strong(x: Floats, support: Floats, shown: Ints, count: Ints, least: float, apart: float) -> NDArray[np.bool_]:
    """Which clusters stay: of those too close to each other the stronger; when none are, those with enough support."""
    kept = np.zeros(len(x), dtype=np.bool_)
    for index in np.lexsort((count, support))[::-1]:
        kept[index] = not (np.abs(x[kept] - x[index]) < apart).any()
    if not kept.all():
        return kept
    return supported(support, shown, count, least)


def _widths(x: Floats, which: Ints, count: int) -> Floats:
    return np.array([np.median(np.diff(x[which == k], axis=1)) for k in range(count)])


def _trimmed(x: Floats, width: Floats, count: Ints) -> NDArray[np.bool_]:
    """Leaves out an outermost upright that was in view for a moment only, for its section is seen only in part, or that is
    narrower than the others, for it is of another row that comes into view behind this one's end."""
    kept = np.ones(len(x), dtype=np.bool_)
    if len(x) > 2:
        ends = np.argsort(x)[[0, -1]]
        kept[ends] = (count[ends] >= LEAST_AT_END * np.median(count)) & (width[ends] >= NARROW * np.median(width))
    return kept
