"""Uprights and beams as a table: CSV with a line for each, its edges, sizes and standard deviations, and what speaks
against it."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from savmap.files.atomic import write_text
from savmap.maps.exports.marks import BETWEEN
from savmap.maps.exports.plain import cell
from savmap.types import Bools, SiteMap, Structure
from savmap_shelves.report.slots import edge

SIDES = ("left", "right", "bottom", "top")
SIZES = ("width", "height")
COLUMNS = [
    *("row", "element", "label", "bay", "number"),
    *(f"{side}_m" for side in SIDES),
    *(f"sigma_{side}_m" for side in SIDES),
    *(name for size in SIZES for name in (f"{size}_m", f"sigma_{size}_m")),
    *("assumed", "doubts"),
]
ON_BEAMS = {"bottom": "lower", "top": "upper"}
"""What beams call these sides."""


def write_elements(site: SiteMap, path: Path, plugin: str) -> None:
    """A line for each upright and beam: its sides along the row and above the floor, in the row's frame, and its sizes,
    m. An empty cell for what an element has not, such as an upright a bay. `assumed`: the sides that nothing measured.
    Raises OutputError."""
    text, said = io.StringIO(), site.doubts()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in site.rows.values():
        for element in row.structures.get(plugin, ()):
            assumed = element.assumed(plugin, row.joint)
            table.writerow(_cells(row.name, element, assumed, said.get((row.name, element.id), ())))
    write_text(path, text.getvalue())


def _cells(row: str, element: Structure, assumed: Bools, against: Sequence[str]) -> list[str]:
    own = element.attributes
    names = [ON_BEAMS.get(side, side) if element.label == "beam" else side for side in SIDES]
    sides = [edge(element, number // 2, name) for number, name in enumerate(names)]
    unmeasured = [
        side
        for number, (side, name) in enumerate(zip(SIDES, names, strict=True))
        if any(
            one[number // 2] for one, label in zip(assumed, element.vertex_labels, strict=True) if name in label.split()
        )
    ]
    sizes = {name: (value, sigma) for name, value, sigma in element.sizes()}
    return [
        *map(cell, (row, element.id, element.label)),
        *(str(own.get(key, "")) for key in ("bay", element.label)),
        *(f"{side.value:.4f}" for side in sides),
        *(f"{side.sigma:.5f}" for side in sides),
        *(
            text
            for size in SIZES
            for text in ((f"{value:.5f}" for value in sizes[size]) if size in sizes else ("", ""))
        ),
        cell(BETWEEN.join(unmeasured)),
        cell(BETWEEN.join(against)),
    ]
