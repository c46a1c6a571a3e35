"""The face model's parameters, fitted on faces of which the survey is known."""

from dataclasses import replace

import numpy as np
import pytest
from painted_face import DISTANCE, LEVELS, POSTS, PaintedFace

from savmap.types import FoundObject
from savmap_shelves.face_model import FaceReader
from savmap_shelves.lab.fit import (
    Example,
    LaidSurvey,
    SurveyedFace,
    at_coordinates,
    coordinates,
    fit,
    log_likelihood,
    matched,
)
from savmap_shelves.likelihood import FaceParameters, stored

GUESS = stored("first guess")
SURVEY = {"uprights": [list(post) for post in POSTS], "sections": [{"beams": [list(level) for level in LEVELS]}] * 3}


def surveyed(painted: PaintedFace) -> SurveyedFace:
    evidence = painted.evidence()
    reader = FaceReader(evidence, evidence, DISTANCE, None, GUESS)
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


def test_places_match_by_what_brings_most_of_them_near() -> None:
    lines = [(np.array([0.0, 1.0, 3.0]), np.array([0.4, 1.45, 2.2])), (np.array([5.0]), np.array([5.4]))]
    assert matched(lines).tolist() == [[0.0, 0.4], [1.0, 1.45], [5.0, 5.4]]
    assert not len(matched([(np.zeros(0), np.ones(2))]))


def test_a_surveyed_face_is_likelier_than_one_that_lacks_what_the_pictures_show() -> None:
    face = surveyed(PaintedFace())
    lacking = replace(face, survey=LaidSurvey(np.array(POSTS), (np.array(LEVELS[:2]),) * 3))
    assert likely([face], GUESS) > -3.0
    assert likely([lacking], GUESS) < likely([face], GUESS) - 50.0


def test_lines_have_the_ratios_that_the_model_reads() -> None:
    face = surveyed(PaintedFace())
    example = Example.of(face, GUESS)
    span = example.sections.spans[1]
    expected = face.reader.pooled(example.sections.ratios[:, slice(*span)])
    assert example.lines[1].ratios(GUESS.beam, 0.0) == pytest.approx(expected)


def test_parameters_have_coordinates() -> None:
    place = coordinates(GUESS)
    parameters = at_coordinates(GUESS, place + 0.1)
    assert coordinates(at_coordinates(GUESS, place)) == pytest.approx(place)
    assert parameters.post == pytest.approx(GUESS.post + 0.2)
    assert parameters.along == pytest.approx(GUESS.along * np.exp(0.07))
    assert sum(parameters.chances) == pytest.approx(1.0)
    assert (parameters.hidden, parameters.gap) == (GUESS.hidden, GUESS.gap)


def test_a_fit_makes_the_surveyed_members_likelier(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap_shelves.lab.fit.ITERATIONS", 2)
    faint = surveyed(PaintedFace(score=0.25))
    result = fit([faint], GUESS)
    assert result.after > result.before
    assert log_likelihood([Example.of(faint, GUESS)], result.parameters) == pytest.approx(result.after)
    assert (result.lines, result.members) == (5, 13)
