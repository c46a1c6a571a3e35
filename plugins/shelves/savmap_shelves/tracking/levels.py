"""Beam levels of each bay by kernel density over the corners' heights, and which sighting is of which (paper, III.D)."""

from dataclasses import dataclass

import numpy as np

from savmap.types import Bools, Floats, Ints
from savmap_shelves.evidence.face_grid import ROOM
from savmap_shelves.evidence.wide_steps import wide_steps
from savmap_shelves.tracking.density import cheapest_in_group, medians, modes, mostly, nearest, strongest, supported
from savmap_shelves.tracking.sightings import FaceSightings
from savmap_shelves.tracking.uprights import Uprights

THIN, RARE, THICK = 0.86, 0.92, 2.0
NEAR_FLOOR, LOW, ON_FLOOR, SURE = 0.12, 0.2, 0.016, 0.6
LEAST_LEVELS, SCATTER, LEAST_SCATTER = 2, 4.0, 0.4
WEAK = 0.5
"""The share of the least support that is enough of what all frames together show where a bay lacks a level."""


@dataclass(frozen=True, eq=False)
class Levels:
    """Beams: bay (k,) from 0, y (k, 2) of their lower and upper edges, sorted by bay, then height.

    which (m,): which beam each sighting is of, or -1. ends (m, 2): whether its corners at the left and right upright may
    be used.
    """

    section: Ints
    y: Floats
    which: Ints
    ends: Bools

    def without(self, left_out: Bools) -> "Levels":
        """Levels but for some (k,): their sightings are of none."""
        number = np.append(np.where(left_out, -1, np.cumsum(~left_out) - 1), -1)
        return Levels(self.section[~left_out], self.y[~left_out], number[self.which], self.ends)


def seen_through(section: Ints, scatter: Floats) -> Bools:
    """Which levels (k,) are seen through a passage: those of bays (k,) with several levels that all scatter by several times what is usual.

    What lies behind the face moves on it as the camera sways, and what looks like one beam there is a different one from time to time. So no
    level of such a bay keeps its height as those of the other bays do; in a bay of this row at least one does.
    scatter (k, 2): the median residual of each level's lower and upper edge, over its sigma.
    """
    least = scatter.min(axis=1)
    loose = least > max(LEAST_SCATTER, SCATTER * float(np.median(least)))
    found = np.zeros(len(section), dtype=np.bool_)
    for number in np.unique(section):
        here = section == number
        found |= here & (here.sum() >= LEAST_LEVELS) & loose[here].all()
    return found


def heights_of(sightings: FaceSightings, corners: Ints, states: Floats) -> Floats:
    """y (m, 2, 2) of the corners (m, 2, 2) of each sighted beam: side (left, right), edge (lower, upper); nan where missing."""
    p, q = sightings.face.p[corners], sightings.face.q[corners]
    state = states[sightings.beam_frame][:, None, None]
    y = (q + state[..., 2] - state[..., 3] * p * q - state[..., 4] * (1 + q**2) + state[..., 5] * p) / state[..., 0]
    return np.where(corners >= 0, y, np.nan)


def _sections(sightings: FaceSightings, states: Floats, uprights: Uprights) -> tuple[Ints, Bools]:
    """The bay (m,) that each sighted beam lies in, -1 if that is not sure, and which of its ends (m, 2) are in it.

    A beam whose two uprights are not neighbours, or whose extent passes over an upright that was not sighted in
    that frame, may lie in either bay and is not used.
    """
    bound = uprights.beside(sightings)
    left = np.where(bound[:, 0] >= 0, bound[:, 0], -1)
    right = np.where(bound[:, 1] >= 0, bound[:, 1] - 1, -1)
    section = np.where(left >= 0, left, right)
    unsure = (left >= 0) & (right >= 0) & (left != right)
    outside = (section < 0) | (section > len(uprights.x) - 2)
    section = np.where(unsure | outside | _crosses(sightings, states, uprights), -1, section)
    return section, (bound >= 0) & (section >= 0)[:, None]


def _crosses(sightings: FaceSightings, states: Floats, uprights: Uprights) -> Bools:
    """Whether a beam's extent (m,) passes over the middle of an upright."""
    state = states[sightings.beam_frame][:, None]
    x = (np.where(sightings.spans >= 0, sightings.face.p[sightings.spans], np.nan) + state[..., 1]) / state[..., 0]
    inner = uprights.x.mean(axis=1)
    margin = 0.04 * float(np.median(np.diff(inner))) if len(inner) > 1 else 0.0
    over = (inner > x.min(axis=1)[:, None] + margin) & (inner < x.max(axis=1)[:, None] - margin)
    crosses: Bools = over.any(axis=1)
    return crosses


def find_levels(
    sightings: FaceSightings,
    states: Floats,
    uprights: Uprights,
    frames: Ints,
    sizes: tuple[float, float],
    floor: float = -np.inf,
    trusting: bool = False,
) -> Levels:
    """Levels with enough support among the sightings of `frames`.

    sizes: the kernel's bandwidth as a share of a beam's height; the least support, as a share of the usual one. floor: the
    height below which levels are doubted. trusting: whether thin ones are kept that all frames together show.
    """
    section, ends = _sections(sightings, states, uprights)
    edges = filled(edges_of(np.where(ends[:, :, None], heights_of(sightings, sightings.corners, states), np.nan)))
    centre = edges.mean(axis=1)
    section = np.where(np.isin(sightings.beam_frame, frames), section, -1)
    if not (section >= 0).any():
        return Levels(np.zeros(0, np.int64), np.zeros((0, 2)), np.full(len(section), -1), ends)
    thickness = float(np.median(np.diff(edges[section >= 0], axis=1)))
    peaks = [modes(centre[section == number], sizes[0] * thickness) for number in range(len(uprights.x) - 1)]
    levels = np.column_stack([np.repeat(np.arange(len(peaks)), [len(y) for y in peaks]), np.concatenate(peaks)])
    for _ in range(20):
        which = _assigned(sightings, section, centre, levels, 0.8 * thickness)
        hits, cover = _hits(sightings, which, (len(levels), len(states)))
        hits, cover = hits[:, frames], cover[:, frames]
        shown = _shown(sightings, states, uprights, levels)[:, frames]
        kept = _distinct(levels, hits, thickness)
        support, expected = _support(hits, cover, shown), expected_levels(sightings, which, len(levels))
        if kept.all():
            alone = expected & ~_crowded(levels, support, thickness)
            kept = _often_enough(levels, support, shown.sum(axis=1), hits.sum(axis=1), sizes[1], expected, alone)
        if kept.all():
            kept = ~_sunk(levels, edges, which, support, floor) | expected
        if kept.all():
            kept = ~_unlike(levels, edges, which, support, floor, expected, trusting)
        if kept.all():
            break
        levels = levels[kept]
    return Levels(levels[:, 0].astype(np.int64), medians(edges, which, len(levels)), which, ends)


def expected_levels(sightings: FaceSightings, which: Ints, count: int) -> Bools:
    """Which levels (k,) all frames together show: the evidence has told them from what lies on the floor, by more than a thickness."""
    corner = sightings.corners.reshape(len(which), -1).max(axis=1)
    return mostly(sightings.points.expected[corner] & (corner >= 0), which, count)


def edges_of(y: Floats) -> Floats:
    """Heights (m, 2) of the lower and upper edge: means over the sides (left, right) that were sighted."""
    known = np.isfinite(y)
    total = np.where(known, y, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)


def filled(edges: Floats) -> Floats:
    """Heights (m, 2) of edges, a missing one as far from the other as is usual: it was read where all frames together show none."""
    whole = np.isfinite(edges).all(axis=1)
    usual = float(np.median(np.diff(edges[whole], axis=1))) if whole.any() else np.nan
    return np.where(np.isfinite(edges), edges, edges[:, ::-1] + usual * np.array([-1.0, 1.0]))


def _assigned(sightings: FaceSightings, section: Ints, centre: Floats, levels: Floats, reach: float) -> Ints:
    which = np.full(len(section), -1)
    for number in np.unique(section[section >= 0]):
        members = np.flatnonzero(levels[:, 0] == number)
        here = np.flatnonzero(section == number)
        near = nearest(centre[here], levels[members, 1], reach)
        which[here] = np.where(near >= 0, np.append(members, -1)[near], -1)
    group = sightings.beam_frame * len(sightings.views) + sightings.beam_view
    return cheapest_in_group(group, which, np.abs(centre - np.append(levels[:, 1], np.nan)[which]))


def _hits(sightings: FaceSightings, which: Ints, shape: tuple[int, int]) -> tuple[Bools, Floats]:
    """Whether a level (k, n) was sighted in a frame, and how much of it its mask covered there, 0 where it was not.

    A beam of a rack behind, seen through an open bay, fills only part of the space between the uprights.
    """
    hits, cover = np.zeros(shape, dtype=np.bool_), np.zeros(shape)
    known = np.flatnonzero(which >= 0)
    place, span = (which[known], sightings.beam_frame[known]), sightings.spans[known, 0]
    hits[place] = True
    cover[place] = np.where(span >= 0, sightings.points.score[span], 1.0)
    return hits, cover


def _support(hits: Bools, cover: Floats, shown: Bools) -> Floats:
    """How sure levels (k,) are: the geometric mean of their share of sightings in the frames that should show them, counted twice,
    and of their cover.

    A beam whose middle is hidden by goods is sighted in most frames, little of it in each; beams of a rack behind, floor
    markings and edges of goods come and go.
    """
    count = np.maximum(shown.sum(axis=1), 1)
    often, whole = (hits & shown).sum(axis=1) / count, (cover * shown).sum(axis=1) / count
    support: Floats = np.cbrt(often**2 * whole)
    return support


def _often_enough(
    levels: Floats, support: Floats, shown: Ints, count: Ints, least: float, expected: Bools, alone: Bools
) -> Bools:
    """Which levels (k,) are sighted often enough, as `supported` says; `WEAK` of it is enough of those that are `expected` (k,) where one is missing."""
    kept, weak = (supported(support, shown, count, share, alone) for share in (least, WEAK * least))
    return np.asarray(kept | (weak & expected & _fills_step(levels, ~kept)))


def _shown(sightings: FaceSightings, states: Floats, uprights: Uprights, levels: Floats) -> Bools:
    """Frames (k, n) that should show a level: its middle is in a view and an upright beside it was sighted."""
    known = np.zeros((len(uprights.x) + 1, len(states)), dtype=np.bool_)
    known[uprights.which, sightings.upright_frame] = uprights.which >= 0
    number = levels[:, 0].astype(np.int64)
    middle = (uprights.x[number, 1] + uprights.x[number + 1, 0]) / 2
    p = middle[:, None] * states[:, 0] - states[:, 1]
    q = levels[:, 1:] * states[:, 0] - states[:, 2]
    frame = np.tile(np.arange(len(states)), len(levels))
    inside = sightings.visible(p.ravel(), q.ravel(), frame, 0.02).reshape(p.shape)
    return inside & (known[number] | known[number + 1])


def _sunk(levels: Floats, edges: Floats, which: Ints, support: Floats, floor: float) -> Bools:
    """Levels below `floor` that are far below it, not as thick as the beams above it, or sighted less: floor markings.

    The floor is known from the uprights' feet only, which guards may hide to above the lowest beams.
    """
    below = levels[:, 1] <= floor
    if not below.any() or below.all():
        return np.asarray(below)
    like = levels[:, 1] > floor - NEAR_FLOOR * (levels[:, 1].max() - floor)
    for share in (0.5, 0.75):
        thickness = _quantiles(edges, which, len(levels), share)
        beams = float(np.median(thickness[~below]))
        like &= (thickness > THIN * beams) & (thickness < beams / THIN)
    return np.asarray(below & ~(like & (support > SURE * np.median(support))))


def _unlike(
    levels: Floats, edges: Floats, which: Ints, support: Floats, floor: float, expected: Bools, trusting: bool
) -> Bools:
    """Levels thinner, even where they seem thickest, or much thicker, even where they seem thinnest, than the sure ones of
    their bay (or of the row, where it has less than two), and sighted less.

    Thin ones are beams of a rack behind, seen through an open bay: farther away, so that they look thinner, and hidden
    now and then. Floor markings and edges of goods are thin as well. A beam hidden in part is seen whole in some frames; the
    lowest one of a bay may be hidden from below in all of them, but it is above the floor; others may be beams that are
    hidden in nearly all frames: those that are `expected` (k,) are kept where these are trusted, are their bay's lowest, or lie where it lacks one. Thick ones are
    girders of the roof, and goods; a beam that goods or girders adjoin in the picture is seen alone in some frames. The lowest one of a bay, which goods on
    the floor adjoin in all of them, is kept where it is `expected`.
    """
    leanest, usual, full = (_quantiles(edges, which, len(levels), share) for share in (0.25, 0.5, 0.75))
    sure = support >= 0.8 * np.median(support)
    thin, thick = np.zeros((2, len(levels)), dtype=np.bool_)
    for k, section in enumerate(levels[:, 0]):
        sure_here = sure & (levels[:, 0] == section)
        peers = float(np.median(usual[sure_here if sure_here.sum() > 1 else sure])) if sure.any() else usual[k]
        thin[k] = full[k] < THIN * peers and support[k] < RARE * np.median(support)
        thick[k] = leanest[k] > THICK * peers and not sure[k]
    low = _low(levels, levels[:, 1] - usual / 2, floor, np.where(expected, LOW, NEAR_FLOOR))
    believed = expected & (trusting | _fills_step(levels, thin))
    return (thick & ~(expected & low)) | (thin & ~believed & ~low)


def _fills_step(levels: Floats, doubted: Bools) -> Bools:
    """Which levels (k,) of those that are `doubted` (k,) lie in a step that would be too wide without them: there one is missing."""
    heights = [np.sort(levels[~doubted & (levels[:, 0] == k), 1]) for k in range(int(levels[:, 0].max(initial=-1)) + 1)]
    found = np.zeros(len(levels), dtype=np.bool_)
    for section, lower, _ in wide_steps(heights):
        low, high = heights[section][lower : lower + 2]
        found |= doubted & (levels[:, 0] == section) & (levels[:, 1] > low) & (levels[:, 1] < high)
    return found


def _low(levels: Floats, lower: Floats, floor: float, near: float | Floats) -> Bools:
    """Which levels (k,) are the lowest of their bay, nearer to the floor than a share of the row's height, with their lower edge (k,) clear of it: what
    hides a beam from below does not reach down to the floor, where pallets and markings lie."""
    if not len(levels) or not np.isfinite(floor):
        return np.zeros(len(levels), dtype=np.bool_)
    height = levels[:, 1].max() - floor
    low = (lower > floor + ON_FLOOR * height) & (levels[:, 1] < floor + near * height)
    lowest = [levels[levels[:, 0] == section, 1].min() for section in levels[:, 0]]
    return np.asarray(low & (levels[:, 1] == lowest))


def _quantiles(edges: Floats, which: Ints, count: int, share: float) -> Floats:
    """The quantile (k,) of each level's thickness over its sightings."""
    thickness = np.diff(edges, axis=1)[:, 0]
    return np.array([np.quantile(thickness[which == k], share) for k in range(count)])


def _crowded(levels: Floats, support: Floats, thickness: float) -> Bools:
    """Which levels (k,) are so near to one of their bay with more support that nothing fits between: one beam may be taken for two."""
    near = np.abs(levels[:, 1, None] - levels[:, 1]) < ROOM * thickness
    same = levels[:, 0, None] == levels[:, 0]
    return np.asarray((near & same & (support > support[:, None])).any(axis=1))


def _distinct(levels: Floats, hits: Bools, thickness: float) -> Bools:
    """Leaves the stronger of two levels that overlap, or that are close and hardly ever sighted together."""
    count = hits.sum(axis=1)
    together = hits.astype(float) @ hits.T.astype(float)
    share = together / np.maximum(np.minimum(count[:, None], count), 1)
    apart = np.abs(levels[:, 1, None] - levels[:, 1]) / thickness
    clash = (apart < 1.1) | ((apart < 2.5) & (share < 0.2)) | ((apart < 8) & (share < 0.1))
    clash &= levels[:, 0, None] == levels[:, 0]
    return strongest(np.argsort(count, kind="stable")[::-1], clash)
