"""How lamps look in the face view and in the plan."""

from collections.abc import Mapping, Sequence
from typing import Any

from savmap.types import Drawing, Kind, Structure
from savmap_lights.survey import read_row

OFF_M = 0.05


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Strip lamps as lines, compact ones as points.

    With a survey: its own underneath, and those whose deviation (m, by id) is more than `OFF_M` marked.
    """
    drawings = [_lamp(own, deviations.get(own.id, 0.0) > OFF_M) for own in structures if own.label == "light"]
    ends = read_row(survey).ends() if survey and "lights" in survey else ()
    return (*(Drawing("line", own, "survey", "fixture", "lamps") for own in ends), *drawings)


def _lamp(own: Structure, off: bool) -> Drawing:
    kind: Kind = "line" if len(own.vertices) == 2 else "point"
    return Drawing(kind, own.vertices, "off" if off else "mapped", "fixture", "lamps", name=own.id)
