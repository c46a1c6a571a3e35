"""Posts and levels in the evidence of a face: what is found beside what was tracked, what is dropped, and what is left alone."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from savmap_shelves.evidence.search import EvidenceSettings
from savmap_shelves.evidence.search.face import Face
from savmap_shelves.evidence.search.grid import searched
from savmap_shelves.evidence.search.paint import Paint
from savmap_shelves.evidence.search.pieces import Pieces
from savmap_shelves.evidence.search.section import Section
from seen_faces import LEVELS, POSTS, WHOLE, is_whole, seen

from savmap.types import Floats, PlaneEvidence
from savmap_shelves.evidence import Grid, absent_beams, expected_grid, face_patch, outlines, tracked_grid
from savmap_shelves.plugin import Shelves
from savmap_shelves.settings import ShelvesSettings


def test_a_grid_that_makes_no_sense_has_no_patch() -> None:
    assert face_patch(Grid(1000 * WHOLE.posts, [1000 * levels for levels in WHOLE.sections])) is not None
    thin = [np.array([[0.3, 0.3001], [90.0, 90.0001]]) for _ in WHOLE.sections]
    assert face_patch(Grid(WHOLE.posts, thin)) is None
    assert face_patch(Grid(np.nan * WHOLE.posts, WHOLE.sections)) is None
    assert face_patch(Grid(WHOLE.posts, [0 * levels for levels in WHOLE.sections])) is None


def test_evidence_of_what_was_tracked_changes_nothing() -> None:
    assert expected_grid(seen(), WHOLE) is None


def test_a_level_that_is_faint_all_along_is_found() -> None:
    evidence = seen((1, (2.8, 5.4), (1.9, 2.02), 0.25))
    tracked = Grid(POSTS, [LEVELS, LEVELS[[0, 2]], LEVELS])
    assert is_whole(expected_grid(evidence, tracked))


def test_a_strong_thing_that_is_short_is_no_level() -> None:
    assert expected_grid(seen((1, (3.0, 4.2), (2.6, 2.72), 0.95)), WHOLE) is None


def test_a_level_that_is_thin_and_faint_all_along_is_of_another_rack() -> None:
    """Through an open bay a rack behind is seen, whose beams are farther away."""
    evidence = seen((1, (2.8, 5.4), (2.6, 2.67), 0.4))
    tracked = Grid(POSTS, [LEVELS, np.concatenate([LEVELS, [[2.6, 2.67]]]), LEVELS])
    assert [len(levels) for levels in searched(Face(evidence, tracked, EvidenceSettings())).sections] == [3, 3, 3]


def test_a_lowest_level_that_is_thin_and_faint_stands_in_the_shade() -> None:
    evidence = seen((1, (2.8, 5.4), (0.4, 0.52), 0.4))
    tracked = Grid(POSTS, [LEVELS, np.concatenate([[[0.42, 0.49]], LEVELS[1:]]), LEVELS])
    assert expected_grid(evidence, tracked) is None


@pytest.mark.parametrize("height", [-0.15, 4.3])
def test_what_lies_below_or_above_the_posts_is_no_level(height: float) -> None:
    assert expected_grid(seen((1, (0.1, 8.1), (height, height + 0.12), 0.9)), WHOLE) is None


@pytest.mark.parametrize(("value", "length", "found"), [(0.25, 2.15, False), (0.5, 2.15, True), (0.25, 2.5, True)])
def test_a_faint_stripe_that_is_not_whole_is_no_level_where_paint_does_not_tell(
    value: float, length: float, found: bool
) -> None:
    evidence = seen((1, (2.9, 2.9 + length), (2.6, 2.72), value))
    assert (expected_grid(evidence, WHOLE) is not None) == found


@pytest.mark.parametrize(
    ("length", "others", "found"), [(1.2, LEVELS, True), (0.8, LEVELS, False), (1.2, LEVELS[1:], False)]
)
def test_more_than_a_third_of_a_sections_lowest_level_is_enough_where_the_others_have_theirs(
    length: float, others: Floats, found: bool
) -> None:
    evidence = seen((1, (2.8, 5.4), (0.39, 0.53), 0.0), (1, (2.8, 2.8 + length), (0.4, 0.52), 0.3))
    expected = expected_grid(evidence, Grid(POSTS, [others, LEVELS[1:], others]))
    assert (expected is not None and len(expected.sections[1]) == len(LEVELS)) == found


@pytest.mark.parametrize(
    ("length", "others", "found"), [(1.2, LEVELS, True), (0.8, LEVELS, False), (1.2, LEVELS[:-1], False)]
)
def test_so_it_is_with_its_highest_level(length: float, others: Floats, found: bool) -> None:
    top = LEVELS[-1]
    evidence = seen((1, (2.8, 5.4), (top[0] - 0.01, top[1] + 0.01), 0.0), (1, (2.8, 2.8 + length), tuple(top), 0.3))
    expected = expected_grid(evidence, Grid(POSTS, [others, LEVELS[:-1], others]))
    assert (expected is not None and len(expected.sections[1]) == len(LEVELS)) == found


def test_a_section_lacks_one_lowest_level_not_two() -> None:
    """What lies right below a lowest beam that shows in part is no other one."""
    parts = (1, (2.8, 5.4), (0.0, 0.53), 0.0), (1, (2.8, 4.0), (0.4, 0.52), 0.3), (1, (2.8, 3.9), (0.12, 0.24), 0.3)
    assert is_whole(expected_grid(seen(*parts), Grid(POSTS, [LEVELS, LEVELS[1:], LEVELS])))


def test_a_post_that_was_not_tracked_is_found() -> None:
    tracked = Grid(POSTS[[0, 2, 3]], [LEVELS, LEVELS])
    assert is_whole(expected_grid(seen(), tracked))


def test_less_of_a_post_is_enough_in_a_bay_too_wide() -> None:
    half_hidden = seen((0, (2.65, 2.85), (0.0, 2.0), 0.0))
    tracked = Grid(POSTS[[0, 2, 3]], [LEVELS, LEVELS])
    assert is_whole(expected_grid(half_hidden, tracked))


def test_half_a_post_in_a_bay_of_usual_width_is_none() -> None:
    assert expected_grid(seen((0, (4.0, 4.1), (0.4, 2.0), 0.9)), WHOLE) is None


def test_posts_at_the_ends_are_found_where_levels_go_on() -> None:
    assert is_whole(expected_grid(seen(), Grid(POSTS[1:3], [LEVELS])))


def test_a_post_beyond_the_end_without_levels_is_not_this_row() -> None:
    evidence = seen((1, (5.5, 8.1), (-1.0, 6.0), 0.0))
    assert expected_grid(evidence, Grid(POSTS[:3], [LEVELS, LEVELS])) is None


def test_what_was_tracked_without_any_evidence_is_dropped() -> None:
    made_up = np.sort(np.concatenate([LEVELS, [[2.7, 2.82]]]), axis=0)
    assert is_whole(expected_grid(seen(), Grid(POSTS, [LEVELS, made_up, LEVELS])))


def test_a_beam_that_goods_hide_in_part_is_not_two() -> None:
    """One half of a beam shows, and a little higher the edge of what hides the other half; or both all along, as two beams would."""
    halves = (1, (2.8, 5.4), (1.9, 2.02), 0.0), (1, (2.8, 4.2), (1.9, 2.02), 0.9), (1, (4.2, 5.4), (2.14, 2.26), 0.7)
    double = Grid(POSTS, [LEVELS, np.sort(np.vstack([LEVELS, [2.14, 2.26]]), axis=0), LEVELS])
    assert is_whole(expected_grid(seen(*halves), double))
    assert expected_grid(seen((1, (2.8, 5.4), (2.14, 2.26), 0.7)), double) is None


def test_what_adjoins_a_beam_does_not_borrow_its_length() -> None:
    """What stands on a beam shows in part only, though the beam right below it shows all along."""
    adjoining = Grid(POSTS, [LEVELS, np.sort(np.vstack([LEVELS, [2.03, 2.15]]), axis=0), LEVELS])
    assert is_whole(expected_grid(seen((1, (2.8, 3.8), (2.02, 2.15), 0.6)), adjoining))


def points_of(grid: Grid) -> dict[str, Floats]:
    """First positions of a grid's landmarks, under the names that tracks have."""
    posts = {
        f"upright {number} / {side} / {end}": np.array([x, y, 0.0])
        for number, post in enumerate(grid.posts, 1)
        for side, x in zip(("left", "right"), post, strict=True)
        for end, y in (("top", 4.0), ("bottom", 0.0))
    }
    beams = {
        f"bay {section} / beam {beam} / {edge} {side}": np.array([grid.posts[section - 1, 1], y, 0.0])
        for section, levels in enumerate(grid.sections, 1)
        for beam, level in enumerate(levels, 1)
        for edge, y in zip(("lower", "upper"), level, strict=True)
        for side in ("left", "right")
    }
    return posts | beams


def test_the_tracked_grid_is_read_off_its_landmarks() -> None:
    grid = tracked_grid(points_of(WHOLE))
    assert grid is not None
    assert grid.posts == pytest.approx(POSTS)
    assert [levels.tolist() for levels in grid.sections] == [LEVELS.tolist()] * 3


def test_a_level_whose_edges_are_crossed_keeps_its_place() -> None:
    points = points_of(WHOLE)
    for side in ("left", "right"):
        points[f"bay 1 / beam 2 / lower {side}"][1] = 1.97
        points[f"bay 1 / beam 2 / upper {side}"][1] = 1.95
    grid = tracked_grid(points)
    assert grid is not None
    assert grid.sections[0][1] == pytest.approx([1.93, 1.99])
    assert is_whole(Grid(grid.posts, grid.sections))
    assert expected_grid(seen(), grid) is None


def test_an_edge_that_was_not_tracked_is_as_far_from_the_other_as_usual() -> None:
    points = points_of(WHOLE)
    for side in ("left", "right"):
        del points[f"bay 1 / beam 2 / upper {side}"], points[f"bay 3 / beam 1 / lower {side}"]
    grid = tracked_grid(points)
    assert grid is not None
    assert is_whole(grid)
    only_lower = {name: place for name, place in points_of(WHOLE).items() if "upper" not in name}
    assert tracked_grid(only_lower) is None


def test_no_grid_is_read_where_no_section_was_tracked() -> None:
    assert tracked_grid({"upright 1 / left / top": np.zeros(3)}) is None


def test_every_object_has_an_outline() -> None:
    objects = outlines(WHOLE)
    assert [thing.label for thing in objects] == ["upright"] * 4 + ["beam"] * 9
    assert np.ptp(objects[4].outline, axis=0) == pytest.approx([2.6, 0.12, 0.0])


RED, GREY, WOOD, DARK = (200, 40, 30), (120, 125, 120), (190, 150, 100), (30, 8, 6)


def painted(evidence: PlaneEvidence, *stripes: tuple[tuple[float, float], tuple[int, int, int]]) -> PlaneEvidence:
    """The same evidence with a picture: red beams before goods of many colours, and stripes (y, colour) along the whole face."""
    patch, rng = evidence.patch, np.random.default_rng(0)
    picture = rng.integers(60, 200, (*patch.shape, 3)).astype(np.uint8)
    y = patch.origin[1] + patch.heights
    for (low, high), colour in (*((tuple(level), RED) for level in LEVELS.tolist()), *stripes):
        picture[(y > low) & (y < high)] = colour
    return replace(evidence, picture=picture)


def covered(
    evidence: PlaneEvidence, height: tuple[float, float], colour: tuple[int, int, int], *spans: tuple[float, float]
) -> PlaneEvidence:
    """The same evidence with a colour between two heights, along spans of the face."""
    picture, patch = evidence.picture.copy(), evidence.patch
    x, y = patch.origin[0] + patch.across, patch.origin[1] + patch.heights
    for low, high in spans:
        picture[np.ix_((y > height[0]) & (y < height[1]), (x > low) & (x < high))] = colour
    return replace(evidence, picture=picture)


def test_paint_tells_beams_from_what_is_painted_otherwise() -> None:
    paint = Paint(painted(seen(), ((2.6, 2.72), GREY)), WHOLE)
    assert paint.is_informative
    assert paint.similarity(0.1, 2.7, 1.96) == pytest.approx(1.0, abs=0.1)
    assert paint.similarity(0.1, 2.7, 2.66) < 0.2


def test_paint_tells_nothing_where_goods_are_painted_like_beams() -> None:
    assert not Paint(painted(seen(), ((-1.0, 5.0), RED)), WHOLE).is_informative


def test_a_storey_does_not_vouch_for_its_own_paint() -> None:
    made_up = np.concatenate([[[1.1, 1.22]], LEVELS])
    tracked = Grid(POSTS, [np.sort(made_up, axis=0)] * 3)
    evidence = painted(seen(), ((1.1, 1.22), GREY))
    assert Paint(evidence, tracked).similarity(0.1, 2.7, 1.16) < 0.2
    assert is_whole(expected_grid(seen_as(evidence, (1.1, 1.22), 0.7), tracked))


def seen_as(evidence: PlaneEvidence, height: tuple[float, float], value: float) -> PlaneEvidence:
    """The same with evidence of a beam along the whole face."""
    y, mean = evidence.patch.origin[1] + evidence.patch.heights, evidence.mean.copy()
    x = evidence.patch.origin[0] + evidence.patch.across
    mean[1][np.ix_((y > height[0]) & (y < height[1]), (x > POSTS[0, 1]) & (x < POSTS[-1, 0]))] = value
    return replace(evidence, mean=mean)


def test_half_a_level_painted_like_the_others_is_found() -> None:
    half = [(1, (left + 1.2, left + 2.8), (1.9, 2.02), 0.0) for left in (0.0, 2.7, 5.4)]
    tracked = Grid(POSTS, [LEVELS[[0, 2]]] * 3)
    assert is_whole(expected_grid(painted(seen(*half)), tracked))
    assert expected_grid(painted(seen(*half), ((1.9, 2.02), WOOD)), tracked) is None


def test_a_tracked_level_is_judged_by_the_paint_of_what_shows_of_it() -> None:
    """Goods hide most of each bay's level, in the evidence and in the picture."""
    hidden = [(left, left + 1.5) for left in (0.1, 2.8, 5.5)]
    evidence = painted(seen(*[(1, span, (1.9, 2.02), 0.0) for span in hidden]))
    evidence = covered(evidence, (1.9, 2.02), WOOD, *hidden)
    paint, x = Paint(evidence, WHOLE), evidence.patch.origin[0] + evidence.patch.across
    assert paint.similarity(0.1, 2.7, 1.96) < 0.6
    assert paint.similarity(0.1, 2.7, 1.96, (x > 1.7).astype(float)) > 0.9
    assert expected_grid(evidence, WHOLE) is None


def test_beams_that_are_none_are_absent() -> None:
    made_up = np.concatenate([[[1.1, 1.22]], LEVELS])
    tracked = Grid(POSTS, [np.sort(made_up, axis=0), LEVELS, LEVELS])
    (absent,) = absent_beams(tracked, WHOLE)
    assert absent.absent
    assert absent.outline[:, 1].tolist() == [1.1, 1.1, 1.22, 1.22]
    assert absent_beams(tracked, Grid(POSTS[:3], [LEVELS] * 2)) == []


@pytest.mark.parametrize(("colour", "believed"), [(RED, True), (GREY, False)])
def test_a_level_below_guarded_feet_is_told_by_paint(colour: tuple[int, int, int], believed: bool) -> None:
    tracked = Grid(POSTS, [LEVELS[1:]] * 3)
    evidence = seen(*[(0, tuple(post), (-1.0, 0.9), 0.0) for post in POSTS.tolist()])
    found = expected_grid(painted(evidence, ((0.4, 0.52), colour)), tracked)
    assert is_whole(found) if believed else found is None


@pytest.mark.parametrize(("others", "believed"), [(LEVELS, True), (LEVELS[1:], False)])
def test_a_level_below_guarded_feet_is_believed_where_the_other_sections_have_theirs(
    others: Floats, believed: bool
) -> None:
    hidden = [(0, tuple(post), (-1.0, 0.9), 0.0) for post in POSTS.tolist()]
    found = expected_grid(seen(*hidden), Grid(POSTS, [others, LEVELS[1:], others]))
    assert is_whole(found) if believed else found is None


@pytest.mark.parametrize(("floor", "believed"), [(0.0, True), (0.5, False), (None, False)])
def test_lowest_levels_that_guarded_feet_put_below_the_floor_are_found_above_the_measured_one(
    floor: float | None, believed: bool
) -> None:
    """No bay has its lowest level: each one that shows in part tells that the others are no markings."""
    hidden = [(0, tuple(post), (-1.0, 0.9), 0.0) for post in POSTS.tolist()]
    faint = [(1, (left + 1.9, left + 2.7), (0.4, 0.52), 0.0) for left in POSTS[:-1, 0].tolist()]
    found = expected_grid(seen(*hidden, *faint), Grid(POSTS, [LEVELS[1:]] * 3), floor=floor)
    assert is_whole(found) if believed else found is None


def test_the_plugin_expects_by_the_measured_floor() -> None:
    tracked = points_of(Grid(POSTS, [LEVELS[1:]] * 3))
    hidden = [(0, tuple(post), (-1.0, 0.9), 0.0) for post in POSTS.tolist()]
    faint = [(1, (left + 1.9, left + 2.7), (0.4, 0.52), 0.0) for left in POSTS[:-1, 0].tolist()]
    evidence, plugin = [seen(*hidden, *faint)], Shelves(ShelvesSettings())
    assert plugin.expect(tracked, evidence, 0.5) == []
    assert sum(thing.label == "beam" for thing in plugin.expect(tracked, evidence, 0.0)) == 9


def test_a_floor_painted_like_the_beams_does_not_move_the_lowest_one() -> None:
    evidence = painted(seen(), ((-1.0, 0.52), RED))
    assert is_whole(expected_grid(evidence, Grid(POSTS, [LEVELS, LEVELS[1:], LEVELS])))


@pytest.mark.parametrize("tracked", [np.array([[1.8, 1.9], *LEVELS[[0, 2]].tolist()]), LEVELS[[0, 2]]])
def test_a_beam_is_where_its_paint_is_not_where_the_network_sees_what_adjoins(tracked: Floats) -> None:
    """The network takes what lies right below a beam for it, in one bay: it was tracked there, or not at all. A part of the beam is in the shade."""
    evidence = painted(seen((1, (2.9, 5.3), (1.9, 2.02), 0.2), (1, (2.9, 5.3), (1.8, 1.9), 0.9)))
    found = expected_grid(
        covered(evidence, (1.9, 2.02), DARK, (2.8, 3.4)), Grid(POSTS, [LEVELS, np.sort(tracked, axis=0), LEVELS])
    )
    assert found is not None
    assert found.sections[1] == pytest.approx(LEVELS, abs=0.03)


def test_a_level_stays_where_the_paint_beside_it_is_higher_than_a_beam() -> None:
    evidence = painted(seen((1, (2.9, 5.3), (1.8, 1.9), 0.9)), ((1.5, 1.8), RED))
    section = Section(Face(evidence, WHOLE, EvidenceSettings()), (POSTS[1], POSTS[2]))
    assert section._at_its_paint(np.array([1.38, 1.48])) == pytest.approx([1.38, 1.48])


@pytest.mark.parametrize(("value", "above"), [(1.0, 0.6), (0.8, 0.0)], ids=["sure", "nothing seen of the stripe"])
def test_a_beam_in_the_shade_does_not_move_to_a_stripe_beside_it(value: float, above: float) -> None:
    shaded = seen_as(seen_as(seen(), (0.4, 0.52), value), (0.54, 0.66), above)
    section = Section(
        Face(painted(shaded, ((0.4, 0.52), DARK), ((0.54, 0.66), RED)), WHOLE, EvidenceSettings()), (POSTS[0], POSTS[1])
    )
    assert section._at_its_paint(LEVELS[0]) == pytest.approx(LEVELS[0])


def test_a_level_that_would_move_onto_another_one_is_dropped() -> None:
    evidence = painted(seen((1, (2.9, 5.3), (1.76, 1.88), 0.9)))
    double = np.sort(np.vstack([LEVELS, [1.76, 1.88]]), axis=0)
    section = Section(Face(evidence, Grid(POSTS, [LEVELS, double, LEVELS]), EvidenceSettings()), (POSTS[1], POSTS[2]))
    assert section._at_their_paint([*double]) == pytest.approx(LEVELS)


@pytest.mark.parametrize(("value", "believed"), [(1.0, True), (0.8, False)])
def test_paint_says_nothing_where_the_network_is_sure(value: float, believed: bool) -> None:
    evidence = painted(seen_as(seen(), (0.4, 0.52), value), ((0.4, 0.52), DARK))
    found = expected_grid(evidence, WHOLE)
    assert found is None if believed else found is not None and [len(levels) for levels in found.sections] == [2] * 3


def test_one_post_of_four_without_a_guard_tells_where_the_floor_is() -> None:
    guards = [(0, (POSTS[k, 0] - 0.1, POSTS[k, 1] + 0.1), (-1.0, 0.6), 0.0) for k in (0, 1, 3)]
    assert expected_grid(seen(*guards, (1, (0.1, 2.7), (0.4, 0.52), 0.4)), WHOLE) is None


def behind(height: float, share: float) -> PlaneEvidence:
    """Evidence in which the rear face's beams show faintly, from a camera at a height and distance."""
    evidence = seen()
    weight = np.exp(-np.square(evidence.patch.origin[1] + evidence.patch.heights - height))[:, None]
    for level in LEVELS.mean(axis=1):
        place = height + share * (level - height)
        evidence = seen_as(evidence, (place - 0.04, place + 0.04), 0.3)
    return replace(evidence, weight=np.broadcast_to(weight, evidence.weight.shape).astype(np.float32))


def test_beams_of_the_rear_face_are_no_levels() -> None:
    assert expected_grid(behind(2.6, 0.65), WHOLE) is None


@pytest.mark.parametrize(("thickness", "dropped"), [(0.08, True), (0.12, False)], ids=["thin", "as thick as others"])
def test_a_beam_of_the_rear_face_that_was_tracked_is_dropped(thickness: float, dropped: bool) -> None:
    place = 2.6 + 0.65 * (float(LEVELS[1].mean()) - 2.6)
    rear = place + thickness * np.array([-0.5, 0.5])
    tracked = Grid(POSTS, [LEVELS, np.sort(np.vstack([LEVELS, rear]), axis=0), LEVELS])
    found = expected_grid(behind(2.6, 0.65), tracked)
    assert is_whole(found) if dropped else found is None


@pytest.mark.parametrize(
    ("top", "rear_below", "found"),
    [(2.35, 2.2, True), (2.35, 0.0, False), (2.35, 9.0, False), (2.25, 2.2, False)],
    ids=["a rear beam below", "no rear beam", "rear beams all over", "no higher than one"],
)
def test_of_a_stripe_as_high_as_two_the_rear_beam_is_not_the_level(top: float, rear_below: float, found: bool) -> None:
    face = Face(seen(), WHOLE, EvidenceSettings())
    vars(face)["rear"] = SimpleNamespace(shows=lambda levels, height: height < rear_below)
    section = Section(face, (POSTS[0], POSTS[1]))
    section.cover = ((face.y > 2.1) & (face.y < top)).astype(float)
    level = section._before_the_rear(int(np.abs(face.y - 2.2).argmin()))
    assert level == pytest.approx([top - section.thickness, top], abs=0.03) if found else level is None


def test_one_faint_level_is_not_taken_for_the_rear_face() -> None:
    faint = [(1, (left, right), (2.6, 2.72), 0.3) for left, right in ((0.1, 2.7), (2.8, 5.4), (5.5, 8.1))]
    found = expected_grid(seen(*faint), WHOLE)
    assert found is not None
    assert [len(levels) for levels in found.sections] == [4, 4, 4]


MORE = 0.4 + 0.7 * np.arange(6)[:, None] + np.array([0.0, 0.12])
HIDDEN = 2
UNDER, RIM, FACE, GOODS = (70, 60, 50), (150, 200, 160), (90, 140, 100), (150, 110, 80)


def in_pieces(
    *pieces: tuple[float, float], paint: tuple[int, int, int] = FACE, probability: float = 0.0
) -> PlaneEvidence:
    """Six levels in each bay. Of the third one of the second bay the network sees nothing, and goods leave these pieces (x from, to)."""
    patch = face_patch(Grid(POSTS, [MORE] * 3))
    assert patch is not None
    mean, picture = np.zeros((2, *patch.shape), np.float32), np.full((*patch.shape, 3), UNDER, np.uint8)
    x, y = patch.origin[0] + patch.across, patch.origin[1] + patch.heights
    for post in POSTS.tolist():
        mean[0][:, (x > post[0]) & (x < post[1])] = 0.9
    for section, (left, right) in enumerate(pairwise(POSTS)):
        for number, (low, high) in enumerate(MORE.tolist()):
            hidden = (section, number) == (1, HIDDEN)
            for start, end in pieces if hidden else [(left[1], right[0])]:
                columns = (x > start) & (x < end)
                picture[np.ix_((y > low) & (y < high), columns)] = paint if hidden else FACE
                picture[np.ix_((y > high) & (y < high + 0.05), columns)] = RIM
                mean[1][np.ix_((y > low) & (y < high), columns)] = probability if hidden else 0.9
    return PlaneEvidence(patch, ("upright", "beam"), mean, np.ones(patch.shape, np.float32), picture)


def without_hidden() -> Grid:
    return Grid(POSTS, [MORE, np.delete(MORE, HIDDEN, axis=0), MORE])


def test_a_level_that_shows_in_pieces_is_found_by_its_colours() -> None:
    found = expected_grid(in_pieces((3.0, 3.3), (4.6, 4.9)), without_hidden())
    assert found is not None
    assert found.sections[1].mean(axis=1) == pytest.approx(MORE.mean(axis=1), abs=0.04)
    assert found.pieces == {(1, HIDDEN)}
    assert [thing.in_pieces for thing in outlines(found)].count(True) == 1


def test_a_level_that_was_tracked_by_its_pieces_stays_where_it_is_and_is_known_as_such() -> None:
    moved = MORE + 0.005 * (np.arange(6) == HIDDEN)[:, None]
    evidence = in_pieces((3.0, 3.2), (4.6, 4.8), probability=0.9)
    found = searched(Face(evidence, Grid(POSTS, [MORE, moved, MORE]), EvidenceSettings()))
    assert found.pieces == {(1, HIDDEN)}
    np.testing.assert_allclose(found.sections[1][HIDDEN], moved[HIDDEN])


def test_pieces_that_may_be_of_the_rear_face_are_no_level() -> None:
    evidence = in_pieces((3.0, 3.3), (4.6, 4.9))
    high = np.exp(-np.square(evidence.patch.origin[1] + evidence.patch.heights - 2.8))[:, None]
    seen_from_above = replace(evidence, weight=np.broadcast_to(high, evidence.weight.shape).astype(np.float32))
    assert expected_grid(seen_from_above, without_hidden()) is None


@pytest.mark.parametrize(
    ("until", "found"), [(4.4, True), (3.4, True), (3.2, False)], ids=["over half", "a quarter", "a seventh"]
)
def test_a_level_that_is_faint_along_a_part_is_found_where_a_step_lacks_one(until: float, found: bool) -> None:
    faint = in_pieces((2.8, until), probability=0.25)
    grey = replace(faint, picture=np.full_like(faint.picture, 80))
    expected = expected_grid(grey, without_hidden())
    assert (expected is not None) is found
    if expected is not None:
        assert expected.sections[1].mean(axis=1) == pytest.approx(MORE.mean(axis=1), abs=0.04)
        assert expected.pieces == frozenset()


def test_pieces_nearer_to_a_beam_than_steps_are_are_no_level() -> None:
    pieces = Pieces(in_pieces((3.0, 3.3), (4.6, 4.9)), without_hidden())
    between = (float(POSTS[1][1]), float(POSTS[2][0])), MORE[HIDDEN - 1], MORE[HIDDEN + 1]
    found = pieces.level_between(*between, room=0.5)
    assert found is not None
    assert found.mean() == pytest.approx(MORE[HIDDEN].mean(), abs=0.04)
    assert pieces.level_between(*between, room=0.75) is None


@pytest.mark.parametrize(
    "evidence",
    [in_pieces(), in_pieces((3.0, 3.3)), in_pieces((3.0, 3.3), (4.6, 4.9), paint=GOODS)],
    ids=["nothing", "one piece", "other colours"],
)
def test_what_is_not_like_the_next_levels_at_several_places_is_no_level(evidence: PlaneEvidence) -> None:
    assert expected_grid(evidence, without_hidden()) is None
