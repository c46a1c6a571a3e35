"""Elements out of proportion to their likes, and sizes that no rack has."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from savmap.types import Doubt, Floats, Structure
from savmap_shelves.mapping import NEITHER, NOT_SEEN, Elements, MappedSection, sections_of, uprights_of

WIDE, NARROW = 1.8, 0.4
THICK, THIN = 1.7, 0.55
LEAST_TO_COMPARE, LEAST_ALIKE = 4, 3
SURE = 0.1
"""A height is sure where its standard deviation is less than that share of it."""
ODD, ODD_M, ALIKE, MOSTLY = 0.2, 0.01, 0.1, 0.6
"""A beam is odd by so much of the usual height and so many metres, where most beams are alike: racks are built of few profiles."""
PLAUSIBLE_M = {
    "uprights {} wide": (0.025, 0.22),
    "beams {} high": (0.02, 0.28),
    "uprights {} apart": (0.4, 6.5),
}
"""What racks have, half of their elements at least: from light shelving to heavy racks for long goods. In feet, hardly any rack has all three."""


def odd_scale(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """Sizes that no rack has: what gives the scale is far off, whatever the pictures say. An error of all elements."""
    uprights, beams = uprights_of(structures), [section.beams for section in sections_of(structures)]
    sizes = (
        np.diff(uprights.intervals, axis=1),
        np.concatenate([np.zeros((0, 1)), *(np.diff(group.intervals, axis=1) for group in beams)]),
        np.diff(uprights.intervals.mean(axis=1)),
    )
    usual = [float(np.median(own)) if own.size else None for own in sizes]
    odd = [
        text.format(f"{size:.2f} m")
        for (text, (least, most)), size in zip(PLAUSIBLE_M.items(), usual, strict=True)
        if size is not None and not least < size < most
    ]
    if odd:
        action = "check that all references are in metres"
        what, details = "no rack has such sizes", tuple(odd[1:])
        yield Doubt("shape", what, uprights.ids[:1], figure=odd[0], action=action, details=details)


def odd_bays(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """Distances from upright to upright that differ much from the others: uprights may be missing, or one may be none. A narrow gap without beams
    between bays with beams is that of two racks that stand end to end."""
    uprights = uprights_of(structures)
    middles = np.array([section.extent.mean() for section in sections_of(structures)])
    filled = [bool(((middles > a) & (middles < b)).any()) for a, b in pairwise(uprights.intervals.mean(axis=1))]
    widths = np.diff(uprights.intervals.mean(axis=1))
    for number, (left, right) in enumerate(pairwise(uprights.ids)):
        others = np.delete(widths, number)
        if not len(others):
            continue
        usual, width = float(np.median(others)), float(widths[number])
        if width > WIDE * usual:
            figure, action = f"{width:.2f} m apart, others {usual:.2f} m", f"look for one between: {left} and {right}"
            yield Doubt("shape", "an upright may be missing", (left, right), figure=figure, action=action)
        between_racks = not filled[number] and filled[max(number - 1, 0)] and filled[min(number + 1, len(filled) - 1)]
        if width < NARROW * usual and not between_racks:
            figure = f"{width:.2f} m apart, others {usual:.2f} m"
            action = f"look whether both are uprights: {left} and {right}"
            yield Doubt("shape", "two uprights are close together", (left, right), figure=figure, action=action)


def odd_sizes(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """Uprights' widths and beams' heights that differ much from the others'."""
    sections, uprights = sections_of(structures), uprights_of(structures)
    alike = [section.beams for section in sections if not _is_of_another_rack(section, uprights.intervals)]
    heights = np.concatenate([np.zeros((0, 2)), *(group.intervals for group in alike)])
    yield from _odd_sizes([*uprights.ids], uprights.intervals, "wide")
    implausible = [*_odd_sizes([name for group in alike for name in group.ids], heights, "high")]
    yield from implausible
    told = {name for doubt in implausible for name in doubt.structures}
    beams = [section.beams for section in sections]
    yield from (odd for odd in _unlike_their_section(beams) if odd.structures[0] not in told)


def unmeasured_edges(structures: Sequence[Structure], told_by_profile: bool) -> Iterator[Doubt]:
    """Beams of which an edge was measured nowhere: those where the row's profile tells it, which most beams have, or all others."""
    for beam in structures:
        said, height, sigma = (beam.attributes.get(name) for name in (NOT_SEEN, "height_m", "height_sigma_m"))
        by_profile = isinstance(height, float) and isinstance(sigma, float) and sigma < SURE * height
        if said is None or (said != NEITHER and by_profile) != told_by_profile:
            continue
        if said == NEITHER:
            action = f"look whether it is a beam: {beam.id}"
            yield Doubt("shape", "a beam's edges are at no one place", (beam.id,), action=action)
        elif isinstance(height, float):
            figure, action = f"assumed {100 * height:.1f} cm high", f"look where it is: {said} of {beam.id}"
            yield Doubt("shape", "a beam's edge was not seen", (beam.id,), figure=figure, action=action)


def _is_of_another_rack(section: MappedSection, uprights: Floats) -> bool:
    """Whether most of a bay's beams and both its uprights (of n, 2) are of other profiles than the row's, each like one another: two makes of
    racks stand in one row."""
    widths, middles = np.diff(uprights, axis=1)[:, 0], uprights.mean(axis=1)
    beside = np.searchsorted(middles, section.extent.mean()) - np.array([1, 0])
    heights = np.diff(section.beams.intervals, axis=1)[:, 0]
    if len(heights) < LEAST_ALIKE or beside.min() < 0 or beside.max() >= len(widths):
        return False
    usual, own = float(np.median(widths)), widths[beside]
    like = np.ptp(own) < ODD * own.mean()
    uniform = np.mean(np.abs(heights - np.median(heights)) < ODD * np.median(heights)) > MOSTLY
    return bool(like and uniform and np.abs(own - usual).min() > ODD * usual)


def _odd_sizes(ids: Sequence[str], intervals: Floats, word: str) -> Iterator[Doubt]:
    sizes = np.diff(intervals, axis=1)[:, 0]
    if len(sizes) < LEAST_TO_COMPARE:
        return
    usual = float(np.median(sizes))
    for name, size in zip(ids, sizes.tolist(), strict=True):
        if not THIN * usual < size < THICK * usual:
            figure = f"{100 * size:.1f} cm {word}, others {100 * usual:.1f} cm"
            action = f"look whether it is right: {name}"
            yield Doubt("shape", "an element has an unusual size", (name,), figure=figure, action=action)


def _unlike_their_section(beams: Sequence[Elements]) -> Iterator[Doubt]:
    """Beams whose height is neither that of most of the row nor that of the others of their bay, in a row where most have one of these:
    goods, a label or a deck's rim was taken for one of their edges."""
    sizes = [np.diff(group.intervals, axis=1)[:, 0] for group in beams]
    if sum(map(len, sizes)) < LEAST_TO_COMPARE:
        return
    usual = float(np.median(np.concatenate(sizes)))
    beside = [_of_the_others(group, usual) for group in sizes]
    differences = [
        np.minimum(np.abs(own - usual), np.abs(own - other)) for own, other in zip(sizes, beside, strict=True)
    ]
    if np.mean(np.concatenate(differences) < ALIKE * usual) < MOSTLY:
        return
    for group, own, off in zip(beams, sizes, differences, strict=True):
        for name, size, difference in zip(group.ids, own.tolist(), off.tolist(), strict=True):
            if difference > max(ODD * usual, ODD_M):
                figure = f"{100 * size:.1f} cm high, others {100 * usual:.1f} cm"
                action = f"look whether an edge is something else's: {name}"
                yield Doubt("shape", "a beam has an unusual height", (name,), figure=figure, action=action)


def _of_the_others(sizes: Floats, usual: float) -> Floats:
    """For each beam of a bay (n,) the median of the others; the usual one of the row where there are fewer than two others."""
    if len(sizes) < 3:
        return np.full(len(sizes), usual)
    return np.array([float(np.median(np.delete(sizes, number))) for number in range(len(sizes))])
