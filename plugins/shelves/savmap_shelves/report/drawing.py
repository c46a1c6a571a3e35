"""Drawings of shelves in the face view and in the plan."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from savmap.types import Drawing, Floats, Role, Structure
from savmap_shelves.report.evaluation import SurveyedRow, holds_shelves, read_row

OFF_M = 0.05
FACE, PLAN = "uprights and beams", "uprights"


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Uprights and beams, over the survey's if there is one.

    Those whose deviation (m, by id) is more than `OFF_M` are marked. Raises OutputError where the row's survey is
    malformed.
    """
    surveyed = _surveyed(read_row(survey)) if survey is not None and holds_shelves(survey) else ()
    mapped = [structure for structure in structures if structure.label in ("upright", "beam")]
    return (
        *surveyed,
        *(part for structure in mapped for part in _mapped(structure, deviations.get(structure.id, 0.0))),
    )


def _mapped(structure: Structure, deviation_m: float) -> Iterator[Drawing]:
    role: Role = "off" if deviation_m > OFF_M else "mapped"
    if structure.label == "beam":
        yield Drawing("polygon", _outline(structure), role, "structure", FACE, ("face",), name=structure.id)
        return
    number = structure.id.split()[-1]
    yield Drawing("polygon", _outline(structure), role, "structure", FACE, ("face",), number, structure.id)
    yield Drawing("line", _foot(structure), role, "structure", PLAN, ("plan",), number, structure.id)


def _outline(structure: Structure) -> Floats:
    """The corners in order around the middle, whatever their order in the map."""
    x, y = (structure.vertices - structure.vertices.mean(axis=0))[:, :2].T
    return structure.vertices[np.argsort(np.arctan2(y, x))]


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
