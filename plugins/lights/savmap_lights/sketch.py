"""How lamps look in the face view and in the plan."""

from collections.abc import Mapping, Sequence
from typing import Any

from savmap.report.drawing import Drawing
from savmap.types import Floats, Structure
from savmap_lights.evaluate import evaluate
from savmap_lights.survey import read_row

OFF_M = 0.05


def draw(structures: Sequence[Structure], survey_row: Mapping[str, Any] | None) -> list[Drawing]:
    """Strip lamps as lines, compact ones as points.

    With a survey: its own underneath, and those off by more than `OFF_M` or spurious marked.

    Raises OutputError where the row's survey is malformed.
    """
    score = evaluate(structures, survey_row) if survey_row is not None else None
    off = score.deviations if score is not None else {}
    drawings = [_lamp(own.vertices, off.get(own.id, 0.0) > OFF_M) for own in structures if own.label == "light"]
    if survey_row is None or score is None:
        return drawings
    surveyed = [Drawing("line", ends, "survey", "fixture", "lamps") for ends in read_row(survey_row).ends()]
    return [*surveyed, *drawings]


def _lamp(vertices: Floats, off: bool) -> Drawing:
    return Drawing("line" if len(vertices) == 2 else "point", vertices, "off" if off else "mapped", "fixture", "lamps")
