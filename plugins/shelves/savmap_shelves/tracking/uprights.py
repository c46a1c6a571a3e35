"""Uprights on the common axis of all frames: how many there are, and which sighting is of which (paper, III.D)."""

from dataclasses import dataclass

import numpy as np

from savmap.types import Bools, Floats, Ints
from savmap_shelves.tracking.density import cheapest_in_group, medians, modes, nearest, strongest, supported
from savmap_shelves.tracking.sightings import FaceSightings, Sightings

LEAST_AT_END = 0.3
NARROW = 0.75
LEAST_BEAMS = 3
TOGETHER, BESIDE = 0.5, 1.3
LEAST_SIGHTINGS, SURELY, GOES_ALONG, LEAST_SCATTER = 4, 3.0, 0.15, 0.01
"""What goes along with the camera by so large a share of its way lies behind the face, by a fifth of the camera's distance from it."""


@dataclass(frozen=True, eq=False)
class Uprights:
    """Uprights, left to right: x (k, 2) of their left and right edges; which upright each sighting (n,) is of, or -1."""

    x: Floats
    which: Ints

    def beside(self, sightings: Sightings) -> Ints:
        """Which uprights each sighted beam ends at (m, 2), -1 where that is not known."""
        return np.where(sightings.bounds >= 0, np.append(self.which, -1)[sightings.bounds], -1)


def _positions(sightings: FaceSightings, states: Floats) -> Floats:
    """x (n, 2) of the edges of each sighted upright."""
    horizon = sightings.horizon()
    state = states[sightings.upright_frame]
    return (horizon + state[:, 1:2] - state[:, 3:4] * (1 + horizon**2)) / state[:, :1]


def find_uprights(
    sightings: FaceSightings,
    states: Floats,
    frames: Ints,
    sizes: tuple[float, float, float],
) -> Uprights:
    """Uprights with enough support among the sightings of `frames`.

    sizes: kernel bandwidth and reach of a cluster, in x; and the least support, as a share of the usual one.
    """
    bandwidth, reach, least = sizes
    x, beams = _positions(sightings, states), _beam_heights(sightings, states)
    usable = np.isin(sightings.upright_frame, frames) & np.isfinite(x).all(axis=1)
    centre = np.where(usable, x.mean(axis=1), np.nan)
    centres = modes(centre[usable], bandwidth)
    group = sightings.upright_frame * len(sightings.views) + sightings.upright_view
    for _ in range(20):
        which = nearest(centre, centres, reach)
        which = cheapest_in_group(group, which, np.abs(centre - np.append(centres, np.nan)[which]))
        if not len(centres):
            break
        support, sized, count = _support(sightings, centres, which, states, frames)
        width = medians(np.diff(x, axis=1)[:, 0], which, len(centres))
        clash = _clash(centres, width, 2 * reach, group, which)
        kept = _strong(support, sized, count, least, clash)
        if kept.all():
            along = (states[:, 1] / states[:, 0])[sightings.upright_frame]
            drifts = np.array([_drift(along[which == k], centre[which == k]) for k in range(len(centres))])
            kept = ~_go_along(drifts)
        if kept.all():
            shares = _beams_at_ends(Uprights(x, which), sightings, beams, centres)
            fixed = _stand_still(drifts[np.argsort(centres)[[0, -1]]])
            kept = _trimmed(centres, width, count, np.where(fixed, 1.0, shares))
        if kept.all():
            break
        centres = centres[kept]
    return Uprights(medians(x, which, len(centres)), which)


def _support(
    sightings: FaceSightings, x: Floats, which: Ints, states: Floats, frames: Ints
) -> tuple[Floats, Ints, Ints]:
    """Of each upright (k,): its share of sightings in the frames that should show it, their number, and its frames."""
    state = states[frames]
    p = x[:, None] * state[:, 0] - state[:, 1]
    shown, edge = (_inside(sightings, p, frames, margin) for margin in (0.06, 0.0))
    shown = np.where(shown.sum(axis=1, keepdims=True) >= 5, shown, edge)
    hits = np.zeros((len(x), len(states)), dtype=np.bool_)
    hits[which[which >= 0], sightings.upright_frame[which >= 0]] = True
    hits = hits[:, frames]
    share = (hits & shown).sum(axis=1) / np.maximum(shown.sum(axis=1), 1)
    return np.where(shown.sum(axis=1) >= 3, share, 0.0), shown.sum(axis=1), hits.sum(axis=1)


def _inside(sightings: FaceSightings, p: Floats, frames: Ints, margin: float) -> Bools:
    """Whether uprights at tangents p (k, f) lie in a view of `frames` (f,) at some height."""
    number = np.tile(frames, len(p))
    parts = [sightings.visible(p.ravel(), np.full(p.size, q), number, margin) for q in (-1.0, 0.0, 1.0)]
    return np.asarray(np.any(parts, axis=0).reshape(p.shape))


def _clash(x: Floats, width: Floats, apart: float, group: Ints, which: Ints) -> Bools:
    """Which clusters (k, k) are too close to each other to be two: nearer than `apart`, unless the same pictures show both side by side, as they
    do the posts of two racks that stand end to end, or beside a column of the hall.

    group (n,): the picture of each sighting.
    """
    picture = np.unique(group, return_inverse=True)[1]
    shown = np.zeros((len(x), int(picture.max(initial=-1)) + 1), dtype=np.bool_)
    shown[which[which >= 0], picture[which >= 0]] = True
    count = np.maximum(shown.sum(axis=1), 1)
    together = shown.astype(float) @ shown.T.astype(float) / np.minimum(count[:, None], count)
    distance = np.abs(x[:, None] - x)
    both = (together >= TOGETHER) & (distance > BESIDE * (width[:, None] + width) / 2)
    return np.asarray((distance < apart) & ~both)


def _strong(support: Floats, shown: Ints, count: Ints, least: float, clash: Bools) -> Bools:
    """Which clusters stay: of those that clash (k, k) the stronger; when none do, those with enough support. As in `supported`."""
    kept = strongest(np.lexsort((count, support))[::-1], clash)
    return supported(support, shown, count, least) if kept.all() else kept


def _drift(along: Floats, x: Floats) -> tuple[float, float]:
    """The share of the camera's way by which an upright goes along with it, and the standard error, infinite where there are too few sightings. x (n,): the
    upright's place on the face; along (n,): the camera's."""
    known = np.isfinite(x)
    if known.sum() < LEAST_SIGHTINGS or np.ptp(along[known]) == 0:
        return 0.0, np.inf
    slope, offset = np.polyfit(along[known], x[known], 1)
    scatter = max(1.4826 * float(np.median(np.abs(x[known] - offset - slope * along[known]))), LEAST_SCATTER)
    return float(slope), scatter / (float(np.std(along[known])) * np.sqrt(known.sum()))


def _stand_still(drifts: Floats) -> Bools:
    """Which uprights (k,), by their drifts (k, 2), surely stand in the face: what lies behind goes along with the camera."""
    return np.asarray(np.abs(drifts[:, 0]) + SURELY * drifts[:, 1] < GOES_ALONG)


def _go_along(drifts: Floats) -> Bools:
    """Which uprights (k,), by their drifts (k, 2), surely lie behind the face: they go along with the camera more than most do. Uprights of another rack
    come into view so behind the end of a row."""
    known = np.isfinite(drifts[:, 1])
    usual = float(np.median(drifts[known, 0])) if known.any() else 0.0
    return np.asarray(drifts[:, 0] - usual - SURELY * drifts[:, 1] > GOES_ALONG)


def _trimmed(x: Floats, width: Floats, count: Ints, beams: Floats) -> Bools:
    """Leaves out an outermost upright that was in view for a moment only, or that is narrower than the others, unless the beams that end
    at it are as high as others, or it surely stands in the face: `beams` (2,), by the first and the last upright, as shares of what is usual.

    The bay of the first is seen only in part. The second is of another row that comes into view behind the end of this: farther away,
    so that its beams look lower, too.
    """
    kept = np.ones(len(x), dtype=np.bool_)
    if len(x) > 2:
        ends = np.argsort(x)[[0, -1]]
        near = (width[ends] >= NARROW * np.median(width)) | (beams >= NARROW)
        kept[ends] = (count[ends] >= LEAST_AT_END * np.median(count)) & near
    return kept


def _beam_heights(sightings: FaceSightings, states: Floats) -> Floats:
    """How high each sighted beam (m,) is where both corners at one end were sighted; nan where they were not."""
    q = np.where(sightings.corners >= 0, sightings.face.q[sightings.corners], np.nan)
    height = np.diff(q, axis=2)[:, :, 0] / states[sightings.beam_frame, :1]
    known = np.isfinite(height)
    total = np.where(known, height, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)


def _beams_at_ends(uprights: Uprights, sightings: FaceSightings, heights: Floats, x: Floats) -> Floats:
    """The usual height (2,) of the beams that end at the first and at the last upright on their inner sides, as a share of the others';
    0 where few do."""
    order = np.argsort(x)
    bounds, ends = uprights.beside(sightings), order[[0, -1]]
    inner = [bounds[:, 0] == ends[0], bounds[:, 1] == ends[1]]
    known = np.isfinite(heights) & (bounds >= 0).any(axis=1)
    others = heights[known & ~inner[0] & ~inner[1]]
    if not len(others):
        return np.zeros(2)
    usual = float(np.median(others))
    found = [heights[at & known] for at in inner]
    return np.array([np.median(own) / usual if len(own) >= LEAST_BEAMS else 0.0 for own in found])
