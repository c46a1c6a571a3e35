"""What the model reads off the evidence of a face."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from painted_face import CELL, DISTANCE, LEVELS, PAINTED, POSTS, Band, PaintedFace

from savmap.types import Floats
from savmap.vision.evidence.intervals import best_intervals
from savmap_shelves.face_model import Face, FaceReader, Member, first_extent, measured_members
from savmap_shelves.likelihood import fitted
from savmap_shelves.paint import paint_ratios

UNSURE = 0.27
"""The mean score of a beam that may be one or not."""


def read(face: PaintedFace, floor: float | None = None) -> Face:
    evidence = face.evidence()
    found = FaceReader(evidence, evidence, DISTANCE, floor, fitted()).read()
    assert found is not None
    return found


def edges(members: tuple[Member, ...]) -> Floats:
    return np.array([[member.low, member.high] for member in members]).reshape(-1, 2)


def likely(face: Face, bay: int, level: Band) -> float:
    """How likely a beam's middle is within a level."""
    members = (*face.sections[bay], *face.possible[bay])
    return max((m.probability for m in members if level[0] < (m.low + m.high) / 2 < level[1]), default=0.0)


def without(*gone: tuple[int, int]) -> PaintedFace:
    """A face that lacks beams, by bay and level."""
    return PaintedFace(
        sections=tuple(
            tuple(level for number, level in enumerate(LEVELS) if (bay, number) not in gone) for bay in range(3)
        )
    )


def test_posts_and_beams_are_read_to_a_part_of_a_cell() -> None:
    face = read(PaintedFace())
    assert edges(face.posts) == pytest.approx(np.array(POSTS), abs=0.2 * CELL)
    for section in face.sections:
        assert edges(section) == pytest.approx(np.array(LEVELS), abs=0.2 * CELL)
    assert all(member.probability > 0.99 for members in (face.posts, *face.sections) for member in members)
    assert (face.bottom, face.top) == (pytest.approx(0.2, abs=2 * CELL), pytest.approx(4.0, abs=2 * CELL))
    assert not any(face.possible)


def test_nothing_is_read_where_nothing_is_seen() -> None:
    evidence = PaintedFace(posts=(), sections=()).evidence()
    assert FaceReader(evidence, evidence, DISTANCE, None, fitted()).read() is None
    unseen = replace(evidence, weight=0 * evidence.weight)
    assert FaceReader(unseen, unseen, DISTANCE, None, fitted()).read() is None


def test_a_beam_that_goods_hide_by_half_is_read() -> None:
    face = read(PaintedFace().draw("beam", (4.7, 6.0), LEVELS[1], 0.02))
    assert edges(face.sections[1])[1] == pytest.approx(np.array(LEVELS[1]), abs=0.3 * CELL)
    assert likely(face, 1, LEVELS[1]) > 0.99


def test_what_other_sections_have_makes_a_beam_likelier() -> None:
    faint = 0.24
    shared = read(without((1, 1)).draw("beam", (3.4, 6.0), LEVELS[1], faint))
    single = read(without((0, 1), (1, 1), (2, 1)).draw("beam", (3.4, 6.0), LEVELS[1], faint))
    assert likely(shared, 1, LEVELS[1]) > 10 * likely(single, 1, LEVELS[1])


def test_of_a_beam_that_hardly_shows_the_model_is_not_sure() -> None:
    found = [
        likely(read(without((1, 1)).draw("beam", (3.4, 6.0), LEVELS[1], score)), 1, LEVELS[1])
        for score in (0.02, UNSURE, 0.6)
    ]
    assert 0.01 < found[1] < 0.99 < found[2]
    assert found[0] < 0.1 * found[1]


def test_no_beam_lies_below_the_floor() -> None:
    assert [len(section) for section in read(PaintedFace(), floor=1.0).sections] == [2, 2, 2]


def test_paint_tells_a_faint_beam_from_what_is_coloured_otherwise() -> None:
    def face(colour: tuple[int, int, int]) -> PaintedFace:
        painted = without((1, 1)).draw("beam", (3.4, 6.0), LEVELS[1], 0.18, colour)
        for bay, (left, right) in enumerate(pairwise(POSTS)):
            for number, level in enumerate(LEVELS):
                if (bay, number) != (1, 1):
                    painted.draw("beam", (left[1], right[0]), level, 0.9, PAINTED)
        return painted

    assert likely(read(face(PAINTED)), 1, LEVELS[1]) > 0.99
    assert likely(read(face((40, 120, 60))), 1, LEVELS[1]) < 0.1


def test_paint_tells_a_faint_post_of_this_rack_from_one_of_a_rack_behind() -> None:
    def face(colour: tuple[int, int, int]) -> PaintedFace:
        painted = PaintedFace(posts=POSTS[:3], sections=(LEVELS,) * 2)
        painted.colours[:, 60:90] = (40, 120, 60)
        for post in POSTS[:3]:
            painted.draw("upright", post, (0.2, 4.0), 0.9, PAINTED)
        return painted.draw("upright", POSTS[3], (0.2, 4.0), 0.35, colour)

    assert len(read(face(PAINTED)).posts) == 4
    assert len(read(face((40, 120, 60))).posts) == 3


def test_the_colours_of_the_others_members_tell() -> None:
    picture = np.full((3, 40, 3), 120, np.uint8)
    picture[:, 10:15] = picture[:, 30:35] = PAINTED
    groups = [np.arange(40) // 20 == number for number in range(2)]
    groups = [np.tile(group, (3, 1)) for group in groups]
    red = (picture == PAINTED).all(axis=-1)
    ratios = paint_ratios(picture, [red & group for group in groups], groups, 3.0)
    assert ratios[0][red] == pytest.approx(3.0)
    assert ratios[0][~red] == pytest.approx(-3.0)
    first, second = paint_ratios(picture, [red & groups[0], np.zeros_like(red)], groups, 3.0)
    assert not first.any(), "its own members do not speak for a group"
    assert second[red] == pytest.approx(3.0)


def test_a_border_that_something_adjoins_is_where_a_usual_member_ends() -> None:
    """Rows of scores across three members 6.4 cells wide; of one, half of the length shows another 4 cells above."""
    rows = np.arange(60)[:, None] + 0.5
    lines = np.zeros((60, 12))
    for middle in (10.3, 30.3, 50.3):
        lines += np.clip(3.2 + 0.5 - np.abs(rows - middle), 0, 1)
    lines[33:37] = 1.0
    scores = np.full((60, 9), -50.0)
    scores[[7, 27, 47], [4, 8, 4]] = 9.0
    found = best_intervals([scores], np.arange(2, 11), 3)
    (members,) = measured_members(found, [lines], [lines - 0.5], 6.4)
    assert members[0] == pytest.approx([7.1, 13.5], abs=0.2)
    assert members[2] == pytest.approx([47.1, 53.5], abs=0.2)
    assert np.diff(members[1]) == pytest.approx(6.4, abs=0.1)
    assert 27.1 - 0.2 < members[1][0] < 31.0


def test_what_adjoins_a_border_is_told_from_it_by_its_cells_ratios() -> None:
    """A shadow under a beam, of which the network thinks as much as of the beam; the paint says that it is none."""
    lines = np.full((60, 12), 0.02)
    for low, high in ((10, 14), (30, 34), (48, 54)):
        lines[low:high] = 0.7
    ratios = np.where(lines > 0.5, 2.0, -3.0)
    ratios[48:50] = -1.0
    scores = np.full((60, 9), -50.0)
    scores[[10, 30, 48], [2, 2, 4]] = 9.0
    found = best_intervals([scores], np.arange(2, 11), 3)
    (members,) = measured_members(found, [lines], [ratios], None)
    assert members[2] == pytest.approx([50, 54], abs=0.3)


def test_posts_that_fill_a_small_part_of_a_high_view_are_read() -> None:
    """A near face is looked at from 80 degrees below to 80 above: posts are a seventh of what is seen there."""
    ratios = np.full((700, 40), -4.0)
    ratios[90:190, [5, 6, 20, 21, 34, 35]] = 3.0
    assert first_extent(ratios) == (90, 190)
    assert first_extent(np.full((700, 40), -4.0)) == (0, 700)
