"""The clear space between a section's beams, where goods stand: what two dates of a rack are compared by beside its elements."""

from collections.abc import Sequence

import numpy as np

from savmap.types import Measured, Structure
from savmap_shelves.report.slots import Bay, Opening, bays_of, openings_of

RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
UPRIGHT_LINE = np.array([[0, 1]])
CORNERS = ("lower left", "lower right", "upper left", "upper right")
ENDS = ("lower", "upper")


def openings(structures: Sequence[Structure], plugin: str = "shelves") -> list[Structure]:
    """A structure "section 3 / opening 2" for each slot with a beam above it, numbered by the beam it stands on; 0 stands on the floor. Its
    corners are those of the clear space between uprights and beams; where an upright was not mapped, it is a line in the middle of the section,
    which has a height alone. Raises OutputError for structures that lack what the plugin gives them."""
    return [
        _structure(bay, opening, opening.roof)
        for bay in bays_of(structures, None, plugin)
        for opening in openings_of(bay, None, plugin)
        if opening.roof is not None
    ]


def _structure(bay: Bay, opening: Opening, roof: Measured) -> Structure:
    name = f"section {bay.number} / opening {opening.level}"
    xs = bay.extent if bay.clear_width else (_middle(*bay.extent),)
    corners = [(x, y, bay.face) for y in (opening.floor, roof) for x in xs]
    named, edges = (CORNERS, RING) if bay.clear_width else (ENDS, UPRIGHT_LINE)
    return Structure(
        name,
        "opening",
        np.array([[one.value for one in corner] for corner in corners]),
        np.array([np.diag([one.sigma**2 for one in corner]) for corner in corners]),
        tuple(f"{name} / {corner}" for corner in named),
        edges,
        {"section": bay.number, "level": opening.level},
    )


def _middle(left: Measured, right: Measured) -> Measured:
    return Measured((left.value + right.value) / 2, float(np.hypot(left.sigma, right.sigma)) / 2)
