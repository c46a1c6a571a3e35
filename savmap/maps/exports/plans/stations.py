"""Where vehicles stop: before each bay of a row, on the path nearest to it.

A bay is what structures have the same number of as their attribute `bay`; what is written on structures that hang there
(`bay`, `text`) is its title.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import Element, elements
from savmap.types import Floats, SiteMap, array_record

BAY, TEXT = "bay", "text"


@dataclass(frozen=True, eq=False)
@array_record
class Station:
    """A bay of a row: the middle of its face (2,) m in the world from above, its name, and what is written there."""

    name: str
    row: str
    place: Floats
    title: str


def stations(site: SiteMap) -> list[Station]:
    """All bays, row by row, in the order of their numbers. Raises OutputError where rows have no common frame."""
    found: dict[tuple[str, int], list[Element]] = {}
    titles: dict[tuple[str, str], list[str]] = {}
    for element in elements(site):
        number, bay = element.structure.attributes.get(BAY), element.structure.attributes.get(BAY)
        if isinstance(number, int) and len(element.structure.vertices):
            found.setdefault((element.row, number), []).append(element)
        if isinstance(bay, str) and element.structure.attributes.get(TEXT):
            titles.setdefault((element.row, bay), []).append(visible(str(element.structure.attributes[TEXT])))
    return [
        Station(
            f"{visible(row)} / {BAY} {number}",
            row,
            np.mean([element.structure.vertices[:, :2].mean(axis=0) for element in parts], axis=0),
            ", ".join(titles.get((row, f"{BAY} {number}"), [])),
        )
        for (row, number), parts in _in_order(site, found)
    ]


def _in_order(
    site: SiteMap, found: dict[tuple[str, int], list[Element]]
) -> Iterator[tuple[tuple[str, int], list[Element]]]:
    order = {row: number for number, row in enumerate(site.rows)}
    yield from sorted(found.items(), key=lambda item: (order[item[0][0]], item[0][1]))
