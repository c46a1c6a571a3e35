"""Levels that one bay alone has or lacks, and steps from beam to beam that may hide one."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from savmap.types import Doubt, Structure
from savmap_shelves.evidence.wide_steps import wide_steps
from savmap_shelves.mapping import MappedSection, sections_of

LEAST_TO_COMPARE = 4
REGULAR = 0.8
LEVEL_M = 0.06
ROOM_STEPS = 1.1
"""A highest beam lower than the others' by so many steps of its bay leaves room for one above it. No bay of 126 simulated rows does."""
HIGHER_M, PASSAGE_M, LEAST_SECTIONS, LEAST_LEVELS = 0.5, 2.0, 3, 3
"""A lowest beam so much above those of most bays, of so many at least, may hide one below it; not one that leaves room to pass."""


def odd_levels(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """In a rack whose bays have the same levels: one that has one more, or lacks one that both its neighbours have; in any other, steps from
    level to level that are too wide for their bay, and room for one more below the highest ones of the others."""
    sections = sections_of(structures)
    if len(sections) < LEAST_TO_COMPARE or _regularity(sections) < REGULAR:
        yield from _steps(sections)
        yield from _low_highest(sections)
        return
    for number, section in enumerate(sections):
        beside = [sections[k] for k in (number - 1, number + 1) if 0 <= k < len(sections)]
        for name, level in zip(section.beams.ids, _heights(section), strict=True):
            if not any(_has(other, level) for other in beside):
                what, figure = "no bay beside has such a beam", f"{level:.2f} m"
                yield Doubt("shape", what, (name,), figure=figure, action=f"look whether it is a beam: {name}")
        for level in _heights(beside[0]):
            if all(_has(other, level) for other in beside) and not _has(section, level):
                what, figure = "a beam is missing that bays beside have", f"{level:.2f} m"
                action = f"look whether it is missing: in the bay of {section.beams.ids[0]}"
                yield Doubt("shape", what, section.beams.ids[:1], figure=figure, action=action)


def adjoining_beams(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """Beams with less room between them than a beam is high: what stands on one, or hangs from it, was taken for another."""
    for section in sections_of(structures):
        intervals, ids = section.beams.intervals, section.beams.ids
        for lower in range(len(ids) - 1):
            room = float(intervals[lower + 1, 0] - intervals[lower, 1])
            if room < float(np.ptp(intervals, axis=1).min()):
                pair = ids[lower], ids[lower + 1]
                what, figure = "two beams adjoin", f"{100 * room:.1f} cm between them"
                action = f"look whether both are beams: {pair[0]} and {pair[1]}"
                yield Doubt("shape", what, pair, figure=figure, action=action)


def high_lowest_beams(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """Bays whose lowest beam is far above those of the others, and is no lintel of a passage: what stands before a bay in all frames hides a
    beam, and leaves no step to see that by."""
    sections = [section for section in sections_of(structures) if len(section.beams.ids)]
    lowest = np.array([section.beams.intervals[0, 0] for section in sections])
    for number, section in enumerate(sections if len(sections) >= LEAST_SECTIONS else ()):
        usual = float(np.median(np.delete(lowest, number)))
        if usual + HIGHER_M < lowest[number] < PASSAGE_M:
            name = section.beams.ids[0]
            figure = f"{lowest[number]:.2f} m above the floor, others {usual:.2f} m"
            action = f"look below it; if there is none, give the lowest beams' heights: {name}"
            yield Doubt("shape", "a lowest beam may be hidden", (name,), figure=figure, action=action)


def _steps(sections: Sequence[MappedSection]) -> Iterator[Doubt]:
    for section, lower, usual in wide_steps([np.array(_heights(one)) for one in sections]):
        heights, ids = _heights(sections[section]), sections[section].beams.ids
        pair = ids[lower], ids[lower + 1]
        figure = f"{heights[lower + 1] - heights[lower]:.2f} m apart, others {usual:.2f} m"
        action = f"look for one between: {pair[0]} and {pair[1]}"
        yield Doubt("shape", "a beam may be missing between others", pair, figure=figure, action=action)


def _low_highest(sections: Sequence[MappedSection]) -> Iterator[Doubt]:
    """Bays with room for one more beam below the height of the others' highest ones, which are within a step: goods may hang over it."""
    sections = [section for section in sections if len(section.beams.ids)]
    highest = np.array([_heights(section)[-1] for section in sections])
    for number, section in enumerate(sections if len(sections) >= LEAST_SECTIONS else ()):
        heights, others = _heights(section), np.delete(highest, number)
        step = float(np.median(np.diff(heights))) if len(heights) >= LEAST_LEVELS else np.inf
        usual = float(np.median(others))
        if np.ptp(others) < step and usual - heights[-1] > ROOM_STEPS * step:
            name = section.beams.ids[-1]
            figure, action = f"{heights[-1]:.2f} m, others {usual:.2f} m", f"look for one above: {name}"
            yield Doubt("shape", "a highest beam may be missing", (name,), figure=figure, action=action)


def _regularity(sections: Sequence[MappedSection]) -> float:
    """The share of levels that the next bay has too."""
    shared = [_has(b, level) for a, b in pairwise(sections) for level in _heights(a)]
    shared += [_has(a, level) for a, b in pairwise(sections) for level in _heights(b)]
    return float(np.mean(shared)) if shared else 0.0


def _heights(section: MappedSection) -> list[float]:
    return [float(height) for height in section.beams.intervals.mean(axis=1)]


def _has(section: MappedSection, level: float) -> bool:
    return any(abs(height - level) < LEVEL_M for height in _heights(section))
