"""Uprights and beams in the evidence of all frames: columns of the face are searched for posts, rows between posts for levels.

This is the published density estimate (paper, III.D), over every pixel of every frame instead of over edges of single frames. The evidence
of the tracked posts and levels sets the scale.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from savmap.types import Floats, PlaneEvidence
from savmap_shelves.evidence.face_grid import Grid
from savmap_shelves.evidence.search.covers import greatest
from savmap_shelves.evidence.search.face import Face
from savmap_shelves.evidence.search.overhead import overhead_levels, without_overhead
from savmap_shelves.evidence.search.posts import expected_posts
from savmap_shelves.evidence.search.section import Section
from savmap_shelves.evidence.search.settings import EvidenceSettings
from savmap_shelves.evidence.wide_steps import EVEN, wide_steps

VISIBLE = 0.25
"""The least cover of a level that goods do not hide for the most part."""


def expected_grid(
    evidence: PlaneEvidence, grid: Grid, settings: EvidenceSettings | None = None, floor: float | None = None
) -> Grid | None:
    """The grid by the evidence. None where it is the tracked one, or has no level. `floor`: the y of the floor; None where the pictures do not tell it."""
    expected = searched(Face(evidence, grid, settings or EvidenceSettings(), floor))
    if not any(len(levels) for levels in expected.sections):
        return None
    same_posts = len(expected.posts) == len(grid.posts) and np.allclose(expected.posts, grid.posts)
    is_same = same_posts and all(
        len(a) == len(b) and np.allclose(a, b) for a, b in zip(expected.sections, grid.sections, strict=True)
    )
    return None if is_same else expected


def searched(face: Face) -> Grid:
    """The grid by a face's evidence."""
    posts = expected_posts(face)
    sections = [Section(face, pair) for pair in pairwise(posts)]
    found = Grid(posts, [section.expected_levels() for section in sections])
    overhead = overhead_levels(face.evidence, found, face.usual_level, face.usual_post, face.tracked)
    return _with_pieces(sections, _with_lacking(sections, without_overhead(found, overhead)))


def _with_lacking(sections: Sequence[Section], grid: Grid) -> Grid:
    """The grid, with the levels that the network sees faintly, or in part, where a step between visible levels is too wide."""
    levels = [*grid.sections]
    for number, below, above, room in _wide_steps(sections, grid):
        level = sections[number].level_between(below, above, room, sections[number].settings.partly)
        if level is not None:
            levels[number] = _with_level(levels[number], level)
    return Grid(grid.posts, levels)


def _with_pieces(sections: Sequence[Section], grid: Grid) -> Grid:
    """The grid, with a level in each step between visible levels that is too wide: one of which goods leave only a few pieces visible, by its colours, or
    else one of which the network sees little."""
    levels, in_pieces = [*grid.sections], list[tuple[int, Floats]]()
    for number, below, above, room in _wide_steps(sections, grid):
        section = sections[number]
        level = section.face.pieces.level_between(grid.spans[number], below, above, room)
        visible = _visible(section, grid.sections[number])
        if level is None or section.face.rear.may_show(visible, float(level.mean())):
            faint = section.level_between(below, above, room, section.settings.between)
            levels[number] = levels[number] if faint is None else _with_level(levels[number], faint)
            continue
        near = np.abs(levels[number].mean(axis=1) - level.mean()) < section.face.tracked.thickness
        level = levels[number][near][0] if near.any() else level
        if not near.any():
            levels[number] = _with_level(levels[number], level)
        in_pieces.append((number, level))
    pieces = frozenset((k, int(np.abs(levels[k][:, 0] - level[0]).argmin())) for k, level in in_pieces)
    return Grid(grid.posts, levels, pieces)


def _with_level(levels: Floats, level: Floats) -> Floats:
    """Levels (m, 2) and one more (2,), from the bottom."""
    return np.sort(np.concatenate([levels, level[None]]), axis=0)


def _wide_steps(sections: Sequence[Section], grid: Grid) -> Iterator[tuple[int, Floats, Floats, float]]:
    """Steps between visible levels that are too wide: the bay's number, the levels (2,) below and above, and the room that another level
    needs beside them."""
    visible = [_visible(section, levels) for section, levels in zip(sections, grid.sections, strict=True)]
    for number, lower, usual in wide_steps([levels.mean(axis=1) for levels in visible]):
        yield number, visible[number][lower], visible[number][lower + 1], usual / EVEN


def _visible(section: Section, levels: Floats) -> Floats:
    """Those levels (m, 2) of a bay that have a cover of `VISIBLE` or more."""
    return np.asarray(levels[greatest(section.cover, section.face.y, levels) >= VISIBLE])
