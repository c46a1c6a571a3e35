"""Mapped lamps against a survey, how they are drawn, what two rows have of them, and the lamps of a survey."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.types import Distances, Floats, Score, Structure
from savmap_lights.plugin import Lights, Settings
from savmap_lights.scores import survey_entry

Row = dict[str, Any]
LIGHTS = Lights(Settings())
evaluate, draw = LIGHTS.evaluate, LIGHTS.draw
ENDS = np.array([[1.0, 8.2, 1.1], [2.25, 8.21, 1.3]])
CENTRES = (-2.0, 1.0, 4.0, 7.0, 10.0, 13.0)


@pytest.fixture
def surveyed() -> Row:
    ends = [[[x - 0.6, 8.2, 1.2], [x + 0.6, 8.2, 1.2]] for x in CENTRES]
    return {"uprights": [[0.0, 0.1], [5.0, 5.1], [10.5, 10.6]], "lights": [{"ends": own} for own in ends]}


def lamp(number: int, *vertices: list[float]) -> Structure:
    count = len(vertices)
    labels = ("end 0", "end 1") if count == 2 else ("centre",) * count
    edges = np.array([[0, 1]] if count == 2 else [], dtype=np.int64).reshape(-1, 2)
    return Structure(f"light {number}", "light", np.array(vertices), np.zeros((count, 3, 3)), labels, edges)


def strips(row: Row) -> list[Structure]:
    return [lamp(k, *own["ends"]) for k, own in enumerate(row["lights"], start=1)]


def found(score: Score) -> Distances:
    assert not score.errors
    return score.distances["lights"]


def test_a_perfect_map_scores_zero_for_lamps_above_the_row(surveyed: Row) -> None:
    own = found(evaluate(strips(surveyed), surveyed))
    assert own.distances_m.tolist() == [0.0] * 4
    assert (own.missing, own.spurious) == (0, 0)


def test_lamps_over_other_aisles_are_not_asked_for(surveyed: Row) -> None:
    lamps = strips(surveyed)
    others = [[[x, y, z + aside] for x, y, z in own["ends"]] for own in surveyed["lights"] for aside in (-4, 5)]
    surveyed["lights"] += [{"ends": own} for own in others]
    own = found(evaluate(lamps, surveyed))
    assert (len(own.distances_m), own.missing, own.spurious) == (4, 0, 0)
    assert found(evaluate([], surveyed)).missing == 4
    far = evaluate([lamp(1, *others[2]), lamp(2, [2.0, 8.2, 3.5])], surveyed)
    assert found(far).spurious == 1


def test_ends_of_strips_are_compared_whichever_comes_first(surveyed: Row) -> None:
    long = lamp(1, [1.7, 8.2, 1.2], [0.3, 8.2, 1.2])
    score = evaluate([long], surveyed)
    assert found(score).distances_m == pytest.approx([0.0])
    assert score.distances["ends of lights"].distances_m == pytest.approx([0.1, 0.1])
    assert "ends of lights" not in evaluate([lamp(1, [1.0, 8.2, 1.2])], surveyed).distances


def test_compact_lamps_and_swapped_ends_are_compared_by_centre(surveyed: Row) -> None:
    compact = lamp(1, [1.0, 8.25, 1.2])
    turned = lamp(2, [4.6, 8.2, 1.3], [3.4, 8.2, 1.3])
    own = found(evaluate([compact, turned], surveyed))
    assert own.distances_m == pytest.approx([0.05, 0.1])
    assert (own.missing, own.spurious) == (2, 0)


def test_missing_and_spurious_lamps(surveyed: Row) -> None:
    lamps = [*strips(surveyed)[:2], lamp(9, [5.5, 8.2, 1.2]), lamp(10, [12.0, 8.2, 1.2])]
    score = evaluate(lamps, surveyed)
    own = found(score)
    assert (len(own.distances_m), own.missing, own.spurious) == (1, 3, 1)
    assert score.deviations == {"light 2": 0.0, "light 9": float("inf")}


def test_a_lamp_just_beyond_the_end_is_not_spurious_though_mapped_just_inside(surveyed: Row) -> None:
    surveyed["lights"].append({"ends": [[10.02, 8.2, 3.0], [11.22, 8.2, 3.0]]})
    own = found(evaluate([*strips(surveyed)[:-1], lamp(9, [10.55, 8.2, 3.0])], surveyed))
    assert (len(own.distances_m), own.missing, own.spurious) == (4, 0, 0)


@pytest.mark.parametrize(
    ("mapped", "distances"), [((0.5, 1.4), {1: 0.5, 2: 0.5}), ((0.1, 3.0), {1: 0.1, 2: float("inf")}), ((), {})]
)
def test_matching_is_one_to_one_within_the_gate(mapped: tuple[float, ...], distances: dict[int, float]) -> None:
    survey = {"lights": [{"ends": [[x, 0, 0], [x, 0, 0]]} for x in (0.0, 0.9)]}
    lamps = [lamp(number, [x, 0, 0]) for number, x in enumerate(mapped, start=1)]
    wanted = {f"light {number}": pytest.approx(value) for number, value in distances.items()}
    assert evaluate(lamps, survey).deviations == wanted


def test_a_survey_without_lamps_is_not_compared(surveyed: Row) -> None:
    assert vars(evaluate(strips(surveyed), {"uprights": surveyed["uprights"]})) == vars(Score())
    assert len(draw(strips(surveyed), {"uprights": surveyed["uprights"]}, {})) == 6


def test_a_row_without_uprights_has_no_end(surveyed: Row) -> None:
    assert len(found(evaluate(strips(surveyed), {"lights": surveyed["lights"]})).distances_m) == 6


def test_a_wrong_survey_is_one_line(surveyed: Row) -> None:
    with pytest.raises(OutputError, match=r"survey: `lights\[0\]\.ends\[1\]` is missing"):
        evaluate([], {"lights": [{"ends": [[0, 1, 2]]}]})


def test_drawings_of_strips_compact_lamps_and_what_is_off(surveyed: Row) -> None:
    lamps = [strips(surveyed)[1], lamp(7, [4.0, 8.2, 1.3]), lamp(8, [7.01, 8.2, 1.2])]
    drawings = draw(lamps, surveyed, evaluate(lamps, surveyed).deviations)
    assert [(own.kind, own.role) for own in drawings if own.role != "survey"] == [
        ("line", "mapped"),
        ("point", "off"),
        ("point", "mapped"),
    ]
    assert sum(own.role == "survey" for own in drawings) == 6
    assert [own.role for own in draw(lamps, None, {})] == ["mapped"] * 3


def test_lamps_are_shared_by_their_centres() -> None:
    ends = np.array([[1.0, 8, 1.5], [2.2, 8, 1.5]])
    covariances = np.array([0.01 * np.eye(3), 0.03 * np.eye(3)])
    shared = replace(lamp(2, *ends.tolist()), covariances=covariances)
    (landmark,) = LIGHTS.cross_row_landmarks([shared])
    assert (landmark.id, landmark.axes, landmark.behind_m) == ("light 2", ("x", "y", "z"), None)
    assert landmark.place.tolist() == [1.6, 8.0, 1.5]
    assert np.allclose(landmark.covariance, 0.02 * np.eye(3))


def ends_of(points: Floats) -> Floats:
    return np.array(survey_entry([lamp(1, *points.tolist())]).values["lights"][0]["ends"])


def body(half_m: float) -> Floats:
    """The corners (8, 3) of a strip around the ends."""
    aside = half_m * np.array([-0.2, 0.0, 1.25]) / np.hypot(0.2, 1.25)
    ring = np.array([ENDS[0] - aside, ENDS[1] - aside, ENDS[1] + aside, ENDS[0] + aside])
    up = np.array([0.0, 0.04, 0.0])
    return np.concatenate([ring - up, ring + up])


@pytest.mark.parametrize("points", [ENDS, body(0.06), body(0.06)[:4] + np.array([0, 0.04, 0]), body(0.06)[::-1]])
def test_a_strip_has_its_ends(points: Floats) -> None:
    found = ends_of(points)
    assert min(np.abs(found - ENDS).max(), np.abs(found[::-1] - ENDS).max()) < 1e-9


@pytest.mark.parametrize(
    "points", [ENDS[:1], ENDS[0] + 0.2 * np.array([[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]])]
)
def test_a_compact_lamp_has_one_place(points: Floats) -> None:
    assert ends_of(points) == pytest.approx(np.array([ENDS[0]] * 2))
