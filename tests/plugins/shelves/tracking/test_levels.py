"""What counts as a beam level: support over the frames, and the floor."""

from dataclasses import replace

import numpy as np
import pytest
import synth
from savmap_shelves.tracking.levels import _crowded, _often_enough, _support, _unlike
from tracking_truth import counted

from savmap.geometry import pinhole
from savmap.types import Feature
from savmap_shelves.tracking import track_structures
from savmap_shelves.tracking.density import supported

CLEAN = synth.Faults(
    noise_px=0.2, miss_upright=0, miss_beam=0, duplicate=0, wide=0, false_upright=0, false_beam=0, rear=0, behind=0
)
SHORT = synth.Pass(rate=4, speed=0.9, distance=1.7)
NONE = np.zeros(4, np.bool_)
HIDDEN = (1, 1)


def footage_with(level: tuple[float, float]) -> synth.Footage:
    """A row whose second bay shows one more level, of edges at these heights, in every frame."""
    rng = np.random.default_rng(3)
    rack = synth.random_rack(rng, 3, bridge=False)
    marked = np.vstack([level, rack.beams[1]])
    rack = synth.Rack(rack.uprights, (rack.beams[0], marked, rack.beams[2]), rack.height)
    return synth.footage(rack, rng, (SHORT,), CLEAN)


def feet(footage: synth.Footage, height: float = 0.0) -> list[Feature]:
    """Where uprights end below, in every frame that shows it."""
    (name, view), found = next(iter(footage.facts.views.items())), []
    for frame, pose in enumerate(footage.world_from_rig):
        for number, x in enumerate(footage.rack.uprights.mean(axis=1)):
            place = (np.array([x, height, 0.0]) - pose[:3, 3]) @ pose[:3, :3] @ view.rig_from_view
            pixel = pinhole.project(place, view.camera)
            if place[2] > 0 and (pixel > 0).all() and (pixel < [view.width, view.height]).all():
                found.append(Feature(frame, name, "upright", "foot", number, pixel[None], np.eye(2)[None] * 4.0))
    return found


def levels_of(footage: synth.Footage, *more: Feature) -> list[int]:
    return counted(track_structures([*footage.features, *more], footage.facts, attitudes=footage.attitudes))[1]


def counts(footage: synth.Footage, less: int) -> list[int]:
    """How many levels each bay has, if `less` of those of the second bay do not count."""
    return [count - less * (section == 1) for section, count in enumerate(footage.rack.counts)]


MARKINGS = {"far below": (-0.75, -0.65), "thin": (-0.25, -0.21), "wide": (-0.4, -0.2)}


@pytest.mark.parametrize("marking", MARKINGS.values(), ids=MARKINGS)
def test_markings_on_the_floor_are_no_beams(marking: tuple[float, float]) -> None:
    footage = footage_with(marking)
    assert levels_of(footage, *feet(footage)) == counts(footage, 1)


def test_what_all_frames_show_together_is_no_marking() -> None:
    footage = footage_with(MARKINGS["wide"])
    expected = replace(footage, features=[replace(feature, expected=True) for feature in footage.features])
    assert levels_of(expected, *feet(footage)) == counts(footage, 0)


def hidden_in_part(footage: synth.Footage, again: bool) -> list[Feature]:
    """Its features, all expected; of a beam the upper two fifths are hidden and every sixth frame shows nothing. again: whether
    second readings have its upper edge."""
    found: list[Feature] = []
    lower = {
        (feature.frame, feature.part.split()[1]): feature.pixels
        for feature in footage.features
        if footage.truth[id(feature)] == HIDDEN and feature.part.startswith("lower ")
    }
    for feature in (replace(one, expected=True) for one in footage.features if footage.truth[id(one)] != HIDDEN):
        found.append(feature)
    for feature in (one for one in footage.features if footage.truth[id(one)] == HIDDEN and one.frame % 6):
        seen = replace(feature, expected=True)
        if feature.part.startswith("upper "):
            below = lower[feature.frame, feature.part.split()[1]]
            found += [replace(seen, part=f"second {feature.part}")] if again else []
            seen = replace(seen, pixels=below + 0.6 * (feature.pixels - below))
        found.append(seen)
    return found


@pytest.mark.parametrize("again", [False, True])
def test_a_thin_beam_that_all_frames_show_is_kept_where_it_is_hidden_in_part(again: bool) -> None:
    rng = np.random.default_rng(3)
    footage = synth.footage(synth.random_rack(rng, 3, bridge=False), rng, (SHORT,), replace(CLEAN, noise_px=0.03))
    found = counted(track_structures(hidden_in_part(footage, again), footage.facts, attitudes=footage.attitudes))[1]
    assert found == counts(footage, 0 if again else 1)


def test_nothing_says_where_the_floor_is() -> None:
    footage = footage_with(MARKINGS["far below"])
    assert levels_of(footage) == counts(footage, 0)


def test_guards_hide_the_feet_to_above_the_lowest_beam() -> None:
    rng = np.random.default_rng(3)
    thickness = float(
        np.median([np.diff(beams, axis=1) for beams in synth.random_rack(rng, 3, bridge=False).beams[1:2]])
    )
    footage = footage_with((-0.05 - thickness, -0.05))
    assert levels_of(footage, *feet(footage, 0.05)) == counts(footage, 0)


def test_support_of_a_beam_hidden_in_part_is_more_than_of_one_that_comes_and_goes() -> None:
    shown = np.ones((2, 20), dtype=np.bool_)
    hits = np.array([np.ones(20), np.arange(20) % 4 == 0], dtype=np.bool_)
    cover = hits * np.array([[0.25], [1.0]])
    hidden, passing = _support(hits, cover, shown)
    assert np.isclose(hidden, np.cbrt(0.25))
    assert np.isclose(passing, np.cbrt(0.25**3))
    assert np.allclose(_support(np.ones((1, 4), dtype=np.bool_), np.ones((1, 4)), shown[:1, :4]), 1.0)


def test_girders_and_goods_are_thicker_than_beams_wherever_they_are_seen() -> None:
    levels = np.array([[0, 0.0], [0, 1.0], [0, 2.0], [0, 3.0]])
    support = np.array([1.0, 1.0, 0.5, 0.5])
    which = np.repeat(np.arange(4), 10)
    thickness = np.full(40, 0.1)
    thickness[which == 2] = 0.4
    thickness[which == 3] = [0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.1, 0.1, 0.1, 0.1]
    edges = levels[which, 1:] + np.column_stack([-thickness / 2, thickness / 2])
    assert _unlike(levels, edges, which, support, -np.inf, NONE, True).tolist() == [False, False, True, False]
    assert not _unlike(levels, edges, which, np.ones(4), -np.inf, NONE, True).any()
    assert _unlike(levels, edges, which, support, -np.inf, ~NONE, True).tolist() == [False, False, True, False]


@pytest.mark.parametrize(("lower", "doubted"), [(0.02, True), (0.12, False)])
def test_a_thin_level_that_lies_on_the_floor_is_no_beam_hidden_from_below(lower: float, doubted: bool) -> None:
    levels = np.array([[0, lower + 0.03], [0, 1.5], [0, 3.0]])
    which = np.repeat(np.arange(3), 10)
    thickness = np.where(which == 0, 0.06, 0.12)
    edges = levels[which, 1:] + np.column_stack([-thickness / 2, thickness / 2])
    support = np.array([0.7, 1.0, 1.0])
    assert _unlike(levels, edges, which, support, 0.0, NONE[:3], True).tolist() == [doubted, False, False]


@pytest.mark.parametrize(
    ("height", "expected", "doubted"), [(0.3, False, False), (0.5, False, True), (0.5, True, False), (0.8, True, True)]
)
def test_the_lowest_level_may_stand_higher_where_all_frames_show_it(
    height: float, expected: bool, doubted: bool
) -> None:
    levels = np.array([[0, height], [0, 1.5], [0, 3.0]])
    which = np.repeat(np.arange(3), 10)
    thickness = np.where(which == 0, 0.06, 0.12)
    edges = levels[which, 1:] + np.column_stack([-thickness / 2, thickness / 2])
    support = np.array([0.7, 1.0, 1.0])
    thin = _unlike(levels, edges, which, support, 0.0, np.array([expected, True, True]), False)
    assert thin.tolist() == [doubted, False, False]


@pytest.mark.parametrize(
    ("expected", "beside", "kept"),
    [(True, 2.3, True), (False, 2.3, False), (True, 1.4, False)],
    ids=["all frames show it", "single frames show it", "no bay beside has one there"],
)
def test_a_thin_level_is_a_beam_where_its_section_lacks_one(expected: bool, beside: float, kept: bool) -> None:
    own, other = [0.4, 1.4, 2.4, 3.4, 4.4, 5.4], sorted([0.4, beside, 3.4, 4.4, 5.4])
    levels = np.column_stack([np.repeat([0, 1], [6, 5]), own + other])
    which = np.repeat(np.arange(11), 10)
    half = np.where(which == 2, 0.03, 0.06)
    edges = levels[which, 1:] + half[:, None] * np.array([-1.0, 1.0])
    support = np.where(np.arange(11) == 2, 0.6, 1.0)
    unlike = _unlike(levels, edges, which, support, 0.0, np.full(11, expected), trusting=False)
    assert unlike.tolist() == [k == 2 and not kept for k in range(11)]


@pytest.mark.parametrize(
    ("support", "expected", "beside", "kept"),
    [(0.25, True, 2.3, True), (0.1, True, 2.3, False), (0.25, False, 2.3, False), (0.25, True, 1.4, False)],
    ids=["all frames show it", "hardly sighted", "single frames show it", "no bay beside has one there"],
)
def test_half_the_support_is_enough_where_a_section_lacks_a_level(
    support: float, expected: bool, beside: float, kept: bool
) -> None:
    own, other = [0.4, 1.4, 2.4, 3.4, 4.4, 5.4], sorted([0.4, beside, 3.4, 4.4, 5.4])
    levels = np.column_stack([np.repeat([0, 1], [6, 5]), own + other])
    weak = np.arange(11) == 2
    often = _often_enough(
        levels, np.where(weak, support, 1.0), np.full(11, 20), np.full(11, 5), 0.35, weak & expected, np.ones(11, bool)
    )
    assert often.tolist() == [k != 2 or kept for k in range(11)]


def test_chance_does_not_count_against_what_all_frames_show() -> None:
    support, shown, count = np.array([0.9, 0.9, 0.4, 0.4]), np.full(4, 8), np.full(4, 5)
    assert supported(support, shown, count, 0.3).tolist() == [True, True, False, False]
    assert supported(support, shown, count, 0.3, np.arange(4) == 3).tolist() == [True, True, False, True]


def test_one_beam_that_is_taken_for_two_is_crowded() -> None:
    levels = np.array([[0, 0.0], [0, 0.2], [0, 1.0], [1, 0.1]])
    assert _crowded(levels, np.array([1.0, 0.4, 0.4, 0.4]), 0.1).tolist() == [False, True, False, False]


@pytest.mark.parametrize(
    ("number", "expected", "kept"),
    [(0, True, True), (0, False, False), (1, True, False)],
    ids=["all frames together show it", "single frames show it", "it is not the lowest"],
)
def test_a_thick_level_is_a_beam_that_goods_on_the_floor_adjoin(number: int, expected: bool, kept: bool) -> None:
    levels = np.column_stack([np.zeros(3), [0.3, 1.6, 2.9]])
    half = np.full(3, 0.06)
    half[number] = 0.14
    which = np.repeat(np.arange(3), 5)
    edges = levels[which, 1:] + half[which, None] * np.array([-1.0, 1.0])
    support = np.where(np.arange(3) == number, 0.6, 1.0)
    unlike = _unlike(levels, edges, which, support, 0.0, np.full(3, expected), trusting=True)
    assert unlike.tolist() == [k == number and not kept for k in range(3)]
