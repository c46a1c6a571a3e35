"""How pallets look in the face view and in the plan: the upper side's outline."""

from collections.abc import Mapping, Sequence
from typing import Any

from savmap.types import Drawing, Structure
from savmap_pallets.survey import read_row

OFF_M = 0.05


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Mapped pallets over the survey's; those whose deviation (m, by id) is more than `OFF_M` marked."""
    surveyed = read_row(survey).pallets if survey and "pallets" in survey else []
    return (
        *(Drawing("polygon", one.corners()[4:], "survey", "fixture", "pallets") for one in surveyed),
        *(_pallet(one, deviations.get(one.id, 0.0) > OFF_M) for one in structures if one.label == "pallet"),
    )


def _pallet(one: Structure, off: bool) -> Drawing:
    return Drawing("polygon", one.vertices[4:], "off" if off else "mapped", "fixture", "pallets", name=one.id)
