"""The clear space between a bay's beams, where goods stand: what two dates of a rack are compared by beside its
elements, and the names of bays and levels."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from savmap.types import Attribute, JointCovariance, Measured, Structure
from savmap_shelves.report.slots import FLOOR, Bay, Opening, bays_of, edge, openings_of

RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
UPRIGHT_LINE = np.array([[0, 1]])
CORNERS = ("lower left", "lower right", "upper left", "upper right")
ENDS = ("lower", "upper")
FLOOR_OPENING = "floor opening"
"""What stands on the floor shares the error of the row's height, which no other opening has."""


def openings(structures: Sequence[Structure], plugin: str = "shelves") -> list[Structure]:
    """A structure "bay 3 / opening 2" for each slot with a beam above it, numbered by the beam it stands on; 0 stands
    on the floor. Its corners are those of the clear space between uprights and beams; where an upright was not mapped,
    it is a line in the middle of the bay, which has a height alone. Raises OutputError for structures that lack what
    the plugin gives them."""
    return [
        _structure(bay, opening, opening.roof)
        for bay in bays_of(structures, None, plugin)
        for opening in openings_of(bay, None, plugin)
        if opening.roof is not None
    ]


def places(
    structures: Sequence[Structure], plugin: str = "shelves", joint: JointCovariance | None = None
) -> list[Structure]:
    """The bays, "bay 3", from the floor to their topmost beam, and their levels, "bay 3 / level 2", which are the slots
    of the export: the space on a beam up to the next one, level 0 on the floor; the topmost is open above and lies on
    its beam. A bay is also called a bay. Clear widths and heights are among the attributes, as the slots have them;
    what is not known is not there. `assumed`: "clear height assumed"."""
    bays = bays_of(structures, joint, plugin)
    return [place for bay in bays for place in (_section(bay), *_levels(bay, joint, plugin))]


def _section(bay: Bay) -> Structure:
    return _between(f"bay {bay.number}", "bay", bay, FLOOR, edge(bay.beams[-1], 1, "upper"), {})


def _levels(bay: Bay, joint: JointCovariance | None, plugin: str) -> Iterator[Structure]:
    for opening in openings_of(bay, joint, plugin):
        name = f"bay {bay.number} / level {opening.level}"
        more: dict[str, Attribute] = {"level": opening.level}
        if opening.clear_height:
            more["clear_height_m"] = opening.clear_height
        if opening.assumed:
            more["assumed"] = f"{', '.join(opening.assumed)} assumed"
        yield _between(name, "level", bay, opening.floor, opening.roof or opening.floor, more)


def _between(
    name: str, label: str, bay: Bay, low: Measured, high: Measured, more: Mapping[str, Attribute]
) -> Structure:
    """The rectangle of a bay between two heights."""
    width = {"clear_width_m": bay.clear_width} if bay.clear_width else {}
    corners = [(x, y, bay.face) for y in (low, high) for x in bay.extent]
    return Structure(
        name,
        label,
        np.array([[one.value for one in corner] for corner in corners]),
        np.array([np.diag([one.sigma**2 for one in corner]) for corner in corners]),
        tuple(f"{name} / {corner}" for corner in CORNERS),
        RING,
        {"bay": bay.number, **width, **more},
    )


def _structure(bay: Bay, opening: Opening, roof: Measured) -> Structure:
    name = f"bay {bay.number} / opening {opening.level}"
    xs = bay.extent if bay.clear_width else (_middle(*bay.extent),)
    corners = [(x, y, bay.face) for y in (opening.floor, roof) for x in xs]
    named, edges = (CORNERS, RING) if bay.clear_width else (ENDS, UPRIGHT_LINE)
    return Structure(
        name,
        "opening" if opening.level else FLOOR_OPENING,
        np.array([[one.value for one in corner] for corner in corners]),
        np.array([np.diag([one.sigma**2 for one in corner]) for corner in corners]),
        tuple(f"{name} / {corner}" for corner in named),
        edges,
        {"bay": bay.number, "level": opening.level},
    )


def _middle(left: Measured, right: Measured) -> Measured:
    return Measured((left.value + right.value) / 2, float(np.hypot(left.sigma, right.sigma)) / 2)
