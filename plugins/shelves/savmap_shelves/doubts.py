"""What of a mapped rack is implausible: elements out of proportion to their likes, levels that one section alone has or lacks, and a size that
no rack has."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from savmap.types import Doubt, Floats, Structure
from savmap_shelves.mapping import Elements, MappedSection, sections_of, uprights_of

WIDE, NARROW = 1.8, 0.4
THICK, THIN = 1.7, 0.55
LEAST_TO_COMPARE = 4
ODD, ODD_M, ALIKE, MOSTLY = 0.2, 0.01, 0.1, 0.6
"""A beam is odd by so much of the usual height and so many metres, where most beams are alike: racks are built of few profiles."""
REGULAR = 0.8
LEVEL_M = 0.06
FAR, LEAST_STEPS, EVEN, AMID = 1.6, 3, 1.5, 0.15
"""A step from beam to beam may hide one where it is so many times the usual of at least so many others of its section, the greatest of which is at most
`EVEN` times the least, and the sections beside have beams in it, not within this share of it at its ends: 60 simulated rows have no such step."""
PLAUSIBLE_M = {
    "uprights are {} wide": (0.025, 0.22),
    "beams are {} high": (0.02, 0.28),
    "uprights stand {} apart": (0.4, 6.5),
}
"""What racks have, half of their elements at least: from light shelving to heavy racks for long goods. In feet, hardly any rack has all three."""


def doubts_of(structures: Sequence[Structure]) -> list[Doubt]:
    """Doubts of kind `shape`, each with the ids of the elements that it is about."""
    by_id = {structure.id: structure for structure in structures}
    found = [*_scale(structures), *_bays(structures), *_sizes(structures), *_levels(structures)]
    return [Doubt("shape", what, ids, _place([by_id[name] for name in ids])) for what, ids in found]


def _place(structures: Sequence[Structure]) -> tuple[float, float, float]:
    x, y, z = np.mean([structure.vertices.mean(axis=0) for structure in structures], axis=0).tolist()
    return x, y, z


def _scale(structures: Sequence[Structure]) -> Iterator[tuple[str, tuple[str, ...]]]:
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
        yield f"{' and '.join(odd)}: are the references in another unit than metres?", uprights.ids[:1]


def _bays(structures: Sequence[Structure]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Distances from upright to upright that differ much from the others: uprights may be missing, or one may be none."""
    uprights = uprights_of(structures)
    widths = np.diff(uprights.intervals.mean(axis=1))
    for number, (left, right) in enumerate(pairwise(uprights.ids)):
        others = np.delete(widths, number)
        if not len(others):
            continue
        usual, width = float(np.median(others)), float(widths[number])
        if width > WIDE * usual:
            yield (
                f"{left} and {right} are {width:.2f} m apart, others {usual:.2f} m: is one between them missing?",
                (left, right),
            )
        if width < NARROW * usual:
            yield (
                f"{left} and {right} are {width:.2f} m apart, others {usual:.2f} m: is one of them none?",
                (left, right),
            )


def _sizes(structures: Sequence[Structure]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Uprights' widths and beams' heights that differ much from the others'."""
    beams = [section.beams for section in sections_of(structures)]
    uprights = uprights_of(structures)
    heights = np.concatenate([np.zeros((0, 2)), *(group.intervals for group in beams)])
    yield from _odd_sizes([*uprights.ids], uprights.intervals, "wide")
    implausible = [*_odd_sizes([name for group in beams for name in group.ids], heights, "high")]
    yield from implausible
    told = {name for _, ids in implausible for name in ids}
    yield from (odd for odd in _unlike_their_section(beams) if odd[1][0] not in told)


def _odd_sizes(ids: Sequence[str], intervals: Floats, word: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    sizes = np.diff(intervals, axis=1)[:, 0]
    if len(sizes) < LEAST_TO_COMPARE:
        return
    usual = float(np.median(sizes))
    for name, size in zip(ids, sizes.tolist(), strict=True):
        if not THIN * usual < size < THICK * usual:
            yield (
                f"{name} is {100 * size:.1f} cm {word}, others {100 * usual:.1f} cm: something else may be taken for it",
                (name,),
            )


def _unlike_their_section(beams: Sequence[Elements]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Beams whose height is neither that of most of the row nor that of the others of their section, in a row where most have one of these:
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
                height = f"{name} is {100 * size:.1f} cm high, most others {100 * usual:.1f} cm"
                yield f"{height}: one of its edges may be something else's", (name,)


def _of_the_others(sizes: Floats, usual: float) -> Floats:
    """For each beam of a section (n,) the median of the others; the usual one of the row where there are fewer than two others."""
    if len(sizes) < 3:
        return np.full(len(sizes), usual)
    return np.array([float(np.median(np.delete(sizes, number))) for number in range(len(sizes))])


def _levels(structures: Sequence[Structure]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """In a rack whose sections have the same levels: one that has one more, or lacks one that both its neighbours have; in any other, steps from
    level to level that are too wide for their section."""
    sections = sections_of(structures)
    if len(sections) < LEAST_TO_COMPARE or _regularity(sections) < REGULAR:
        yield from _steps(sections)
        return
    for number, section in enumerate(sections):
        beside = [sections[k] for k in (number - 1, number + 1) if 0 <= k < len(sections)]
        for name, level in zip(section.beams.ids, _heights(section), strict=True):
            if not any(_has(other, level) for other in beside):
                yield f"{name} is at {level:.2f} m, where no section beside it has a beam: is it one?", (name,)
        for level in _heights(beside[0]):
            if all(_has(other, level) for other in beside) and not _has(section, level):
                yield (
                    f"the sections beside have a beam at {level:.2f} m that is missing beside {section.beams.ids[0]}",
                    section.beams.ids[:1],
                )


def _steps(sections: Sequence[MappedSection]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Two beams of a section far further apart than its others, where the sections beside go on: one that stands in the shade behind goods may
    show in no frame. A passage or a pallet's place goes through the sections beside, too, or is in one of several."""
    for number, section in enumerate(sections):
        levels = np.array(_heights(section))
        steps = np.diff(levels)
        beside = [np.array(_heights(sections[k])) for k in (number - 1, number + 1) if 0 <= k < len(sections)]
        for k, step in enumerate(steps.tolist()):
            others = np.delete(steps, k)
            if len(others) < LEAST_STEPS or others.max() > EVEN * others.min() or not beside:
                continue
            if step <= FAR * float(np.median(others)):
                continue
            low, high = levels[k] + AMID * step, levels[k + 1] - AMID * step
            if all(((other > low) & (other < high)).any() for other in beside):
                pair = section.beams.ids[k], section.beams.ids[k + 1]
                usual = f"{step:.2f} m apart, others of their section {float(np.median(others)):.2f} m"
                yield f"{pair[0]} and {pair[1]} are {usual}: is one between them missing?", pair


def _regularity(sections: Sequence[MappedSection]) -> float:
    """The share of levels that the next section has too."""
    shared = [_has(b, level) for a, b in pairwise(sections) for level in _heights(a)]
    shared += [_has(a, level) for a, b in pairwise(sections) for level in _heights(b)]
    return float(np.mean(shared)) if shared else 0.0


def _heights(section: MappedSection) -> list[float]:
    return [float(height) for height in section.beams.intervals.mean(axis=1)]


def _has(section: MappedSection, level: float) -> bool:
    return any(abs(height - level) < LEVEL_M for height in _heights(section))
