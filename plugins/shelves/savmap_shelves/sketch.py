"""How shelves look in the face view and in the plan."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from savmap.report.drawing import Drawing, Role
from savmap.types import Floats, Structure
from savmap_shelves.evaluate import evaluate
from savmap_shelves.survey import SurveyedRow, read_row

OFF_M = 0.05
FACE, PLAN = "uprights and beams", "uprights"


def draw(structures: Sequence[Structure], survey_row: Mapping[str, Any] | None) -> list[Drawing]:
    """Uprights and beams; with a survey, its own underneath, and those off by more than `OFF_M` or spurious marked.

    Raises OutputError where the row's survey is malformed.
    """
    mapped = [own for own in structures if own.label in ("upright", "beam")]
    if survey_row is None:
        return [drawing for own in mapped for drawing in _mapped(own, 0.0)]
    off = evaluate(structures, survey_row).deviations
    drawings = [drawing for own in mapped for drawing in _mapped(own, off.get(own.id, 0.0))]
    return [*_surveyed(read_row(survey_row)), *drawings]


def _mapped(structure: Structure, deviation_m: float) -> Iterator[Drawing]:
    role: Role = "off" if deviation_m > OFF_M else "mapped"
    if structure.label == "beam":
        yield Drawing("polygon", structure.vertices, role, "structure", FACE, ("face",))
        return
    number = structure.id.split()[-1]
    yield Drawing("polygon", structure.vertices, role, "structure", FACE, ("face",), number)
    yield Drawing("line", _foot(structure), role, "structure", PLAN, ("plan",), number)


def _foot(structure: Structure) -> Floats:
    """Left and right edge of an upright seen from above (2, 3)."""
    left = np.array(["left" in label.split() for label in structure.vertex_labels])
    return np.array([structure.vertices[left].mean(axis=0), structure.vertices[~left].mean(axis=0)])


def _surveyed(row: SurveyedRow) -> Iterator[Drawing]:
    """Uprights, of unsurveyed height, reach just above the highest beam of the row."""
    top = max((beams[-1][1] for beams in (section.beams for section in row.sections) if beams), default=2.0) + 0.3
    for x in row.upright_intervals():
        yield Drawing("polygon", _rectangle(x, np.array([0.0, top])), "survey", "structure", FACE, ("face",))
        foot = np.array([[x[0], 0.0, 0.0], [x[1], 0.0, 0.0]])
        yield Drawing("line", foot, "survey", "structure", PLAN, ("plan",))
    for number, x in enumerate(row.section_intervals()):
        for y in row.beam_intervals(number):
            yield Drawing("polygon", _rectangle(x, y), "survey", "structure", FACE, ("face",))


def _rectangle(x: Floats, y: Floats) -> Floats:
    """Corners (4, 3) in the face plane, around."""
    return np.array([[x[0], y[0], 0.0], [x[1], y[0], 0.0], [x[1], y[1], 0.0], [x[0], y[1], 0.0]])
