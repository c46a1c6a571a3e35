"""The face model's parameters, fitted on faces of which the survey is known."""

from dataclasses import replace

import numpy as np
import pytest
from painted_face import DISTANCE, FAINT, HEIGHT, LEVELS, POSTS, PaintedFace

from savmap.types import Floats, FoundObject
from savmap_shelves.face_model import FaceReader
from savmap_shelves.lab.fit import (
    Example,
    LaidSurvey,
    SurveyedFace,
    counted_tables,
    counts,
    fit,
    log_likelihood,
    matched,
)
from savmap_shelves.likelihood import FaceParameters, stored

GUESS = stored("first guess")
SURVEY = {"uprights": [list(post) for post in POSTS], "sections": [{"beams": [list(level) for level in LEVELS]}] * 3}


def surveyed(painted: PaintedFace) -> SurveyedFace:
    evidence = painted.evidence()
    reader = FaceReader(evidence, evidence, (HEIGHT, DISTANCE), None, GUESS)
    return SurveyedFace(reader, LaidSurvey(np.array(POSTS), (np.array(LEVELS),) * 3))


def likely(faces: list[SurveyedFace], parameters: FaceParameters) -> float:
    return log_likelihood([Example.of(face, parameters) for face in faces], parameters)


def rectangle(name: str, label: str, x: tuple[float, float], y: tuple[float, float], probability: float) -> FoundObject:
    corners = [(x[0], y[0], 0.0), (x[1], y[0], 0.0), (x[1], y[1], 0.0), (x[0], y[1], 0.0)]
    return FoundObject(name, label, np.array(corners), probability)


def test_a_survey_is_laid_where_the_camera_went() -> None:
    places = np.column_stack([np.linspace(-1, 9, 20), np.full(20, 1.7), np.full(20, 1.5)])
    laid = LaidSurvey.by_path(SURVEY, 2.0 * places + [3.0, 1.0, 0.5], places)
    assert laid.posts == pytest.approx(2.0 * np.array(POSTS) + 3.0)
    assert laid.sections[1] == pytest.approx(2.0 * np.array(LEVELS) + 1.0)


def test_a_survey_moves_to_the_objects_though_some_of_these_are_wrong() -> None:
    survey = LaidSurvey(np.array(POSTS), (np.array(LEVELS),) * 3)

    def moved(places: tuple[float, float], by: float) -> tuple[float, float]:
        return places[0] + by, places[1] + by

    objects = [rectangle(f"upright {k}", "upright", moved(post, 0.05), (0.0, 4.0), 1.0) for k, post in enumerate(POSTS)]
    objects += [
        rectangle(f"bay {bay} / beam {k}", "beam", moved((left + 0.1, left + 2.7), 0.05), moved(level, -0.03), 1.0)
        for bay, (left, _) in enumerate(POSTS[:3])
        for k, level in enumerate(LEVELS)
    ]
    wrong = rectangle("bay 2 / beam 4", "beam", (4.0, 6.0), (2.6, 2.7), 0.9)
    laid = survey.moved_to([*objects, wrong])
    assert laid.posts == pytest.approx(survey.posts + 0.05, abs=1e-3)
    assert laid.sections[2] == pytest.approx(survey.sections[2] - 0.03, abs=1e-3)
    doubtful = rectangle("bay 1 / below beam 1, 1", "beam", (0.8, 3.2), (0.1, 0.2), 0.02)
    expected = [(1.0, True)] * len(objects) + [(0.9, False), (0.02, False)]
    assert [*laid.existing([*objects, wrong, doubtful])] == expected


def test_places_match_only_what_is_nearer_than_half_a_step() -> None:
    assert matched(np.array([0.0, 1.0, 2.0]), np.array([0.1, 1.7])).tolist() == [[0.0, 0.1], [2.0, 1.7]]
    assert not len(matched(np.zeros(0), np.ones(2)))


def test_a_surveyed_face_is_likelier_than_one_that_lacks_what_the_pictures_show() -> None:
    face = surveyed(PaintedFace())
    lacking = replace(face, survey=LaidSurvey(np.array(POSTS), (np.array(LEVELS[:2]),) * 3))
    assert likely([face], GUESS) > -3.0
    assert likely([lacking], GUESS) < likely([face], GUESS) - 50.0


def test_cells_between_two_knots_count_for_both() -> None:
    given: Floats = counts(np.array([[0.0, 0.25], [1.0, 2.0]]), np.ones((2, 2)), np.array([0.0, 0.5, 1.0]))
    assert given == pytest.approx([1.5, 0.5, 2.0])


def test_tables_and_hidden_shares_are_counted() -> None:
    """Half of every beam is hidden, and members score 0.6: that is what the tables then take for sure."""
    painted = PaintedFace(score=0.6)
    for left, _ in POSTS[:3]:
        for level in LEVELS:
            painted.draw("beam", (left + 1.4, left + 2.7), level, FAINT)
    counted = counted_tables([Example.of(surveyed(painted), GUESS)], GUESS, GUESS)
    assert counted.beam[4] > GUESS.beam[4]
    assert counted.beam[0] < -2.0
    assert sum(counted.chances) == pytest.approx(1.0)
    assert counted.chances[2] > GUESS.chances[2]


def test_a_fit_makes_the_surveyed_members_likelier(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap_shelves.lab.fit.STEPS", 20)
    faint = PaintedFace(score=0.25)
    lines = list[str]()
    result = fit([surveyed(faint)], GUESS, lines.append)
    assert result.after > result.before
    assert likely([surveyed(faint)], result.parameters) > likely([surveyed(faint)], GUESS)
    assert (result.lines, result.members) == (4, 13)
    assert len(lines) == 3
