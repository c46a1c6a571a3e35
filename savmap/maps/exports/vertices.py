"""A map in formats that other programs read: ASCII PLY (vertices, edges, a colour for each label) and CSV (vertices).

Rows that are placed are given in the site's frame, others in their own.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from savmap.errors import visible
from savmap.files.atomic import write_bytes, write_text
from savmap.maps.exports.frames import in_site, require_one_frame
from savmap.maps.exports.marks import BETWEEN, bytes_of, colours, remarks, sigmas
from savmap.types import SiteMap, Structure, assumed_axes

FORMULAS = tuple("=+-@")
COLUMNS = [
    "row",
    "frame",
    "plugin",
    "structure",
    "label",
    "vertex",
    "x_m",
    "y_m",
    "z_m",
    "sigma_x_m",
    "sigma_y_m",
    "sigma_z_m",
    "unchecked_m",
    "assumed",
    "text",
    "warnings",
]


def write_csv(site: SiteMap, path: Path) -> None:
    """One line for each vertex: its structure, its coordinates in the site's frame, or in the row's if that is not
    placed, their standard deviations, how far the structure may be off before a second reference shows it, m, and the
    row's axes along which nothing measured it; last what is written on it and what speaks against it. Raises
    OutputError."""
    stream, warnings = io.StringIO(), site.warnings()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in site.rows.values():
        frame = "site" if row.name in site.placements else "row"
        for plugin, structures in row.structures.items():
            for structure in structures:
                placed = in_site(structure, site.placements.get(row.name))
                start = tuple(map(cell, (row.name, frame, plugin, structure.id, structure.label)))
                text = cell(str(structure.attributes.get("text", "")))
                against = cell(BETWEEN.join(warnings.get((row.name, structure.id), ())))
                numbers = np.hstack([placed.vertices, sigmas(placed)])
                unchecked = "" if structure.unchecked_m is None else f"{structure.unchecked_m:.3f}"
                axes = assumed_axes(structure, plugin, row.joint)
                for label, values, assumed in zip(placed.vertex_labels, numbers, axes, strict=True):
                    figures = (f"{value:.5f}" for value in values)
                    table.writerow((*start, cell(label), *figures, unchecked, assumed, text, against))
    write_text(path, stream.getvalue())


def write_ply(site: SiteMap, path: Path) -> None:
    """The wireframe of all rows in the site's frame, or of one row in its own, metres. Raises OutputError, also if
    there are several rows and one of them is not placed, because its frame is another one."""
    require_one_frame(site)
    unplaced = [name for name in site.rows if name not in site.placements]
    what = f"row {unplaced[0]}" if unplaced else f"site, rows {', '.join(site.rows)}"
    structures = [
        in_site(structure, site.placements.get(row.name))
        for row in site.rows.values()
        for group in row.structures.values()
        for structure in group
    ]
    text = "\n".join(map(visible, _ply((f"savmap {what}, metres", *remarks(site.rows.values())), structures))) + "\n"
    write_bytes(path, text.encode("ascii", "backslashreplace"))


def cell(text: str) -> str:
    """A text as a cell of CSV: on one line, and with an apostrophe before what a spreadsheet would take for a
    formula."""
    shown = visible(text)
    return f"'{shown}" if shown.lstrip()[:1] in FORMULAS else shown


def _ply(comments: Sequence[str], structures: Sequence[Structure]) -> Iterator[str]:
    palette = {
        label: "{} {} {}".format(*bytes_of(colour))
        for label, colour in colours(structure.label for structure in structures).items()
    }
    firsts = np.cumsum([0, *(len(structure.vertices) for structure in structures)]).tolist()
    yield from ("ply", "format ascii 1.0", *(f"comment {line}" for line in comments))
    for label, colour in palette.items():
        yield f"comment label {label}: {colour}"
    yield f"element vertex {firsts[-1]}"
    yield from (f"property double {axis}" for axis in "xyz")
    yield from (f"property uchar {channel}" for channel in ("red", "green", "blue"))
    yield f"element edge {sum(len(structure.edges) for structure in structures)}"
    yield from ("property int vertex1", "property int vertex2", "end_header")
    for structure in structures:
        yield from (f"{x:.4f} {y:.4f} {z:.4f} {palette[structure.label]}" for x, y, z in structure.vertices.tolist())
    for first, structure in zip(firsts, structures, strict=False):
        yield from (f"{first + a} {first + b}" for a, b in structure.edges.tolist())
