"""How signs look in the face view and in the plan."""

from collections.abc import Mapping, Sequence
from typing import Any

from savmap.types import Drawing, Structure
from savmap_signs.survey import read_row

OFF_M = 0.03


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Signs with their text. With a survey: its own underneath, and those whose deviation (m, by id) is more than `OFF_M` marked."""
    drawings = [_sign(own, deviations.get(own.id, 0.0) > OFF_M) for own in structures if own.label == "sign"]
    corners = read_row(survey).corners() if survey and "signs" in survey else ()
    return (*(Drawing("polygon", own, "survey", "fixture", "signs") for own in corners), *drawings)


def _sign(own: Structure, off: bool) -> Drawing:
    text = str(own.attributes.get("text", ""))
    return Drawing("polygon", own.vertices, "off" if off else "mapped", "fixture", "signs", caption=text, name=own.id)
