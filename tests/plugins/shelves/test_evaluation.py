"""Mapped shelves against a survey: what is perfect, missing, spurious, shifted or outside."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from perfect_maps import Row, structures_of, surveyed_row

from savmap.errors import OutputError
from savmap.report.evaluation import mean_absolute_error, score_json
from savmap.types import Score, Structure
from savmap_shelves.report.evaluation import evaluate


@pytest.fixture
def surveyed() -> Row:
    return surveyed_row()


def without(structures: list[Structure], *ids: str) -> list[Structure]:
    kept = [own for own in structures if own.id not in ids]
    assert len(kept) == len(structures) - len(ids)
    return kept


def counts(score: Score) -> tuple[int, int, int, int]:
    """Missing uprights and beams, spurious uprights and beams."""
    return score.missing["upright"], score.missing["beam"], score.spurious["upright"], score.spurious["beam"]


def test_a_perfect_map_scores_zero(surveyed: Row) -> None:
    score = evaluate(structures_of(surveyed), surveyed)
    content = score_json(score)
    assert counts(score) == (0, 0, 0, 0)
    assert content["mae_m"] == 0
    assert {name: figures["count"] for name, figures in content["classes"].items()} == {
        "V element": 5,
        "V gap": 4,
        "H element": 22,
        "H gap": 18,
    }
    assert {name: figures["count"] for name, figures in content["edges"].items()} == {"V edge": 10, "H edge": 44}
    assert set(score.deviations.values()) == {0.0}


def test_an_empty_map_misses_everything(surveyed: Row) -> None:
    score = evaluate([], surveyed)
    assert counts(score) == (5, 22, 0, 0)
    assert mean_absolute_error(score) is None


def test_errors_are_truth_minus_estimate(surveyed: Row) -> None:
    mapped = copy.deepcopy(surveyed)
    mapped["sections"][0]["beams"][1] = [1.19, 1.33]
    score = evaluate(structures_of(mapped), surveyed)
    elements, spaces = score.errors["H element"], score.errors["H gap"]
    assert elements[np.abs(elements) > 1e-9] == pytest.approx([-0.04])
    assert sorted(np.round(spaces[np.abs(spaces) > 1e-9], 9)) == [0.01, 0.03]
    assert score.deviations["bay 1 / beam 2"] == pytest.approx(0.03)


def test_an_upright_missing_in_the_middle(surveyed: Row) -> None:
    score = evaluate(without(structures_of(surveyed), "upright 3"), surveyed)
    assert counts(score) == (1, 0, 0, 0)
    assert mean_absolute_error(score) == 0
    assert len(score.errors["V gap"]) == 2
    assert len(score.errors["V element"]) == 4


def test_two_sections_mapped_as_one(surveyed: Row) -> None:
    merged = {
        "uprights": [x for k, x in enumerate(surveyed["uprights"]) if k != 2],
        "sections": [surveyed["sections"][k] for k in (0, 1, 3)],
    }
    score = evaluate(structures_of(merged), surveyed)
    assert score.missing["upright"] == 1
    assert score.spurious["upright"] == 0
    assert score.missing["beam"] >= 3
    assert score.missing["beam"] - score.spurious["beam"] == 3
    assert len(score.errors["V element"]) == 4


def test_the_first_upright_missing_shifts_the_frame_but_not_the_rest(surveyed: Row) -> None:
    origin = surveyed["uprights"][1][0]
    cut = {
        "uprights": [[x - origin for x in pair] for pair in surveyed["uprights"][1:]],
        "sections": surveyed["sections"][1:],
    }
    score = evaluate(structures_of(cut), surveyed)
    assert counts(score) == (1, 6, 0, 0)
    assert mean_absolute_error(score) == pytest.approx(0, abs=1e-9)
    assert np.abs(score.coordinates["V edge"]).max() == pytest.approx(0, abs=1e-9)


def test_a_spurious_upright_splits_a_section(surveyed: Row) -> None:
    split = copy.deepcopy(surveyed)
    split["uprights"].insert(2, [5.4, 5.5])
    split["sections"].insert(1, split["sections"][1])
    score = evaluate(structures_of(split), surveyed)
    assert counts(score) == (0, 0, 1, 6)
    assert mean_absolute_error(score) == 0
    assert len(score.errors["V gap"]) == 3
    assert score.deviations["upright 3"] == float("inf")


@pytest.mark.parametrize("section", [1, 2, 3, 4])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_any_missing_beam_shifts_no_other(surveyed: Row, section: int, number: int) -> None:
    score = evaluate(without(structures_of(surveyed), f"bay {section} / beam {number}"), surveyed)
    assert counts(score) == (0, 1, 0, 0)
    assert mean_absolute_error(score) == 0
    assert len(score.errors["H element"]) == 21


def test_a_spurious_beam_is_counted_and_its_gap_is_not_scored(surveyed: Row) -> None:
    mapped = copy.deepcopy(surveyed)
    mapped["sections"][2]["beams"].insert(0, [1.2, 1.3])
    mapped["sections"][3]["beams"].insert(5, [4.2, 4.3])
    score = evaluate(structures_of(mapped), surveyed)
    assert counts(score) == (0, 0, 0, 2)
    assert mean_absolute_error(score) == 0
    assert len(score.errors["H gap"]) == 17


def test_a_beam_at_the_wrong_level_is_both_missing_and_spurious(surveyed: Row) -> None:
    mapped = copy.deepcopy(surveyed)
    mapped["sections"][0]["beams"][1] = [1.7, 1.8]
    score = evaluate(structures_of(mapped), surveyed)
    assert counts(score) == (0, 1, 0, 1)
    assert mean_absolute_error(score) == 0


def test_sections_that_swapped_their_beams_are_not_good(surveyed: Row) -> None:
    mapped = copy.deepcopy(surveyed)
    mapped["sections"][2], mapped["sections"][3] = mapped["sections"][3], mapped["sections"][2]
    score = evaluate(structures_of(mapped), surveyed)
    assert score.missing["beam"] >= 4
    assert score.spurious["beam"] >= 4


def test_widths_hide_a_shift_but_edges_do_not(surveyed: Row) -> None:
    raised = copy.deepcopy(surveyed)
    for section in raised["sections"]:
        section["beams"] = [[low + 0.1, high + 0.1] for low, high in section["beams"]]
    score = evaluate(structures_of(raised), surveyed)
    assert counts(score) == (0, 0, 0, 0)
    assert mean_absolute_error(score) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(score.coordinates["H edge"], -0.1)


@pytest.mark.parametrize("scale", [0.9, 0.97, 1.05])
def test_drift_along_a_long_row_matches_all_the_same(scale: float) -> None:
    left = 3.7 * np.arange(16) + np.random.default_rng(2).uniform(-0.1, 0.1, 16)
    left -= left[0]
    beams = {"beams": [[y, y + 0.1] for y in (0.3, 1.4, 2.6)]}
    row: Row = {"uprights": [[x, x + 0.1] for x in left], "sections": [beams] * 15}
    mapped = {**row, "uprights": [[x * scale, x * scale + 0.1] for x in left]}
    whole = evaluate(structures_of(mapped), row)
    assert counts(whole) == (0, 0, 0, 0)
    assert np.abs(whole.coordinates["V edge"]).max() == pytest.approx(abs(1 - scale) * left[-1])
    holed = evaluate(without(structures_of(mapped), "upright 6", "upright 11"), row)
    assert counts(holed) == (2, 0, 0, 0)
    assert len(holed.errors["V gap"]) == 11


def test_what_lies_outside_the_surveyed_extent_is_not_scored(surveyed: Row) -> None:
    part = {"uprights": surveyed["uprights"][:4], "sections": surveyed["sections"][:3]}
    score = evaluate(structures_of(surveyed), part)
    assert counts(score) == (0, 0, 0, 0)
    assert mean_absolute_error(score) == 0
    assert "upright 5" not in score.deviations


def test_a_map_that_begins_a_section_before_the_survey(surveyed: Row) -> None:
    origin = surveyed["uprights"][1][0]
    part = {
        "uprights": [[x - origin for x in pair] for pair in surveyed["uprights"][1:]],
        "sections": surveyed["sections"][1:],
    }
    score = evaluate(structures_of(surveyed), part)
    assert counts(score) == (0, 0, 0, 0)
    assert np.abs(score.coordinates["V edge"]).max() == pytest.approx(0, abs=1e-9)


def test_a_section_without_beams(surveyed: Row) -> None:
    surveyed["sections"][2]["beams"] = []
    assert counts(evaluate(structures_of(surveyed), surveyed)) == (0, 0, 0, 0)


def test_noise_of_two_centimetres_is_matched_and_measured(surveyed: Row) -> None:
    rng = np.random.default_rng(1)
    mapped = {
        "uprights": (np.array(surveyed["uprights"]) + rng.normal(0, 0.02, (5, 2))).tolist(),
        "sections": [
            {"beams": (np.array(own["beams"]) + rng.normal(0, 0.02, (len(own["beams"]), 2))).tolist()}
            for own in surveyed["sections"]
        ],
    }
    score = evaluate(structures_of(mapped), surveyed)
    assert counts(score) == (0, 0, 0, 0)
    assert mean_absolute_error(score) == pytest.approx(0.02 * np.sqrt(4 / np.pi), rel=0.3)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("uprights", [[0, 0.1]], "`uprights`: at least 2 entries are expected"),
        ("uprights", [[0, 0.1], [3.8, 3.7]], r"`uprights\[1\]`: \[3.8, 3.7\] should be \[smaller, larger\]"),
        ("uprights", [[0, 0.1], [9, 9.1], [5, 5.1]], r"`uprights`: \[5.0, 5.1\] should lie beyond \[9.0, 9.1\]"),
        ("sections", [], "5 uprights bound 4 bays, not 0"),
        ("sections", [{"beam": []}] * 4, r"unknown key `sections\[0\]\.beam`: did you mean `beams`\?"),
    ],
)
def test_a_wrong_survey_is_one_line(surveyed: Row, key: str, value: Any, message: str) -> None:
    with pytest.raises(OutputError, match=message) as caught:
        evaluate([], {**surveyed, key: value})
    assert "\n" not in str(caught.value)


def test_structures_of_another_shape_are_one_line(surveyed: Row) -> None:
    structures = structures_of(surveyed)
    unlabelled = replace(structures[0], vertex_labels=("a", "b", "c", "d"))
    with pytest.raises(OutputError, match="upright 1: no vertex is labelled 'left'"):
        evaluate([unlabelled], surveyed)
    with pytest.raises(OutputError, match="bay 1 / beam 1: attribute 'bay' should be"):
        evaluate([replace(structures[5], attributes={})], surveyed)
